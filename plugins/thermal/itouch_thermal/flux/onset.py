"""What the beginning of a touch is reckoned with, compiled: called from Python, and in the kernels of the tick."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from contact_heat.live import surface_temperature
from itouch.plugin.kernels import fused, kernel

Floats = NDArray[np.float64]

#: The numbers of the account of a contact, in their order.
RENDERED, READY, TICKS, SUM, PEAK, SKIN_BEGIN, SKIN_EXTREME, SQUARES, SCORED = range(9)
#: What the first of them says of a plate whose start temperature was clipped to its band; else 1, 0: not rendered.
CLIPPED = 2.0
#: Most servo periods that a touch may have begun before the force was measured in which it is seen.
LATE = 6
#: Between skin temperatures so far apart [K] a start temperature is linear.
SKIN_STEP = 2.0
#: How far from the scene's skin temperature starts go on in a line, in steps of those that are known.
FAR = 1.5
#: What an object that was never touched may seem to differ from its temperature by rounding [K].
UNTOUCHED = 1e-6


@kernel
def converted(matrix: Floats, modes: Floats, out: Floats) -> None:
    """Fill ``out`` (m,) with a matrix (m, n) times the first n of the modes.

    The products are summed in the order in which OpenBLAS sums them on a processor with AVX2, where NumPy calls it: so
    sessions go on as they were, and to fetch that library's code for the first time in seconds takes longer than this.
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


@kernel
def _rest(row: Any, modes: Any, first: int) -> float:
    """Return the sum of the last two or three products, those from ``first`` on."""
    found = fused(row[first], modes[first], row[first + 1] * modes[first + 1])
    if row.shape[0] - first == 3:
        found = fused(row[first + 2], modes[first + 2], found)
    return float(found)


@kernel
def start_for(
    low: float, middle: float, high: float, scene_skin: float, temperature: float, goes_on: bool, skin: float,
    warmed: float,
) -> float:  # fmt: skip
    """Return the start temperature [K] for an object and a skin temperature [K].

    Parameters
    ----------
    low, middle, high
        Start temperatures [K] at SKIN_STEP below the scene's skin temperature, at it, and above.
    scene_skin, temperature
        The scene's skin temperature and the object's [K].
    goes_on
        Whether starts go on beyond FAR steps in a line.
    warmed
        By how much [K] earlier touches have warmed the object.  Finger and object both warmer by the same is the same
        touch, warmer by that; and one as warm as the other needs a plate that is so, too.
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


@kernel
def warmth(body: Floats, modes: Floats, temperature: float) -> float:
    """Return by how much [K] an object is warmer than its temperature [K] before it was touched.

    ``body`` (n,) and ``modes`` (size,) as `contact_heat.packing` lays them out; see there for units.
    """
    warmed = surface_temperature(body, modes) - temperature
    return float(warmed if abs(warmed) > UNTOUCHED else 0.0)


@kernel
def grown_for(force: float, before: float) -> int:
    """Return how many servo periods ago the finger came whose force [N] has grown from the one ``before``."""
    grown = force - before
    return min(LATE, max(1, int(force / grown + 0.5))) if grown > 0.0 else 1


@kernel
def render(account: Floats, ready: bool, limited: bool, skin: float) -> bool:
    """Note that the plate begins to render the contact; tell whether it has done so before in it.

    ``account`` (9,) is the contact's; ``ready`` says whether the plate is at its start temperature, ``limited`` whether
    that was clipped to its band; ``skin`` [K] is the skin temperature before (NaN: unknown).
    """
    again = account[RENDERED] != 0.0
    if limited or not again:  # what it aims for next is not of this contact
        account[RENDERED] = CLIPPED if limited else 1.0
    if again:
        account[READY] = 1.0 if ready and account[READY] != 0.0 else 0.0
    else:
        account[READY] = 1.0 if ready else 0.0
        account[SKIN_BEGIN] = account[SKIN_EXTREME] = skin
    return bool(again)
