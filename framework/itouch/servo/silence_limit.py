"""How long a servo process that has fallen silent may go on, once its devices are safe and stay so, to say why.

A process that runs into the end of its memory, or that others crowd out on a busy machine, is silent long before it
knows the cause.  Killed at once it never tells.  Time is counted as the processor time that it gets, so that a busy
machine gives it longer, and one that waits for something that does not come gets little.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

#: What it may use of a processor, how long it may wait for nothing, and what both may take together [s].
WORK, WAIT, MOST = 1.0, 0.5, 10.0
#: Where a process's ``stat`` holds its flags and its times of processor, counted from its state.
_FLAGS, _USER, _SYSTEM = 6, 11, 12
#: What the kernel says of a process: the letters of one that does not run any more, the flag of one that is ending.
_GONE, _EXITING = frozenset("TtZXx"), 0x4
_TICK: Final = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Process:
    """What the kernel tells of a process: its state's letter, whether it is ending, what it has used [s]."""

    letter: str
    ending: bool
    used: float

    @classmethod
    def of(cls, stat: str) -> Process:
        """Return what a line of ``/proc/PID/stat`` says."""
        words = stat.rpartition(")")[2].split()
        used = (int(words[_USER]) + int(words[_SYSTEM])) / _TICK
        return cls(words[0], bool(int(words[_FLAGS]) & _EXITING), used)

    @property
    def gone(self) -> bool:
        """Whether it is suspended or ending, so that it will do and say nothing any more."""
        return self.letter in _GONE or self.ending


class LastWords:
    """Counts what a silent process does from now on."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began = self._worked = clock()
        self._first: float | None = None
        self._used = 0.0

    def over(self, process: Process) -> bool:
        """Tell whether the process has had its time, given what is known of it now."""
        now = self._clock()
        if self._first is None:
            self._first = self._used = process.used
        if process.used > self._used or process.letter == "R":  # it works, or would if it had a processor
            self._used, self._worked = process.used, now
        spent = process.used - self._first > WORK or now - self._worked > WAIT
        return process.gone or spent or now - self._began > MOST
