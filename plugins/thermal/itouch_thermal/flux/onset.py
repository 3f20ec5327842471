"""Computations at the beginning of a touch, compiled: called from Python, and by the kernels of the tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.live import surface_temperature
from itouch.plugin.kernels import fused, kernel, linked

Floats = NDArray[np.float64]

#: Indices into the account of a contact.
RENDERED, READY, TICKS, SUM, PEAK, SKIN_BEGIN, SKIN_EXTREME, SQUARES, SCORED = range(9)
#: Value of RENDERED if the start temperature was clipped to the plate's band; else it is 1, or 0: nothing was rendered.
CLIPPED = 2.0
#: Greatest number of servo periods between the start of a touch and the force reading that first shows it.
LATE = 6
#: Distance [K] of the skin temperatures between which start temperatures are interpolated linearly.
SKIN_STEP = 2.0
#: How far from the scene's skin temperature these lines are continued, in multiples of that distance.
FAR = 1.5
#: By how much an object that was never touched may seem to differ from its temperature because of rounding [K].
UNTOUCHED = 1e-6


@kernel
def converted(matrix: Floats, modes: Floats, out: Floats) -> None:
    """Fill ``out`` (m,) with a matrix (m, n) times the first n of the modes.

    The products are summed in the same order as by OpenBLAS, which NumPy would call, on a processor with AVX2, so that
    stored sessions go on to the same bits.  A call of that library would take longer than this, because its code has to
    be fetched into the cache after seconds without use.
    """
    rows, columns = matrix.shape
    lanes, even = columns - columns % 4, rows - rows % 4
    for i in range(rows):
        a = b = c = d = 0.0
        if i < even:
            for k in range(0, lanes, 4):
                a, b = fused(matrix[i, k], modes[k], a), fused(matrix[i, k + 1], modes[k + 1], b)
                c, d = fused(matrix[i, k + 2], modes[k + 2], c), fused(matrix[i, k + 3], modes[k + 3], d)
            found = (a + c) + (b + d)
        elif i < rows - rows % 2:
            for k in range(0, lanes, 2):
                a, b = a + matrix[i, k] * modes[k], b + matrix[i, k + 1] * modes[k + 1]
            found = a + b
        else:
            for k in range(0, lanes, 4):
                a, b = a + matrix[i, k] * modes[k], b + matrix[i, k + 1] * modes[k + 1]
                c, d = c + matrix[i, k + 2] * modes[k + 2], d + matrix[i, k + 3] * modes[k + 3]
            found = (a + c) + (b + d)
        if columns - lanes > 1:
            found += _rest(matrix[i], modes, lanes)
        elif columns > lanes:
            found = fused(matrix[i, lanes], modes[lanes], found)
        out[i] = found


@linked
def _rest(row: Any, modes: Any, first: int) -> float:
    """Return the sum of the last two or three products, those from ``first`` on."""
    found = fused(row[first], modes[first], row[first + 1] * modes[first + 1])
    if row.shape[0] - first == 3:
        found = fused(row[first + 2], modes[first + 2], found)
    return float(found)


@linked
def start_for(
    low: float, middle: float, high: float, scene_skin: float, temperature: float, goes_on: bool, skin: float,
    warmed: float,
) -> float:  # fmt: skip
    """Return the start temperature [K] for an object and a skin temperature [K].

    Parameters
    ----------
    low, middle, high
        Start temperatures [K] for a skin at SKIN_STEP below the scene's skin temperature, at it, and as much above.
    scene_skin, temperature
        The scene's skin temperature and the object's [K].
    goes_on
        Whether start temperatures are extrapolated beyond FAR steps, towards a plate that is as warm as finger and
        object where these are equally warm.
    warmed
        By how much [K] earlier touches have warmed the object.  If finger and object are both warmer by the same
        amount, the plate must be, too.
    """
    like = skin - warmed
    away = (like - scene_skin) / SKIN_STEP
    end = max(-FAR, min(FAR, away))
    slope = (high - middle) if end > 0.0 else (middle - low)
    start = middle + end * slope
    if end != away and goes_on:
        known = scene_skin + end * SKIN_STEP
        if (temperature - known) * end > SKIN_STEP * abs(end):
            slope = (temperature - start) / (temperature - known)
        else:
            slope = slope / SKIN_STEP
        start += (like - known) * slope
    return float(start + warmed)


@linked
def warmth(body: Floats, modes: Floats, temperature: float) -> float:
    """Return by how much [K] an object is warmer than its temperature [K] before it was touched.

    ``body`` (n,) and ``modes`` (size,) as `contact_heat.packing` lays them out; see there for units.
    """
    warmed = surface_temperature(body, modes) - temperature
    return float(warmed if abs(warmed) > UNTOUCHED else 0.0)


@linked
def grown_for(force: float, before: float) -> int:
    """Return how many servo periods ago the finger came, if its force [N] has grown evenly, as from ``before`` [N] on.

    ``before`` is the force of the period before.
    """
    grown = force - before
    return min(LATE, max(1, int(force / grown + 0.5))) if grown > 0.0 else 1


@linked
def render(account: Floats, ready: bool, limited: bool, skin: float) -> bool:
    """Note that the plate begins to render the contact; tell whether it had already rendered part of it before.

    ``account`` (9,) is the contact's; ``ready`` says whether the plate is at its start temperature, ``limited`` whether
    that was clipped to the plate's band; ``skin`` [K] is the skin temperature before (NaN: unknown).
    """
    again = account[RENDERED] != 0.0
    if limited or not again:  # else it stays: the plate may have aimed for the next object
        account[RENDERED] = CLIPPED if limited else 1.0
    if again:
        account[READY] = 1.0 if ready and account[READY] != 0.0 else 0.0
    else:
        account[READY] = 1.0 if ready else 0.0
        account[SKIN_BEGIN] = account[SKIN_EXTREME] = skin
    return bool(again)
