"""The ports of servos are left alone where another program has locked them, and locked while they are open."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator

import pytest

from itouch.plugin import DeviceError, Terminal
from itouch_xyz_table.odrive import Odrives
from itouch_xyz_table.servos import Servos


def moteus(port: str) -> Servos:
    return Servos(port, (1, 2, 3), watchdog=0.1, patience=12.0)


def odrive(port: str) -> Odrives:
    return Odrives(f"slcan:{port}@115200", (1, 2, 3), torque_constants=(0.04, 0.04, 0.04))


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal("")
    yield made
    made.close()


@pytest.mark.parametrize("opener", [moteus, odrive])
def test_a_port_that_another_program_has_locked_is_left_alone(
    terminal: Terminal, opener: Callable[[str], object]
) -> None:
    """The clients of moteus servos and of CAN adaptors do not look."""
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(DeviceError, match=f"'{terminal.path}' is in use by another program, .*: end that first$"):
        opener(terminal.path)
    assert len(os.listdir("/proc/self/fd")) == before
    assert terminal.receive() == b""
    os.close(other)


def test_who_has_servos_open_keeps_other_programs_from_their_port(terminal: Terminal) -> None:
    ours, second = moteus(terminal.path), moteus(terminal.path)  # the guardian's
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    for one in (ours, second):
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        one.close()
    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)


def test_a_bus_that_does_not_answer_is_not_kept_locked(terminal: Terminal) -> None:
    with pytest.raises(DeviceError, match="sends no heartbeat"):
        odrive(terminal.path)
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)
