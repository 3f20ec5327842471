"""Whether a reading can be believed, compiled: the arithmetic of `Readings`.

In every function ``limits`` are `PlausibilityLimits` and ``memory`` a `Memory`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class PlausibilityLimits(NamedTuple):
    """The limits within which the n numbers of a reading are plausible.

    ``low``, ``high`` (n,): their range; ``trips`` (n,): the trip of a number outside it; ``checked``: indices of the
    numbers with limits, with ``speed`` and ``room`` (n,): how far one can be from the reading before, per second and at
    once; ``first``, ``second``: indices of numbers that measure the same and differ by at most ``apart`` (1,);
    ``turns``: where quaternions begin, and ``stretch`` (1,): how far the sum of the squares of their parts may be from
    1; limits are in the units of the channels; ``disagree``, ``jump``, ``odd``, ``outside`` (1,): the trips of two
    numbers that differ, of one too far from the reading before, of NaN or an infinite number, and of a quaternion that
    is no rotation.
    """

    low: Floats
    high: Floats
    trips: Numbers
    checked: Numbers
    speed: Floats
    room: Floats
    first: Numbers
    second: Numbers
    apart: Floats
    turns: Numbers
    stretch: Floats
    disagree: Numbers
    jump: Numbers
    odd: Numbers
    outside: Numbers


class Memory(NamedTuple):
    """What is remembered, as State has it.

    ``believed`` (n,): the last believed reading, in the channels' units; ``known`` (1,): 1 while the next is compared
    with it; ``figure`` (2,): the figures of the last trip, an index in the reading and a number.
    """

    believed: Floats
    known: Numbers
    figure: Floats


@linked
def _found(limits: Any, memory: Any, values: Floats) -> float:
    """Note the first number that is out of range or not finite, and return minus its trip."""
    for i in range(len(values)):
        finite = math.isfinite(values[i])
        if not finite or not limits.low[i] <= values[i] <= limits.high[i]:
            memory.figure[0], memory.figure[1] = i, 0.0
            return -float(limits.trips[i] if finite else limits.odd[0])
    memory.figure[0], memory.figure[1] = -1.0, 0.0
    return -float(limits.odd[0])


@linked
def squared_length(values: Floats, at: int) -> float:
    """Return the sum of the squares [1] of a quaternion's four parts, which begin at index ``at`` of a reading (n,)."""
    w, x, y, z = float(values[at]), float(values[at + 1]), float(values[at + 2]), float(values[at + 3])
    return w * w + x * x + y * y + z * z


@linked
def doubt(limits: Any, memory: Any, values: Floats, seconds: float) -> float:
    """Return 1, or minus the trip of a reading (n,) that cannot be believed.

    ``values`` are in the channels' units, as ``limits`` are; ``seconds``: since the reading before [s].
    """
    total = 0.0
    for i in range(len(values)):
        total += float(values[i])
    if not math.isfinite(total):  # something is not a number, or infinite
        return float(_found(limits, memory, values))
    known = memory.known[0] != 0
    for k in range(len(limits.checked)):
        i = limits.checked[k]
        value = values[i]
        if not limits.low[i] <= value <= limits.high[i]:
            return float(_found(limits, memory, values))
        last = memory.believed[i] if known else value
        if abs(value - last) > limits.speed[i] * seconds + limits.room[i]:
            memory.figure[0], memory.figure[1] = i, 0.0
            return -float(limits.jump[0])
    for k in range(len(limits.turns)):
        squared = squared_length(values, limits.turns[k])
        if abs(squared - 1.0) > limits.stretch[0] and squared != 0.0:  # all zeros: no rotation is told
            memory.figure[0], memory.figure[1] = limits.turns[k], math.sqrt(squared)
            return -float(limits.outside[0])
    for k in range(len(limits.first)):
        apart = abs(values[limits.first[k]] - values[limits.second[k]])
        if apart > limits.apart[0]:
            memory.figure[0], memory.figure[1] = limits.first[k], apart
            return -float(limits.disagree[0])
    return 1.0


@kernel
def check(limits: Any, memory: Any, values: Floats, seconds: float) -> float:
    """Do what ``doubt`` does, and remember a reading that is believed.

    ``values`` (n,) are in the channel's unit; ``seconds`` [s].
    """
    found = float(doubt(limits, memory, values, seconds))
    if found == 1.0:
        for i in range(len(values)):
            memory.believed[i] = values[i]
        memory.known[0] = 1
    return found
