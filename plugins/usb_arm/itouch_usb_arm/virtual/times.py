"""Clocks of the virtual arm's emulator: the host's, or one that only goes on when somebody waits."""

from __future__ import annotations

import time
from typing import Protocol


class Time(Protocol):
    """What the emulator asks of time."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait."""
        ...


class HostTime:
    """The host's clock, or one that runs ``speed`` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic() * self._speed

    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        time.sleep(max(0.0, seconds / self._speed))


class VirtualTime:
    """Goes on by what is slept, and by a little at each look, so that no loop can stand still in it."""

    #: What looking at the clock takes [s].
    LOOK = 1e-6

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        self._now += self.LOOK
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time go on [s]."""
        self._now += max(0.0, seconds)
