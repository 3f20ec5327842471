"""The TEC driver against controllers that refuse, clamp, are busy or have lost a sensor: nothing is left driven."""

from __future__ import annotations

import contextlib
import math
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from test_thermal_drivers import served

from itouch.plugin import DeviceError, Terminal
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers import Mecom, mecom
from itouch_thermal.drivers.emulator import DisplayEmulator
from itouch_thermal.drivers.tec import TecDriver
from itouch_thermal.drivers.virtual import Plate, VirtualMecom

# a controller is a thread beside the driver here: on a busy machine either is kept waiting
pytestmark = pytest.mark.punctual


@dataclass(slots=True)
class Controller(VirtualMecom):
    """One with parameters of its own: what it answers to a read or a write of them, else as usual."""

    reads: dict[int, bytes] = field(default_factory=dict)
    writes: dict[int, bytes] = field(default_factory=dict)
    #: What it stores instead of what is written; under which other channel it has what is not common.
    clamps: dict[int, float] = field(default_factory=dict)
    channel: int = 1
    common: tuple[int, ...] = (104, 105, 2060)
    says: Callable[[str], bytes | None] = lambda text: None

    def _payload(self, text: str) -> bytes:
        said = self.says(text)
        return VirtualMecom._payload(self, text) if said is None else said

    def _placed(self, parameter: int, instance: int) -> int:
        return 1 if instance == (1 if parameter in self.common else self.channel) else 9

    def _read(self, parameter: int, instance: int) -> bytes:
        if parameter in self.reads:
            return self.reads[parameter]
        return VirtualMecom._read(self, parameter, self._placed(parameter, instance))

    def _write(self, parameter: int, instance: int, data: bytes) -> bytes:
        if parameter in self.writes:
            return self.writes[parameter]
        answer = VirtualMecom._write(self, parameter, self._placed(parameter, instance), data)
        if parameter in self.clamps:
            self.floats[parameter] = min(self.floats[parameter], self.clamps[parameter])
        return answer


@contextlib.contextmanager
def on_a_line(device: VirtualMecom) -> Iterator[str]:
    terminal = Terminal()

    def step() -> None:
        if data := terminal.receive():
            terminal.send(device.take(data))

    with served(step):
        yield terminal.path
    terminal.close()


def driver(path: str, instance: int = 1) -> TecDriver:
    return TecDriver(Mecom(port=path, instance=instance), patience=4.0, ceiling=2.0)


def single(value: float) -> bytes:
    return struct.pack(">f", value).hex().upper().encode()


def test_one_that_refuses_a_current_of_zero_still_has_its_output_taken_off() -> None:
    device = Controller(Plate())
    with on_a_line(device) as path:
        tec = driver(path)
        tec.exchange(1.5)
        device.writes[50001] = b"+07"
        with pytest.raises(DeviceError, match="out of range"):
            tec.close()
    assert device.integers[50000] == 0
    assert device.output() == 0.0


@pytest.mark.parametrize(("parameter", "code"), [(50000, 5), (50001, 6), (2060, 7)])
def test_a_refusal_names_the_parameter_in_the_makers_number(parameter: int, code: int) -> None:
    device = Controller(Plate(), writes={parameter: b"+%02d" % code})
    with on_a_line(device) as path, pytest.raises(DeviceError, match=rf"\(parameter {parameter}\): .* \(\+0{code}\)"):
        driver(path)


def test_one_that_is_refused_late_is_not_left_enabled() -> None:
    device = Controller(Plate(), reads={1001: b"+05"})
    with on_a_line(device) as path, pytest.raises(DeviceError, match="no such parameter"):
        driver(path)
    assert device.integers[50000] == 0


@pytest.mark.parametrize(("parameter", "part"), [(1000, "plate"), (1001, "sink")])
@pytest.mark.parametrize("value", [-99.0, math.nan, math.inf, 300.0])
def test_a_temperature_that_cannot_be_is_not_believed(parameter: int, part: str, value: float) -> None:
    device = Controller(Plate(plate=300.0, sink=301.0))
    with on_a_line(device) as path:
        tec = driver(path)
        tec.exchange(0.5)
        device.reads[parameter] = single(value)
        with pytest.raises(DeviceError, match=f"{part} is at .* its sensor is open"):
            for _ in range(4):
                tec.exchange(0.5)
        tec.close()
        with contextlib.suppress(DeviceError):
            driver(path)
    assert device.output() == 0.0


