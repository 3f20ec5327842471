"""The readings of the USB arm's driver: position, buttons, homing; and statistics of their timing."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch_usb_arm.wire import Buttons

#: Number of latest exchanges over which `Timing` computes its figures.
WINDOW = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One answer of the arm.

    Attributes
    ----------
    encoders
        Counts of the three legs.
    position
        Position of the grip [m], shape (3,), read-only; NaN until all axes are homed.
    buttons
        Buttons that are pressed.
    homed
        Which axes are homed.
    """

    encoders: tuple[int, int, int]
    position: NDArray[np.float64]
    buttons: Buttons
    homed: tuple[bool, bool, bool]

    @property
    def valid(self) -> bool:
        """Whether all axes are homed, so that the position is meaningful."""
        return all(self.homed)


class Timing:
    """Durations of the latest exchanges, as measured by the host."""

    def __init__(self) -> None:
        self._durations: deque[float] = deque(maxlen=WINDOW)
        self._times: deque[float] = deque(maxlen=WINDOW)
        self.count = 0

    def add(self, when: float, duration: float) -> None:
        """Add an exchange that ended at ``when`` [s] and took ``duration`` [s]."""
        self._times.append(when)
        self._durations.append(duration)
        self.count += 1

    @property
    def rate(self) -> float:
        """Exchanges a second; 0 until there are two."""
        if len(self._times) < 2:
            return 0.0
        span = self._times[-1] - self._times[0]
        return (len(self._times) - 1) / span if span > 0.0 else 0.0

    def latency(self, percent: float) -> float:
        """Return a percentile of the exchanges' durations [s]; 0 if there were none."""
        return float(np.percentile(self._durations, percent)) if self._durations else 0.0

    def __str__(self) -> str:
        middle, late, worst = (self.latency(p) * 1e3 for p in (50, 99, 100))
        return f"{self.rate:.0f} exchanges/s, {middle:.2f} ms median, {late:.2f} ms p99, {worst:.2f} ms at most"
