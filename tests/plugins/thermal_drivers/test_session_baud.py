"""A TEC controller's line is raised for a session (``CS``), and falls back: after silence, a restart, a program that died."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from test_thermal_drivers import served, terminal  # noqa: F401

from itouch.plugin import DeviceError, Terminal
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.drivers.mecom import MecomClient, MecomError
from itouch_thermal.drivers.params import Mecom
from itouch_thermal.drivers.tec import TecDriver
from itouch_thermal.drivers.virtual import Plate, VirtualMecom

FAST, OWN = 460800, 57600


@contextmanager
def controller(line: Terminal) -> Iterator[VirtualMecom]:
    """A controller that hears nothing as long as the host's port has another speed than its own."""
    device = VirtualMecom(Plate(plate=300.0, sink=301.5))

    def step() -> None:
        data = line.receive()
        if data and line.host_baud() == (device.fast() or OWN):
            line.send(device.take(data))

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
        with pytest.raises(DeviceError, match="started anew"):
            for _ in range(8):
                tec.exchange(0.5)


def test_a_speed_that_a_dead_program_left_is_met(terminal: Terminal) -> None:  # noqa: F811
    with controller(terminal) as device:
        device.raised = FAST
        tec = driver(terminal)
        assert tec.exchange(0.5).current == 0.5
        tec.close()
    gone = Terminal()
    with pytest.raises(MecomError, match="did not answer 3 times"):
        driver(gone, 0.2)
    gone.close()


def test_an_exchange_takes_what_its_bytes_take() -> None:
    slow = Mecom(port="/dev/x")
    params = ThermalDisplay.Params(mecom=slow)
    assert ThermalDisplay.takes(params) == 0.02
    assert ThermalDisplay.takes(replace(params, mecom=replace(slow, session_baud=FAST))) == pytest.approx(0.006)
