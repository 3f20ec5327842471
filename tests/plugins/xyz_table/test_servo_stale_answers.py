"""Servos whose answers come late: what they answered to an earlier exchange is no reading of this one.

Each servo's place is the time, so that a reading tells when it was measured; answers come in order, as on a bus.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager

import pytest

from itouch.plugin import Terminal
from itouch_xyz_table.drives import Drives
from itouch_xyz_table.odrive import PATIENCE as ODRIVE_PATIENCE
from itouch_xyz_table.odrive import Odrives
from itouch_xyz_table.servos import Servos
from itouch_xyz_table.virtual import VirtualBus, VirtualServo
from itouch_xyz_table.virtual_odrive import VirtualCan, VirtualOdrive

pytestmark = pytest.mark.punctual  # what is driven is a thread beside the driver

IDS, PATIENT = (1, 2, 3), 2.0
#: Returns when each copy of an answer arrives, from now on [s].
Arrivals = Callable[[bytes], Sequence[float]]


class Bench:
    """Servos on a line that delays, doubles and loses whole answers, once it is told to."""

    def __init__(self, bus: VirtualBus | VirtualCan) -> None:
        self.terminal, self._bus = Terminal(), bus
        self.arrivals: Arrivals = lambda answer: (0.0,)
        self.instead: Callable[[bytes], bytes] = lambda answer: answer
        self._begin, self._stop = time.monotonic(), False
        self._waiting: list[tuple[float, bytes]] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def now(self) -> float:
        """The time [s], and the place of every servo [rev]."""
        return time.monotonic() - self._begin

    def _serve(self) -> None:
        while not self._stop:
            for servo in self._bus.servos.values():
                servo.watch(self.now)
                servo.place = self.now
            data = self.terminal.receive()
            out = self._bus.take(data, lambda: self.now) if data or isinstance(self._bus, VirtualCan) else b""
            for answer in out.replace(b"\r", b"\r\n").splitlines(keepends=True):
                for late in self.arrivals(answer):
                    when = max([self.now + late, *(when for when, _ in self._waiting[-1:])])
                    self._waiting.append((when, self.instead(answer.replace(b"\r\n", b"\r"))))
            due = [answer for when, answer in self._waiting if when <= self.now]
            del self._waiting[: len(due)]
            self.terminal.send(b"".join(due))
            time.sleep(2e-4)

    def close(self) -> None:
        self._stop = True
        self._thread.join()
        self.terminal.close()


@contextmanager
def odrives() -> Iterator[tuple[Bench, Drives]]:
    servos = {n: VirtualOdrive(n, low=-1e9, high=1e9, place=0.5, zero=0.0, timeout=0.4) for n in IDS}
    bench = Bench(VirtualCan(servos))
    try:
        drives = Odrives(f"slcan:{bench.terminal.path}", IDS, torque_constants=[0.04] * 3, patience=PATIENT)
        with closing(drives):
            yield bench, drives
    finally:
        bench.close()


@contextmanager
def moteus() -> Iterator[tuple[Bench, Drives]]:
    bench = Bench(VirtualBus({n: VirtualServo(n, low=-1e9, high=1e9, place=0.5, zero=0.0) for n in IDS}))
    try:
        drives = Servos(bench.terminal.path, IDS, watchdog=0.1)
        with closing(drives):
            yield bench, drives
    finally:
        bench.close()


def oldest(bench: Bench, drives: Drives, exchanges: int, pause: float = 0.0) -> float:
    """Return how long before its exchange began a reading was measured at most [s]; below zero: all were measured in
    theirs."""
    found = []
    for _ in range(exchanges):
        begin = bench.now
        found.append(max(begin - state.position for state in drives.query()))
        time.sleep(pause)
    return max(found)


#: How old [s] a reading may seem: threads of one process take turns of up to 5 ms.  What is of an earlier exchange is
#: older than 20 ms.
EXACT = 6e-3


@pytest.mark.parametrize("late", [1.5, 3.0, 6.0])
def test_a_line_that_is_always_late_never_lags_behind(late: float) -> None:
    with odrives() as (bench, drives):
        bench.arrivals = lambda answer: (late * PATIENT * ODRIVE_PATIENCE,)
        assert oldest(bench, drives, 40) < EXACT


def test_one_late_answer_in_ten_makes_no_later_reading_old() -> None:
    chance = random.Random(3)
    with odrives() as (bench, drives):
        bench.arrivals = lambda answer: (2.5 * PATIENT * ODRIVE_PATIENCE if chance.random() < 0.1 else 0.0,)
        assert oldest(bench, drives, 60) < EXACT


def test_the_supply_need_not_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Servos that do not answer what is asked to hear late answers out: these are waited for."""
    told = VirtualOdrive._told
    monkeypatch.setattr(VirtualOdrive, "_told", lambda servo, command: [] if command == 0x17 else told(servo, command))
    chance = random.Random(4)
    with odrives() as (bench, drives):
        bench.arrivals = lambda answer: (1.2 * PATIENT * ODRIVE_PATIENCE if chance.random() < 0.03 else 0.0,)
        begin = time.monotonic()
        assert oldest(bench, drives, 40) < EXACT
        assert time.monotonic() - begin < 40 * 0.2 * PATIENT


def test_the_answer_to_a_repeated_command_is_none_to_the_next_exchange() -> None:
    """One servo's answers come one command too late: its first only when it is asked again, and so on."""
    held: list[bytes] = []

    def instead(answer: bytes) -> bytes:
        if not answer.startswith(b"rcv 03"):
            return answer
        held.append(answer)
        return held.pop(0) if len(held) > 1 else b""

    with moteus() as (bench, drives):
        bench.instead = instead
        assert oldest(bench, drives, 10, pause=0.02) < EXACT
