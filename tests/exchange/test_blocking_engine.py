"""A blocking device in an engine: age and sequence in State, a hang that stops it and delays no tick, no thread left."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import pytest

import itouch
from itouch.exchange import EveryNth
from itouch.loop import Status, WallClock
from itouch.plugin import Channel, Device, Field, Record, Role, temperature
from itouch.plugin.discovery import Catalog, Found
from itouch.scene import loads

SCENE = """<itouch version="1.0">
  <devices><device name="probe" plugin="slow" twin="TWIN"/></devices>
  <safety watchdog="0.4 s"/>
</itouch>
"""


@dataclass(frozen=True)
class _Params:
    pass


class _Slow(Device):
    """A thermometer behind a slow wire."""

    Params = _Params
    reads: ClassVar[tuple[Channel, ...]] = (temperature("temperature", Role.OTHER_TEMPERATURE),)
    blocking: ClassVar[bool] = True
    period: ClassVar[float] = 0.005
    delay: ClassVar[float] = 0.004
    free: ClassVar[threading.Event] = threading.Event()

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self, reading: Record) -> bool | None:
        time.sleep(0.004)
        self.free.wait(300)
        reading["temperature"] = 300.0
        return True


class _Entry:
    def load(self) -> type[Device]:
        return _Slow


@pytest.fixture
def catalog() -> Iterator[Catalog]:
    before = threading.active_count()
    _Slow.free.set()
    found = {"slow": Found("slow", "test", "1", _Entry())}  # type: ignore[arg-type]
    yield Catalog(lambda group: found if group == "itouch.devices" else {})
    _Slow.free.set()
    deadline = time.monotonic() + 300
    while threading.active_count() > before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert threading.active_count() == before


def _engine(catalog: Catalog, twin: str) -> itouch.Session:
    clock = WallClock() if twin == "no" else None
    return itouch.build(loads(SCENE.replace("TWIN", twin).encode(), catalog), catalog=catalog, clock=clock)


@pytest.mark.punctual  # each word holds for 80 ms
def test_readings_come_now_and_then_and_their_age_is_told(catalog: Catalog) -> None:
    engine = _engine(catalog, "no")
    engine.hold()
    engine.enable()
    ages: set[int] = set()

    def look() -> None:
        engine.hold()
        ages.add(int(engine.state["probe.age"]))

    engine.run(0.3, each=look)
    assert engine.status("probe") is Status.ENABLED
    assert 2 <= int(engine.state["probe.sequence"]) < engine.ticks
    assert 0 in ages
    assert max(ages) >= 2
    assert engine.state["probe.temperature"] == 300.0
    engine.close()


@pytest.mark.punctual
def test_a_hang_is_a_fault_of_the_device_and_holds_no_tick(catalog: Catalog) -> None:
    engine = _engine(catalog, "no")
    engine.hold()
    engine.enable()
    engine.run(0.05, each=engine.hold)
    _Slow.free.clear()
    with pytest.raises(itouch.DeviceFaultError, match="probe.*silent"):
        engine.run(5.0, each=engine.hold)
    assert engine.ticks < 5000
    worst = engine.times.figures(2)["max"]  # reading the device: its mailbox, not its wire
    assert worst is not None
    assert worst < 4e6  # one exchange hangs for up to 300 s
    with pytest.raises(itouch.DeviceError, match="does not answer"):
        engine.close()


@pytest.mark.punctual  # each word holds for 80 ms
def test_an_error_in_write_is_told_as_one_in_write(catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes up where the loop reads, as the thread writes between two readings."""

    def write(self: _Slow, command: Record) -> None:
        raise ValueError("the register is read-only")

    drive = Channel("voltage", 1, "V", low=(-1.0,), high=(1.0,), safe=(0.0,), role=Role.DRIVE, harmless="a lamp")
    monkeypatch.setattr(_Slow, "watchdog", 0.1, raising=False)
    monkeypatch.setattr(_Slow, "commands", (drive,), raising=False)
    monkeypatch.setattr(_Slow, "write", write, raising=False)
    engine = _engine(catalog, "no")
    engine.hold()
    engine.enable()
    told = r"failed in write: ValueError: the register is read-only \(test_blocking_engine.py, line "
    with pytest.raises(itouch.DeviceFaultError, match=told):
        engine.run(60.0, each=engine.hold)
    engine.close()


def test_the_twin_has_the_same_period_and_delay(catalog: Catalog) -> None:
    engine = _engine(catalog, "yes")
    fresh = []
    for _ in range(60):
        before = int(engine.state["probe.sequence"])
        engine.tick()
        if int(engine.state["probe.sequence"]) > before:
            fresh.append(engine.ticks - 1)
    steps = {after - tick for tick, after in zip(fresh[1:], fresh[2:], strict=False)}
    assert steps == {5}
    assert fresh[1] - fresh[0] in (4, 5)
    assert "probe.twin.line.left" in engine.state


class _Clocked(Device):
    """Tells when it is read."""

    Params = _Params
    reads: ClassVar[tuple[Channel, ...]] = (temperature("temperature", Role.OTHER_TEMPERATURE),)

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self, reading: Record) -> bool | None:
        reading["temperature"] = self.clock()
        return True


def test_a_device_in_step_goes_by_the_time_of_the_loop() -> None:
    device, reading = EveryNth(_Clocked(_Params()), every=3, period=2e-3), Record.of((Field("temperature"),))
    device.open()
    found = [reading["temperature"].item() for _ in range(9) if device.read(reading)]
    assert [b - a for a, b in zip(found, found[1:], strict=False)] == pytest.approx([6e-3, 6e-3])
    device.close()
    assert _Clocked(_Params()).clock() == pytest.approx(time.monotonic(), abs=10.0)
