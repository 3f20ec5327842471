"""A TEC controller's line is raised for a session (``CS``), and falls back: after silence, a restart, a program that died."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from test_thermal_drivers import own_rig, served, terminal  # noqa: F401

from itouch.plugin import DeviceError, Terminal, Timestamps, Trace, read_trace
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.drivers import LinePort, mecom
from itouch_thermal.drivers.driver_params import Mecom
from itouch_thermal.drivers.mecom import MecomClient, MecomError, MecomRefusal
from itouch_thermal.drivers.rig import Rig
from itouch_thermal.drivers.tec import TecDriver
from itouch_thermal.drivers.virtual import SILENCE, Plate, VirtualMecom

# a controller is a thread beside the driver here: on a busy machine either is kept waiting
pytestmark = pytest.mark.punctual

FAST, OWN = 460800, 57600


@contextmanager
def controller(line: Terminal, *, hears: int = FAST, answers: int = FAST) -> Iterator[VirtualMecom]:
    """A controller that hears nothing as long as the host's port has another speed than its own.

    What comes faster than ``hears`` does not come to it, and what it sends faster than ``answers`` does not arrive.
    """
    device = VirtualMecom(Plate(plate=300.0, sink=301.5))

    def step() -> None:
        data = line.receive()
        speed = device.fast() or OWN
        if data and line.host_baud() == speed <= hears:
            answer = device.take(data)
            line.send(answer if speed <= answers else b"")

    with served(step):
        yield device


def driver(line: Terminal, patience: float = 5.0) -> TecDriver:
    return TecDriver(Mecom(port=line.path, session_baud=FAST), patience=patience)


def test_a_session_is_fast_and_leaves_the_line_as_it_was(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        tec = driver(terminal)
        assert device.raised == FAST
        for current in (0.5, -1.0):
            assert tec.exchange(current).current == current
        tec.close()
        assert (device.raised or OWN) == OWN
        assert device.output() == 0.0
        MecomClient(terminal.path, OWN).identity()


def test_a_controller_that_cannot_is_driven_at_its_own_speed(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        device.can_hasten = False
        tec = driver(terminal)
        assert tec.exchange(0.5).current == 0.5
        assert terminal.host_baud() == OWN
        tec.close()


def test_silence_makes_the_line_slow_again_and_the_driver_follows(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        tec = driver(terminal)
        tec.exchange(0.5)
        device.floats[2060] = 0.0  # not its watchdog is looked at here
        device.now += 6.0
        assert tec.exchange(0.75).current == 0.75
        assert terminal.host_baud() == OWN
        tec.close()


def test_a_restart_is_told_as_one(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        tec = driver(terminal)
        tec.exchange(0.5)
        device.restart()
        with pytest.raises(DeviceError, match="restarted"):
            for _ in range(8):
                tec.exchange(0.5)


def test_a_speed_that_a_dead_program_left_is_met(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        device.raised = FAST
        tec = driver(terminal)
        assert tec.exchange(0.5).current == 0.5
        tec.close()
    gone = Terminal()
    with pytest.raises(
        MecomError, match="did not answer 3 times; check its power, its cable, and that its line is set to 57600 baud"
    ):
        driver(gone, 0.2)
    gone.close()


def test_a_controller_that_was_deaf_for_a_moment_gets_its_zero(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        tec = driver(terminal, 2.0)
        tec.exchange(0.5)
        device.injected.lost = 4  # all that is asked at the fast speed; at the slow one it hears nothing
        with pytest.raises(MecomError, match="did not answer 7 times"):
            tec.exchange(1.5)
        assert device.raised == FAST and device.floats[50001] == 0.5
        tec.close()
        assert device.floats[50001] == 0.0 and device.integers[50000] == 0
        assert (device.raised or OWN) == OWN


def test_a_controller_that_is_busy_is_not_looked_for_at_another_speed(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        tec = driver(terminal)
        device.injected.busy = 4
        with pytest.raises(MecomRefusal, match="busy"):
            tec.exchange(1.5)
        assert terminal.host_baud() == FAST
        tec.close()
        assert device.integers[50000] == 0


def test_a_speed_that_the_answers_do_not_stand_is_taken_back(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal, answers=OWN) as device:
        client = MecomClient(terminal.path, OWN, patience=4.0)
        assert not client.hasten(FAST)
        assert device.raised == OWN  # it was told to be slow again, and has heard that
        assert client.identity() and terminal.host_baud() == OWN
        client.close()


def test_a_speed_that_the_line_does_not_carry_is_waited_out(
    terminal: Terminal,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waited = list[float]()
    with controller(terminal, hears=OWN) as device:

        def fall(seconds: float) -> None:
            waited.append(seconds)
            device.now += seconds

        monkeypatch.setattr(mecom, "sleep", fall)
        client = MecomClient(terminal.path, OWN, patience=2.0)
        assert not client.hasten(FAST)
        assert waited == [mecom.FALLEN] and mecom.FALLEN > SILENCE
        assert client.identity()
        monkeypatch.setattr(mecom, "sleep", waited.append)
        with pytest.raises(MecomError, match=f"does not carry {FAST} baud, .* at {OWN} baud either: .*session-baud"):
            client.hasten(FAST)
        client.close()


def test_a_port_that_is_gone_does_not_hide_what_came_before() -> None:
    line = Terminal()
    with controller(line):
        client = MecomClient(line.path, OWN, patience=5.0)
        assert client.hasten(FAST)
    line.close()
    client.close()


@pytest.mark.parametrize("speed", [1, 9599])
def test_a_session_is_no_slower_than_a_port_can_be(speed: int) -> None:
    with pytest.raises(ValueError, match=f"session_baud = {speed} must be at least 9600, or 0"):
        Mecom(port="/dev/x", session_baud=speed)


def test_an_exchange_takes_what_its_bytes_take() -> None:
    slow = Mecom(port="/dev/x")
    params = ThermalDisplay.Params(mecom=slow)
    assert ThermalDisplay.exchange_time_for(params) == 0.02
    assert ThermalDisplay.exchange_time_for(replace(params, mecom=replace(slow, session_baud=FAST))) == pytest.approx(
        0.006
    )
    afar = replace(slow, port="socket://h:1", session_baud=FAST)  # its speed is never raised
    assert ThermalDisplay.exchange_time_for(replace(params, mecom=afar)) == 0.02


class Told(Timestamps):
    """Remembers what a driver says of when it measured."""

    said: tuple[float, float] = (0.0, 0.0)

    def measured(self, *channels: str, ago: float = 0.0, inside: float = 0.0) -> None:
        """Remember."""
        self.said = ago, inside


def test_the_age_of_a_rigs_readings_is_before_their_time_on_the_wire(terminal: Terminal) -> None:  # noqa: F811
    with own_rig(terminal):
        line = LinePort(port=terminal.path, baud=9600, age=15e-3)
        stream, stamps = io.StringIO(), Told(["heat_flux"])
        rig = Rig(ThermalDisplay.Params(line=line), Trace(stream, "rig"), patience=20.0)
        rig.exchange(0.5, stamps)
        answer = read_trace(stream.getvalue().splitlines())[-1].data
        assert len(answer) > 30
        assert stamps.said == pytest.approx((len(answer) * 10.0 / 9600.0, 15e-3))
        rig.close()
