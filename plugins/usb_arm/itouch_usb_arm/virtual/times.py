"""Clocks of the virtual arm: the host's, or a virtual one that advances only when somebody waits or reads it."""

from __future__ import annotations

import time
from typing import Protocol


class Time(Protocol):
    """The clock that the virtual arm uses."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for a time [s]."""
        ...


class HostTime:
    """The host's clock, or one that runs ``speed`` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic() * self._speed

    def sleep(self, seconds: float) -> None:
        """Wait for a time [s] of this clock."""
        time.sleep(max(0.0, seconds / self._speed))


class VirtualTime:
    """Advances by the time that is slept, and a little at each reading, so that no polling loop runs for ever."""

    #: By how much reading the clock advances it [s].
    LOOK = 1e-6

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        self._now += self.LOOK
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the time [s]."""
        self._now += max(0.0, seconds)
