"""What a carried surface may do and what it feels, compiled: the arithmetic of `Surface`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel

Floats = NDArray[np.float64]


class Load(NamedTuple):
    """What a surface's sensor reads, (n,) or nothing, and which of it are torques that count; ``lever`` [m], (1,)."""

    reading: Floats
    torques: NDArray[np.int64]
    lever: Floats


@kernel
def size(vector: Floats) -> float:
    """Return the length of a vector (3,)."""
    return float(math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]))


@kernel
def felt(load: Any) -> float:
    """Return the force [N] on the surface in whatever direction; a torque counts as a force, too."""
    if load.reading.shape[0] == 0:
        return 0.0
    square = 0.0
    for k in range(load.torques.shape[0]):
        square += load.reading[load.torques[k]] ** 2
    return float(max(size(load.reading), math.sqrt(square) / load.lever[0]))


@kernel
def pace(gap: float, strayed: float, tracking: float, near: float, close: float, far: float) -> float:
    """Return how fast a surface may approach: not while it is astray, ``close`` where it is nearer than ``near``."""
    if strayed > tracking:
        return 0.0
    return close if gap < near else far
