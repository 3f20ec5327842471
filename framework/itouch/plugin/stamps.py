"""What a wire between loop and device says beside the numbers: when they were measured, and when a command left."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.record import Record


class Stamps:
    """The moments of one exchange on the host's monotonic clock [s], for a driver that knows them better.

    Unless a driver says otherwise, a reading was measured in the middle of the ``read`` that brought it, and a command
    left at the end of ``write``.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self._names = {name: index for index, name in enumerate(channels)}
        self._begun, self._left = 0.0, -1.0
        self._measured = [-1.0] * len(self._names)
        self._inside = [0.0] * len(self._names)

    def begin(self) -> None:
        """Begin an exchange: nothing is known of it yet."""
        self._begun, self._left = time.monotonic(), -1.0
        self._measured = [-1.0] * len(self._names)

    def measured(self, *channels: str, ago: float = 0.0, inside: float = 0.0) -> None:
        """Say that these channels were measured just now, or ``ago`` seconds ago; none named: all.

        How old the readings were already when the device sent them (a mean is half as old as its time) is
        ``inside`` [s]; unlike the time on the wire, it is the same where host and device are run in step.

        Raises
        ------
        ValueError
            If that is no time that has passed: what was measured in the future would never be old.
        """
        _require_past(ago=ago, inside=inside)
        moment = time.monotonic() - ago - inside
        for name in channels or self._names:
            self._measured[self._names[name]] = moment
            self._inside[self._names[name]] = inside

    def inside(self) -> tuple[float, ...]:
        """Return how old each channel's reading was when the device sent it [s]."""
        return tuple(self._inside)

    def left(self, ago: float = 0.0) -> None:
        """Say that the device has got the command just now, or ``ago`` seconds ago.

        Raises
        ------
        ValueError
            If that is no time that has passed.
        """
        _require_past(ago=ago)
        self._left = time.monotonic() - ago

    def departure(self, otherwise: float) -> float:
        """Return when the command left; ``otherwise`` if the driver has not said."""
        return self._left if self._left >= 0.0 else otherwise

    def moments(self) -> tuple[float, ...]:
        """Return when each channel was measured, by now at the latest."""
        middle = 0.5 * (self._begun + time.monotonic())
        return tuple(moment if moment >= 0.0 else middle for moment in self._measured)


def _require_past(**times: float) -> None:
    for name, seconds in times.items():
        if not 0.0 <= seconds < math.inf:
            raise ValueError(f"{name} = {seconds!r} must be seconds that have passed")


class Stamped:
    """A device, or a twin, whose readings and commands take their time.

    Ticks are the loop's: what is measured in the ``read`` of a tick belongs to that tick, and a command that leaves in
    a tick acts from it on, as one does that is written in it without a wire.  What is on its way leaves in a tick that
    is still to come.
    """

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in, channel by channel, the ticks at which the reading was measured that came in this tick.

        ``ticks`` (channels,): the number of a tick for each reading, written.
        """
        ticks[...] = tick

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Fill in a command that has left and was not told yet, and return the tick in which it left; None: none."""
        return None


def ticks_of(seconds: float, period: float) -> int:
    """Return so many seconds in whole ticks."""
    return math.floor(seconds / period + 0.5)
