"""Steppers on a TMCL module of somebody else's: in memory, in a time of its own, with every status at every place."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest

from itouch_xyz_table import tmcl
from itouch_xyz_table.servos import Goal, ServoError
from itouch_xyz_table.tmcl import Steppers

ADDRESS, STEPS = 3, 51200.0
ROTATE, STOP, MOVE, SET, GET, SET_ALL, GET_ALL, SEARCH = (1, 2), 3, 4, 5, 6, 9, 10, 13
LOADED, DAMAGED = 101, 1


class Module:
    """A module behind a port; its heartbeat is set and read, and stops nothing.

    ``says`` gives the status of a request by its number and command, None: it is done.  ``others`` are sent before an
    answer: what the line brings of somebody else's.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Be as new."""
        self.host, self.count, self.closed, self.searched = 2, 0, False, 0
        self.says: Callable[[int, int], int | None] = lambda number, command: None
        self.others: Callable[[int, int], bytes] = lambda status, command: b""
        self.place, self.speed, self.heartbeat, self.now = [0, 0, 0], [0, 0, 0], 0, 0.0
        self.set: dict[tuple[int, int], int] = {}
        self._out = b""

    def clock(self) -> float:
        self.now += 1e-4
        return self.now

    def write(self, frame: bytes) -> None:
        assert len(frame) == 9
        assert sum(frame[:8]) & 255 == frame[8]
        _, command, kind, motor, value = struct.unpack(">BBBBi", frame[:8])
        self.count += 1
        status = self.says(self.count, command)
        if status is None:
            status, value = 100, self.obey(command, kind, motor, value)
        self._out += self.others(status, command) + told(self.host, ADDRESS, status, command, value)

    def obey(self, command: int, kind: int, motor: int, value: int) -> int:
        if command in ROTATE:
            self.speed[motor] = value
        elif command == STOP or (command == SEARCH and kind == 1):
            self.speed[motor] = 0
        elif command == MOVE or (command == SET and kind == 1):
            self.place[motor], self.speed[motor] = value, 0
        elif command == SET:
            self.set[motor, kind] = value
        elif command == GET:
            return {1: self.place, 3: self.speed}[kind][motor] if kind in (1, 3) else self.set.get((motor, kind), 0)
        elif command == SET_ALL:
            self.heartbeat = value
        elif command == GET_ALL:
            return self.heartbeat
        elif command == SEARCH:
            self.searched = 3 if kind == 0 else max(0, self.searched - 1)
            self.speed[motor] = -1000 if self.searched else 0
            return self.searched
        return value

    def read(self, size: int) -> bytes:
        self.now += 1e-3
        found, self._out = self._out[:size], self._out[size:]
        return found

    def readinto(self, piece: bytearray, timeout: float) -> int:
        found, self._out = self._out[: len(piece)], self._out[len(piece) :]
        piece[: len(found)] = found
        return len(found)

    def close(self) -> None:
        self.closed = True


def told(host: int, module: int, status: int, command: int, value: int) -> bytes:
    data = struct.pack(">BBBBi", host, module, status, command, value)
    return data + bytes((sum(data) & 255,))


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[Module]:
    made = Module()
    monkeypatch.setattr(tmcl, "_opened", lambda port, baud: made)
    monkeypatch.setattr(tmcl, "_POLL", 0.0)
    yield made


def steppers(module: Module, watchdog: float | None = None) -> Steppers:
    return Steppers(
        "/dev/bench", baud=9600, address=ADDRESS, motors=(0, 1, 2), microsteps=(STEPS,) * 3, leads=(0.01,) * 3,
        speed=0.1, acceleration=1.0, watchdog=watchdog, clock=module.clock,
    )  # fmt: skip


def homed(module: Module, watchdog: float | None = None) -> None:
    """Open a module as a table does that looks for its ends."""
    servos = steppers(module, watchdog)
    servos.stop()
    servos.search((0.01,) * 3, (0.0,) * 3)
    servos.ready()


