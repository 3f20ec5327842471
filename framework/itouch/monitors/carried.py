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
    if len(load.reading) == 0:
        return 0.0
    square = 0.0
    for k in range(len(load.torques)):
        square += load.reading[load.torques[k]] ** 2
    return float(max(size(load.reading), math.sqrt(square) / load.lever[0]))


#: Force [N] up to which nothing counts as a touch, and what a plate's force may rise by that is not seen coming [N].
TOUCH, UNSEEN = 0.03, 0.06
#: How near below the finger a plate may be felt next [m], and how old what is known of plate and finger is, in ticks.
SOON, LATE = 5e-4, 2.0
#: In how many ticks before that the room for it is made: at once, an arm at its limit would be felt to jerk.
RAMP = 20.0
#: A finger that hardly moves is reckoned as if it closed with this [m/s].
SLOW = 0.02


class Nearing(NamedTuple):
    """A finger over a surface: its place and velocity, (3,) in the world, and the height of the surface's top, (1,).

    ``rising`` (1,): how fast the surface rises [m/s], by its last two places;
    ``pad`` (4,): radius [m] of the finger, stiffness [N/m] and damping [N s/m] of its pad, and the period [s].
    """

    finger: Floats
    velocity: Floats
    top: Floats
    rising: Floats
    pad: Floats


@kernel
def rise(nearing: Any, pressed: float) -> float:
    """Return by how much [N] a surface may press harder in the next tick than it was felt to do last.

    A finger that comes down, or a surface that rises, presses the pad deeper; where they meet, the pad's damping acts
    at once.
    """
    radius, stiffness, damping, period = nearing.pad[0], nearing.pad[1], nearing.pad[2], nearing.pad[3]
    closing = max(0.0, nearing.rising[0] - nearing.velocity[2])
    way = LATE * period * closing
    if pressed > TOUCH:
        return float(UNSEEN + stiffness * way)
    beyond = nearing.finger[2] - radius - nearing.top[0] - SOON - way
    part = 1.0 if beyond <= 0.0 else max(0.0, 1.0 - beyond / (RAMP * period * max(closing, SLOW)))
    return float(part * (UNSEEN + stiffness * way + damping * closing))


@kernel
def pace(gap: float, strayed: float, tracking: float, near: float, close: float, far: float) -> float:
    """Return how fast a surface may approach: not while it is astray, ``close`` where it is nearer than ``near``."""
    if strayed > tracking:
        return 0.0
    return close if gap < near else far
