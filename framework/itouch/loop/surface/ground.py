"""The virtual surface below a finger: how high, how steep, and how its height changes as the finger goes on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.contact.cast import sphere_cast
from itouch.loop.render import (
    HIP,
    NORMAL,
    PENETRATION,
    PERIOD,
    PROXY,
    RADIUS,
    SURFACE_HEIGHT,
    TABLE,
    VELOCITY,
)
from itouch.loop.surface.memory import CLIMB, UPRIGHT

Floats = NDArray[np.float64]

#: How far below the finger a surface is looked for [m].
REACH = 0.2
#: Time constant with which the speed of its height is smoothed, as the finger's height is: an arm reads in steps [s].
SMOOTHLY = 0.005
#: Cosine of the steepest slope whose change of height is reckoned with: no plate renders a steeper one.
STEEPEST = 0.3
#: What is found so far below the touched surface [m] is another one: the finger has been pressed past that.
PAST = 1e-3


@kernel
def find(
    c: Floats, world: Floats, mesh: Any, poses: Floats, twists: Floats, figures: Floats, memory: Floats, down: Floats,
    normal: Floats,
) -> int:  # fmt: skip
    """Find the highest virtual surface below the finger, also where it is pressed through the one that it touches.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    world, mesh, poses, twists
        The objects; see ``itouch.contact``.  One that moves takes its surface along.
    figures, memory
        The probe's part of State, and that of the carried surface.
    down, normal
        The direction downwards, and room for a normal, shape (3,): memory that is asked for in each tick costs more
        than what is done with it.

    Returns
    -------
    int
        Whose surface it is, -1 for nobody's.
    """
    before = memory[CLIMB]
    figures[SURFACE_HEIGHT], memory[UPRIGHT], memory[CLIMB] = -np.inf, 1.0, 0.0
    if world.shape[0] == 0:
        return -1
    distance, hit = sphere_cast(world, mesh, poses, figures[HIP : HIP + 3], down, c[RADIUS], REACH, normal)
    above = _past(figures, distance)
    if above > PAST:
        # Nothing stops a hand but a few newtons: it may be beyond a thin object, or far inside one, which it touches
        # from above all the same.  From in there a cast would find nothing, or what is further below.
        above += PAST  # well clear of it: what just touches is taken for either
        start = np.empty(3)
        start[0], start[1], start[2] = figures[HIP], figures[HIP + 1], figures[HIP + 2] + above
        held, touched = sphere_cast(world, mesh, poses, start, down, c[RADIUS], REACH, normal)
        if touched >= 0:
            distance, hit = held - above, touched
    if hit < 0:
        return -1
    figures[SURFACE_HEIGHT] = figures[HIP + 2] - c[RADIUS] - distance
    memory[UPRIGHT] = along_plate(c, normal)
    if normal[2] > STEEPEST:
        climb = -(normal[0] * figures[VELOCITY] + normal[1] * figures[VELOCITY + 1]) / normal[2]
        climb += _rises(c, poses, twists, hit, figures, distance, normal) / normal[2]
        memory[CLIMB] = before + c[PERIOD] / (SMOOTHLY + c[PERIOD]) * (climb - before)
    return int(hit)


@kernel
def _past(figures: Floats, distance: float) -> float:
    """Return how far the finger is below the plane that it touches from above [m]; 0: what it has found is that.

    ``figures`` (FIGURES,); ``distance``: how far below the finger a surface was found [m].
    """
    if figures[PENETRATION] <= 0.0 or figures[NORMAL + 2] <= STEEPEST:
        return 0.0
    above = 0.0
    for i in range(3):
        above += figures[NORMAL + i] * (figures[PROXY + i] - figures[HIP + i])
    above /= figures[NORMAL + 2]
    return float(above) if above + distance > PAST else 0.0


@kernel
def _rises(
    c: Floats, poses: Floats, twists: Floats, hit: int, figures: Floats, distance: float, normal: Floats
) -> float:  # fmt: skip
    """Return how fast the surface that is hit moves along its normal [m/s], where the finger would rest on it."""
    x = figures[HIP] - c[RADIUS] * normal[0] - poses[hit, 0]
    y = figures[HIP + 1] - c[RADIUS] * normal[1] - poses[hit, 1]
    z = figures[HIP + 2] - distance - c[RADIUS] * normal[2] - poses[hit, 2]
    u = twists[hit, 0] + twists[hit, 4] * z - twists[hit, 5] * y
    v = twists[hit, 1] + twists[hit, 5] * x - twists[hit, 3] * z
    w = twists[hit, 2] + twists[hit, 3] * y - twists[hit, 4] * x
    return float(normal[0] * u + normal[1] * v + normal[2] * w)


@kernel
def along_plate(c: Floats, normal: Floats) -> float:
    """Return the cosine of the angle between a normal (3,) in the world and the plate's.

    ``c`` (CONSTANTS,); normal and cosine have no unit [1].
    """
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * c[TABLE + 3 + 3 * i + 2]
    return cosine