def at(which: int, status: int, number: int, command: int) -> int | None:
    return status if number == which else None


def goals(place: float) -> list[Goal | None]:
    return [Goal(place, 0.0, 0.0, 1.0, 1.0)] * 3


@pytest.mark.parametrize("status", [2, 3, 4, 5, 6, LOADED, 128])
def test_a_refusal_while_it_is_opened_leaves_no_motor_turning(module: Module, status: int) -> None:
    """Whichever request it is: a search goes on by itself, and a module without a heartbeat stops for nobody."""
    homed(module)
    for last in range(1, module.count + 1):
        module.begin()
        module.says = partial(at, last, status)
        with pytest.raises(ServoError, match="refuses command"):
            homed(module)
        assert module.speed == [0, 0, 0]


def test_a_search_that_is_broken_off_leaves_no_motor_turning(module: Module) -> None:
    def broken(number: int, command: int) -> None:
        if module.searched == 2:
            module.searched = 0
            raise KeyboardInterrupt

    module.says = broken
    with pytest.raises(KeyboardInterrupt):
        homed(module)
    assert module.speed == [0, 0, 0]


def test_a_heartbeat_that_stops_nothing_is_refused_and_the_motor_stands(module: Module) -> None:
    """Also where the module refuses the first order to stop."""
    turned = [False]

    def once(number: int, command: int) -> int | None:
        if any(module.speed) and command == STOP and not turned[0]:
            turned[0] = True
            return 6
        return None

    servos = steppers(module, 0.1)
    module.says = once
    with pytest.raises(ServoError, match="motor x refuses command 3"):
        servos.ready()
    assert turned == [True]
    assert module.speed == [0, 0, 0]


def test_an_order_that_is_stored_in_a_program_is_not_taken_as_done(module: Module) -> None:
    """A module in its download mode answers 101 to everything, and does nothing: not even to the order to stop."""
    servos = steppers(module)
    module.says = lambda number, command: LOADED if command in (STOP, MOVE) else None
    for order in (servos.stop, lambda: servos.command(goals(0.5))):
        with pytest.raises(ServoError, match="it stores commands as a program and obeys none: end its download mode"):
            order()
    with pytest.raises(ServoError, match="it stores commands as a program"):
        steppers(module)
    assert module.closed


def test_what_it_says_to_another_host_is_not_taken(module: Module) -> None:
    """It answers one question after the other; that to another host's stands before ours and has another value."""
    module.others = lambda status, command: told(1, ADDRESS, 100, command, 4711)
    module.place[:] = [51200, -25600, 0]
    servos = steppers(module)
    assert [state.position for state in servos.query()] == [1.0, -0.5, 0.0]
    assert [state.position for state in servos.command(goals(0.25))] == [1.0, -0.5, 0.0]
    assert servos.repeated == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"host": 5}, r"answers to host 5 only: set its global parameter 76 to 2 with the maker's program"),
        (
            {"says": lambda number, command: DAMAGED},
            r"says that requests reach it damaged: check its cable, and .*baud",
        ),
    ],
)
def test_a_module_that_cannot_be_talked_to_says_why(module: Module, change: dict[str, Any], words: str) -> None:
    for name, value in change.items():
        setattr(module, name, value)
    with pytest.raises(ServoError, match=rf"motor x \(module 3\) {words}"):
        steppers(module)
    assert module.closed


def test_the_slowest_axis_on_full_steps_is_given_a_speed_and_an_acceleration_all_the_same(module: Module) -> None:
    """Rounded to nought, either would let the motor stand, or a module take what it has of its own."""
    Steppers(
        "/dev/bench", baud=9600, address=ADDRESS, motors=(0, 1, 2), microsteps=(1.0, 10.0, 100.0), leads=(0.5,) * 3,
        speed=0.01, acceleration=0.1, watchdog=None, clock=module.clock,
    ).close()  # fmt: skip
    assert [module.set[motor, 4] for motor in range(3)] == [1, 1, 2]
    assert [module.set[motor, 5] for motor in range(3)] == [1, 2, 20]
