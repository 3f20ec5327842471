"""Looking back by time at a plate's readings, compiled: the arithmetic of `History`.

In every function ``past`` is a `ReadingRing`, and ``window`` or ``double`` the index of a window in it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import linked
from itouch.monitors.thresholds import AREA, FLUX, READINGS, SAME, TIME, VALUE

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class ReadingRing(NamedTuple):
    """A ring of readings in State.

    ``samples`` (1,): how many there were; ``rows`` (READINGS, 4): time [s], temperature [K], and the integrals of
    temperature [K s] and of |flux| [J/m2]; ``flux`` (1,): the newest |flux| [W/m2]; ``tails`` (n,): where each window
    begins; ``windows`` (n,): how long they are [s].
    """

    samples: Numbers
    rows: Floats
    flux: Floats
    tails: Numbers
    windows: Floats


@linked
def add(past: Any, time: float, value: float, flux: float) -> bool:
    """Add a reading: time [s], temperature [K] and |flux| [W/m2]; tell whether it is a new one."""
    count, area, mean = past.samples[0], 0.0, 0.0
    if count > 0:
        last = past.rows[(count - 1) % READINGS]
        passed = time - last[TIME]
        if passed < SAME:
            return False
        area = last[AREA] + last[VALUE] * passed
        mean = last[FLUX] + 0.5 * (past.flux[0] + flux) * passed
    row = past.rows[count % READINGS]
    row[TIME], row[VALUE], row[AREA], row[FLUX] = time, value, area, mean
    past.flux[0] = flux
    past.samples[0] = count + 1
    return True


@linked
def newest(past: Any) -> float:
    """Return when the newest reading was measured [s]; 0 before the first one."""
    count = past.samples[0]
    return float(past.rows[(count - 1) % READINGS, TIME]) if count > 0 else 0.0


@linked
def at(past: Any, time: float, window: int, column: int) -> tuple[bool, float]:
    """Return whether a column is known at a time [s], and its value, interpolated linearly between two readings."""
    count, rows = past.samples[0], past.rows
    tail = max(past.tails[window], count - READINGS)
    if tail >= count or rows[tail % READINGS, TIME] > time + SAME:
        return False, 0.0
    while tail + 1 < count and rows[(tail + 1) % READINGS, TIME] <= time + SAME:
        tail += 1
    past.tails[window] = tail
    first, second = rows[tail % READINGS], rows[min(tail + 1, count - 1) % READINGS]
    wide, part = second[TIME] - first[TIME], time - first[TIME]
    if part < SAME or wide <= 0.0:
        return True, float(first[column])
    return True, float(first[column] + (second[column] - first[column]) * part / wide)


@linked
def before(past: Any, window: int) -> tuple[bool, float]:
    """Return whether the temperature one window ago is known, and what it was [K]."""
    known, value = at(past, newest(past) - past.windows[window], window, VALUE)
    return known, value


@linked
def value_at(past: Any, time: float, window: int) -> float:
    """Return the temperature at a time [K], or the oldest one that is known."""
    known, value = at(past, time, window, VALUE)
    return float(value if known else past.rows[max(0, past.samples[0] - READINGS) % READINGS, VALUE])


@linked
def mean_flux(past: Any, window: int) -> float:
    """Return the mean of |flux| over a window [W/m2]; 0 before one has passed."""
    known, value = at(past, newest(past) - past.windows[window], window, FLUX)
    if not known:
        return 0.0
    return float((past.rows[(past.samples[0] - 1) % READINGS, FLUX] - value) / past.windows[window])


@linked
def step(past: Any, window: int, double: int) -> float:
    """Return the mean temperature over the last window minus that over the one before [K]; 0 until both have passed."""
    now = newest(past)
    older_known, older = at(past, now - past.windows[double], double, AREA)
    middle_known, middle = at(past, now - past.windows[window], window, AREA)
    if not older_known or not middle_known:
        return 0.0
    last = past.rows[(past.samples[0] - 1) % READINGS, AREA]
    return float(((last - middle) - (middle - older)) / past.windows[window])
