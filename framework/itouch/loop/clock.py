"""Virtual and wall clock: the only place that knows host time; State counts ticks, from which seconds are derived."""

from __future__ import annotations

import time
from typing import Protocol

#: For ``asleep``: how often it tries at most, and within what time [s] two clocks count as read at once.
_TRIES, _AT_ONCE = 5, 1e-3


class Clock(Protocol):
    """What paces the loop."""

    pace: str

    def start(self, period: float) -> None:
        """Begin: the next tick is due one period from now."""

    def wait(self) -> float:
        """Wait for the next tick and return how late it is [s]; 0 on a virtual clock."""


class VirtualClock:
    """Never waits: the loop runs as fast as it computes."""

    pace = "fast"

    def start(self, period: float) -> None:
        """Begin; nothing is due."""

    def wait(self) -> float:
        """Return at once."""
        return 0.0


class WallClock:
    """Waits for absolute deadlines: sleeps, then spins through the last part.

    A late loop catches up; to give up the missed periods instead, call ``start`` again.
    """

    pace = "real"
    _SPIN = 60e-6

    def __init__(self) -> None:
        self._deadline = 0.0
        self._period = 0.0

    def start(self, period: float) -> None:
        """Begin: the next tick is due one period from now."""
        self._period = period
        self._deadline = time.perf_counter()

    def wait(self) -> float:
        """Wait for the next deadline and return how late it is [s]."""
        self._deadline += self._period
        while (left := self._deadline - time.perf_counter()) > 0.0:
            if left > self._SPIN:
                time.sleep(left - self._SPIN)
        return -left


def now() -> float:
    """Return host time [s], for durations."""
    return time.perf_counter()


def asleep() -> float:
    """Return for how long [s] this machine has been suspended since it was started, as the other clocks do not count.

    0 where the system does not tell.
    """
    boot = getattr(time, "CLOCK_BOOTTIME", None)  # of Linux alone
    if boot is None:
        return 0.0
    found = 0.0
    for _ in range(_TRIES):  # this thread may have waited for a processor between the two readings
        before = time.monotonic()
        found = time.clock_gettime(boot) - before
        if time.monotonic() - before < _AT_ONCE:
            break
    return found


def processor_time() -> float:
    """Return for how long [s] this thread has had a processor; the time in which it was preempted doesn't count."""
    return time.thread_time()
