"""Times that go with the numbers on the wire between loop and device: when they were measured, when a command left."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.moved import with_old_fields
from itouch.plugin.record import Record


@with_old_fields(left="command_sent", moments="measurement_times")
class Timestamps:
    """The times of one exchange on the host's monotonic clock [s], for a driver that knows them exactly.

    Unless a driver says otherwise, a reading counts as measured in the middle of the ``read`` that brought it, and a
    command as having left at the end of ``write``.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self._names = {name: index for index, name in enumerate(channels)}
        self._begun, self._left = 0.0, -1.0
        self._measured = [-1.0] * len(self._names)
        self._inside = [0.0] * len(self._names)

    def begin(self) -> None:
        """Begin an exchange: none of its times is known yet."""
        self._begun, self._left = time.monotonic(), -1.0
        self._measured = [-1.0] * len(self._names)

    def measured(self, *channels: str, ago: float = 0.0, inside: float = 0.0) -> None:
        """State that these channels (default: all) were measured just now, or ``ago`` [s] before.

        ``inside`` [s] is how old the readings already were when the device sent them (a mean is half as old as its
        averaging time); unlike the time on the wire, it is the same when host and device are run in step.

        Raises
        ------
        ValueError
            If a time is negative or not finite: a reading measured in the future would never be too old.
        """
        _require_past(ago=ago, inside=inside)
        moment = time.monotonic() - ago - inside
        for name in channels or self._names:
            self._measured[self._names[name]] = moment
            self._inside[self._names[name]] = inside

    def inside(self) -> tuple[float, ...]:
        """Return how old each channel's reading was when the device sent it [s]."""
        return tuple(self._inside)

    def command_sent(self, ago: float = 0.0) -> None:
        """State that the device received the command just now, or ``ago`` [s] before.

        Raises
        ------
        ValueError
            If the time is negative or not finite.
        """
        _require_past(ago=ago)
        self._left = time.monotonic() - ago

    def departure(self, otherwise: float) -> float:
        """Return when the command left [s]; ``otherwise`` if the driver has not stated it."""
        return self._left if self._left >= 0.0 else otherwise

    def measurement_times(self) -> tuple[float, ...]:
        """Return when each channel was measured [s]; if not stated, in the middle of the exchange until now."""
        middle = 0.5 * (self._begun + time.monotonic())
        return tuple(moment if moment >= 0.0 else middle for moment in self._measured)


def _require_past(**times: float) -> None:
    for name, seconds in times.items():
        if not 0.0 <= seconds < math.inf:
            raise ValueError(f"{name} = {seconds!r} must be seconds that have passed")


class Timestamped:
    """A device, or a twin, whose readings and commands take time.

    Times are in ticks of the loop: a reading measured in the ``read`` of a tick belongs to that tick, and a command
    that leaves in a tick acts from that tick on, like one written in it without a wire.  A command that is still on its
    way leaves in a later tick.
    """

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in for each channel the tick in which the reading that arrived in this tick was measured.

        ``ticks`` (channels,), written: the number of a tick for each reading.
        """
        ticks[...] = tick

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Fill in a command that has left and was not reported yet; return the tick in which it left; None: none."""
        return None


def ticks_of(seconds: float, period: float) -> int:
    """Return a time in whole ticks, rounded; ``period`` [s] is that of a tick."""
    return math.floor(seconds / period + 0.5)
