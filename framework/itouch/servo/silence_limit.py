"""How long a silent servo process may go on, once its devices are safe and stay so, to tell why it was silent.

A process that runs out of memory, or that others crowd out on a busy machine, is silent long before it knows the cause;
killed at once, it would never tell.  Its processor time is what counts, so that it gets longer on a busy machine, and
little if it waits for something that does not come.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

#: How much processor time it may use, how long it may idle, and how long it may take in all [s].
WORK, WAIT, MOST = 1.0, 0.5, 10.0
#: Positions of flags and processor times in a process's ``stat``, counted from its state letter.
_FLAGS, _USER, _SYSTEM = 6, 11, 12
#: The state letters of a process that no longer runs, and the flag of one that is ending.
_GONE, _EXITING = frozenset("TtZXx"), 0x4
_TICK: Final = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Process:
    """What the kernel tells of a process: its state letter, whether it is ending, its processor time [s]."""

    letter: str
    ending: bool
    used: float

    @classmethod
    def of(cls, stat: str) -> Process:
        """Parse a line of ``/proc/PID/stat``."""
        words = stat.rpartition(")")[2].split()
        used = (int(words[_USER]) + int(words[_SYSTEM])) / _TICK
        return cls(words[0], bool(int(words[_FLAGS]) & _EXITING), used)

    @property
    def gone(self) -> bool:
        """Whether it is suspended or ending, so that it will do and tell nothing more."""
        return self.letter in _GONE or self.ending


class LastWords:
    """Measures how long a silent process has had, from now on, to tell the cause."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = self._worked = clock()
        self._first: float | None = None
        self._used = 0.0

    def over(self, process: Process) -> bool:
        """Tell whether the process has had its time, given its present state."""
        now = self._clock()
        if self._first is None:
            self._first = self._used = process.used
        if process.used > self._used or process.letter == "R":  # it works, or would if it had a processor
            self._used, self._worked = process.used, now
        spent = process.used - self._first > WORK or now - self._worked > WAIT
        return process.gone or spent or now - self._began > MOST