def test_one_that_gives_less_voltage_than_its_limit_has_not_started_anew() -> None:
    device = Controller(Plate(), clamps={50002: 12.0})
    with on_a_line(device) as path:
        tec = driver(path)
        assert [tec.exchange(1.5).current for _ in range(8)] == [1.5] * 8
        device.restart()
        with pytest.raises(DeviceError, match="restarted"):
            for _ in range(4):
                tec.exchange(1.5)


@pytest.mark.parametrize("limit", [0.0, math.nan])
def test_one_whose_voltage_is_limited_to_nothing_is_refused(limit: float) -> None:
    said = pytest.raises(DeviceError, match="voltage limit .* set it with the maker's program")
    with on_a_line(Controller(Plate(), reads={2031: single(limit)})) as path, said:
        driver(path)


def test_one_that_is_busy_for_a_moment_is_waited_for() -> None:
    """Its refusals come at once: all tries of a request would be gone before it has done what it does."""
    device, since = Controller(Plate()), [time.monotonic()]
    device.says = lambda text: b"+02" if time.monotonic() - since[0] < 0.1 else None
    with on_a_line(device) as path:
        tec = driver(path)
        for _ in range(3):
            since[0] = time.monotonic()
            assert tec.exchange(0.5).current == 0.5
        tec.close()


def test_a_second_channel_has_the_controllers_status_and_watchdog_under_the_first() -> None:
    device = Controller(Plate(), channel=2)
    with on_a_line(device) as path:
        tec = driver(path, instance=2)
        assert device.floats[2060] == 0.5
        for _ in range(8):
            tec.exchange(0.5)
        device.error = 137
        with pytest.raises(DeviceError, match="error 137"):
            for _ in range(4):
                tec.exchange(0.5)


@pytest.mark.parametrize("instance", [1, 3])
def test_a_virtual_rig_has_the_channel_that_the_scene_names(instance: int) -> None:
    device = DisplayEmulator(DisplayParams(mecom=Mecom(port="unused", instance=instance))).tec
    assert device is not None
    with on_a_line(device) as path:
        tec = driver(path, instance=instance)
        for _ in range(3):
            assert tec.exchange(0.5).current in (0.0, 0.5)
        assert device.output() == 0.5
        tec.close()
        with pytest.raises(DeviceError, match="no such instance"):
            driver(path, instance=2)


@pytest.mark.parametrize("code", [4, 5, 9])
def test_one_that_knows_no_request_for_several_is_asked_one_by_one(code: int) -> None:
    device = Controller(Plate(), says=lambda text: b"+%02d" % code if text.startswith("?VX") else None)
    with on_a_line(device) as path:
        tec = driver(path)
        assert [tec.exchange(0.5).current for _ in range(5)] == [0.5] * 5
        tec.close()


@pytest.mark.parametrize(("parameter", "wanted"), [(2030, 2.0), (2032, 2.5)])
def test_a_limit_of_the_current_that_is_below_nothing_is_set_anew(parameter: int, wanted: float) -> None:
    """The one that the maker's program has left is no protection, however low it is."""
    device = Controller(Plate())
    device.floats[parameter] = -0.5
    with on_a_line(device) as path:
        driver(path).close()
    assert device.floats[parameter] == pytest.approx(wanted)
    said = pytest.raises(DeviceError, match=f"keeps parameter {parameter} at -0.5 where {wanted:g} was written")
    with on_a_line(Controller(Plate(), reads={parameter: single(-0.5)})) as path, said:
        driver(path)


def test_a_watchdog_that_rounds_up_is_not_called_off() -> None:
    said = pytest.raises(DeviceError, match="at 1 where 0.5 was written: its own watchdog would come too late")
    with on_a_line(Controller(Plate(), reads={2060: single(1.0)})) as path, said:
        driver(path)


def test_one_that_stays_busy_is_told_at_once_after_the_last_try(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is waited for between two tries, not after all of them."""
    device, events = Controller(Plate()), list[str]()

    def busy(text: str) -> bytes:
        events.append("asked")
        return b"+02"

    with on_a_line(device) as path:
        line = mecom.MecomClient(path, patience=5.0)
        monkeypatch.setattr(mecom, "sleep", lambda seconds: events.append("waits"))
        device.says = busy
        with pytest.raises(mecom.MecomRefusal):
            line.read_int(104)
        line.close()
    assert events[0] == events[-1] == "asked"
    assert "waits" in events
