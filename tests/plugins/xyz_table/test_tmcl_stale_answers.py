"""A stepper module whose answers come late or twice: each is taken for the request that it answers, or for none.

Each motor's counter is the time, with the motor's number in its last digit: a reading tells whose it is, and when it was
measured.  Answers come in order, as on a line.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import pytest

from itouch.plugin import Terminal
from itouch_xyz_table import tmclframes as tm
from itouch_xyz_table.servos import ServoError
from itouch_xyz_table.tmcl import PATIENCE, Steppers
from itouch_xyz_table.virtual_tmcl import VirtualStepper, VirtualTmcl

pytestmark = pytest.mark.punctual  # what is driven is a thread beside the driver

#: A microstep is 0.1 ms, so that the axis goes 0.1 m in a second; a busy machine is no silent module.
MICROSTEPS, TENTH, PATIENT = 10_000.0, 1e-4, 4.0
#: A counter is read by the module a moment after it was set to the time.
EXACT = 2e-3


@dataclass(slots=True)
class Clock(VirtualStepper):
    """A motor whose counter tells the time, and its own number in the last digit."""

    time: float = 0.0

    def get(self, parameter: int) -> int | None:
        if parameter == tm.ACTUAL:
            return round(self.time / TENTH) * 10 + self.number
        return VirtualStepper.get(self, parameter)


class Bench:
    """A module on a line that delays and doubles whole answers, once it is told to."""

    def __init__(self) -> None:
        self.terminal = Terminal()
        self.motors = {number: Clock(number, place=0.0) for number in (0, 1, 2)}
        self.module = VirtualTmcl({**self.motors}, address=3, spoil=self._out)
        self.arrivals: Callable[[bytes], Sequence[float]] = lambda answer: (0.0,)
        #: All bytes that have come to it.
        self.heard = b""
        self._waiting: list[tuple[float, bytes]] = []
        self._begin, self._stop = time.monotonic(), False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def now(self) -> float:
        return time.monotonic() - self._begin

    def _out(self, answer: bytes) -> bytes:
        for late in self.arrivals(answer):
            when = max([self.now + late, *(when for when, _ in self._waiting[-1:])])
            self._waiting.append((when, answer))
        return b""

    def _serve(self) -> None:
        while not self._stop:
            for motor in self.motors.values():
                motor.time = self.now
            data = self.terminal.receive()
            self.heard += data
            self.module.take(data, lambda: self.now)
            due = [answer for when, answer in self._waiting if when <= self.now]
            del self._waiting[: len(due)]
            self.terminal.send(b"".join(due))
            time.sleep(2e-4)

    def close(self) -> None:
        self._stop = True
        self._thread.join()
        self.terminal.close()


@contextmanager
def opened() -> Iterator[tuple[Bench, Steppers]]:
    bench = Bench()
    try:
        steppers = Steppers(
            bench.terminal.path, baud=115200, address=3, motors=(0, 1, 2), microsteps=(10.0 * MICROSTEPS,) * 3,
            leads=(0.1,) * 3, speed=0.5, acceleration=1.0, watchdog=0.5, patience=PATIENT,
        )  # fmt: skip
        with closing(steppers):
            yield bench, steppers
    finally:
        bench.close()


def oldest(bench: Bench, steppers: Steppers, exchanges: int) -> float:
    """Return how long before its exchange began a reading was measured at most [s]; each must be its own motor's."""
    found = []
    for turn in range(exchanges):
        begin = bench.now
        states = steppers.command([None] * 3) if turn % 2 else steppers.query()
        counters = [round(state.position * 10.0 * MICROSTEPS) for state in states]
        assert [counter % 10 for counter in counters] == [0, 1, 2]
        found.append(max(begin - counter // 10 * TENTH for counter in counters))
    return max(found)


@pytest.mark.parametrize(
    ("share", "behind"), [(0.1, 0.0), (0.1, 1e-3), (0.1, 3e-3), (0.1, 20e-3), (1.0, 0.0), (1.0, 1e-3)]
)
def test_an_answer_that_comes_twice_is_no_answer_to_the_next_request(share: float, behind: float) -> None:
    chance = random.Random(5)
    with opened() as (bench, steppers):
        bench.arrivals = lambda answer: (0.0, behind) if chance.random() < share else (0.0,)
        assert oldest(bench, steppers, 60) < EXACT


def test_late_and_doubled_answers_make_no_reading_old() -> None:
    chance = random.Random(6)

    def arrivals(answer: bytes) -> Sequence[float]:
        late = 1.2 * PATIENT * PATIENCE if chance.random() < 0.02 else chance.random() * 2e-3
        return (late, late + chance.random() * 3e-3) if chance.random() < 0.2 else (late,)

    with opened() as (bench, steppers):
        bench.arrivals = arrivals
        assert oldest(bench, steppers, 60) < EXACT


def test_the_doubled_answer_to_the_start_of_a_search_is_not_its_end() -> None:
    with opened() as (bench, steppers):
        bench.arrivals = lambda answer: (0.0, 2e-3) if answer[3] == tm.SEARCH else (0.0,)
        with pytest.raises(ServoError, match="axis z found no end switch"):
            steppers.search((-0.056,) * 3, (0.0,) * 3)


def test_every_motor_is_told_to_stop_though_no_answer_comes_any_more() -> None:
    """Of all but the first, an answer was waited for before they were told: they went on turning."""
    with opened() as (bench, steppers):
        bench.arrivals, bench.heard = lambda answer: (), b""
        with pytest.raises(ServoError, match="does not answer"):
            steppers.stop()
        for motor in (0, 1, 2):
            assert tm.request(tm.Request(3, tm.STOP, 0, motor, 0)) in bench.heard
