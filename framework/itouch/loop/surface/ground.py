"""The virtual surface below a finger: its height, its slope, and how its height changes as the finger moves on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import linked
from itouch.contact.cast import sphere_cast
from itouch.loop.render import (
    HIP,
    NORMAL,
    PENETRATION,
    PERIOD,
    PLATE_COSINE,
    PROXY,
    RADIUS,
    SURFACE_HEIGHT,
    TABLE,
    VELOCITY,
)
from itouch.loop.surface.surface_memory import CLIMB, GOES, HASTENS, LIFTS, SLOPE, TURNS, UPRIGHT
from itouch.plugin.carried_surfaces import SLOPE_AHEAD

Floats = NDArray[np.float64]

#: How far below the finger a surface is looked for [m].
REACH = 0.2
#: Time constant [s] with which the finger's speed is smoothed, as its height is: an arm reads in steps.  The slope is
#: not smoothed: where it jumps from one face to the next, the speed of the height jumps, too.
SMOOTHLY = 0.005
#: How near above a surface the finger must be for that [m], and how far ahead a place must be to be another one [m].
NEAR, ELSEWHERE = 2e-3, 1e-5
#: Cosine of the steepest slope whose change of height is followed: no plate renders a steeper one.
STEEPEST = 0.3
#: A surface found this far below the touched one [m] is another one: the finger has been pressed past the touched one.
PAST = 1e-3


@linked
def find(
    c: Floats, world: Floats, mesh: Any, poses: Floats, twists: Floats, figures: Floats, memory: Floats, down: Floats,
    normal: Floats, start: Floats,
) -> int:  # fmt: skip
    """Find the highest virtual surface below the finger, even where the finger is pressed through the one it touches.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    world, mesh, poses, twists
        The objects; see ``itouch.contact``.  A moving object takes its surface along.  The meshes are vertices (v, 3)
        [m], triangles (n, TRIANGLE_WIDTH) and nodes (m, NODE_WIDTH).
    figures, memory
        The probe's part of State, and that of the carried surface.
    down, normal, start
        The direction downwards, and room for a normal and a point, shape (3,): to allocate memory in each tick would
        cost more than the computation.

    Returns
    -------
    int
        Index of the object whose surface it is, -1: none.
    """
    figures[SURFACE_HEIGHT], memory[UPRIGHT], memory[CLIMB] = -np.inf, 1.0, 0.0
    memory[TURNS] = memory[HASTENS] = 0.0
    part = c[PERIOD] / (SMOOTHLY + c[PERIOD])
    u, v = part * (figures[VELOCITY] - memory[GOES]), part * (figures[VELOCITY + 1] - memory[GOES + 1])
    memory[GOES], memory[GOES + 1] = memory[GOES] + u, memory[GOES + 1] + v
    if world.shape[0] == 0:
        return -1
    start[0], start[1], start[2] = figures[HIP], figures[HIP + 1], figures[HIP + 2]
    distance, hit = sphere_cast(world, mesh, poses, start, down, c[RADIUS], REACH, normal)
    above = _past(figures, distance)
    if above > PAST:
        # Only a few newtons stop a hand: it may be beyond a thin object, or far inside one, which it still touches from
        # above.  From in there a cast would find nothing, or what is further below.
        above += PAST  # well clear of it: a sphere that just touches may count as either
        start[2] += above
        held, touched = sphere_cast(world, mesh, poses, start, down, c[RADIUS], REACH, normal)
        if touched >= 0:
            distance, hit = held - above, touched
    if hit < 0:
        return _nothing(memory, -1)
    figures[SURFACE_HEIGHT] = figures[HIP + 2] - c[RADIUS] - distance
    memory[UPRIGHT] = along_plate(c, normal)
    if normal[2] <= STEEPEST:
        return _nothing(memory, hit)
    lifts = part * (_rises(c, poses, twists, hit, figures, distance, normal) / normal[2] - memory[LIFTS])
    memory[LIFTS] += lifts
    x, y = -normal[0] / normal[2], -normal[1] / normal[2]
    memory[CLIMB] = x * memory[GOES] + y * memory[GOES + 1] + memory[LIFTS]
    memory[HASTENS] = (x * u + y * v + lifts) / c[PERIOD]
    if distance < NEAR:
        x, y = _slope_ahead(c, world, mesh, poses, memory, start, down, normal, x, y)
    u, v = x - memory[SLOPE], y - memory[SLOPE + 1]
    memory[TURNS] = (u * memory[GOES] + v * memory[GOES + 1]) / c[PERIOD]
    memory[SLOPE], memory[SLOPE + 1] = x, y
    return int(hit)


@linked
def _nothing(memory: Floats, hit: int) -> int:
    """Forget slope and speed of the surface: there is none, or one too steep for a plate; return what is hit."""
    memory[LIFTS] = memory[SLOPE] = memory[SLOPE + 1] = 0.0
    return int(hit)


@linked
def _slope_ahead(
    c: Floats, world: Floats, mesh: Any, poses: Floats, memory: Floats, start: Floats, down: Floats, normal: Floats,
    x: float, y: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the slope of the surface in x and y where the finger will be soon: faces of a mesh meet in a kink.

    Where a plate would not render the surface there, the slope stays as it was.

    Arguments as in `find`; ``start`` (3,): the point from which the surface was found; it and ``normal`` are written;
    ``x``, ``y``: the slope here [1].
    """
    ahead = max(1.0, np.rint(SLOPE_AHEAD / c[PERIOD])) * c[PERIOD]
    u, v = ahead * memory[GOES], ahead * memory[GOES + 1]
    if u * u + v * v < ELSEWHERE * ELSEWHERE:
        return x, y
    start[0], start[1] = start[0] + u, start[1] + v
    _, hit = sphere_cast(world, mesh, poses, start, down, c[RADIUS], REACH, normal)
    if hit < 0 or normal[2] <= STEEPEST or along_plate(c, normal) < c[PLATE_COSINE]:
        return float(memory[SLOPE]), float(memory[SLOPE + 1])
    return float(-normal[0] / normal[2]), float(-normal[1] / normal[2])


@linked
def _past(figures: Floats, distance: float) -> float:
    """Return how far the finger is below the plane that it touches from above [m]; 0: the surface found is that plane.

    ``figures`` (FIGURES,); ``distance``: how far below the finger a surface was found [m].
    """
    if figures[PENETRATION] <= 0.0 or figures[NORMAL + 2] <= STEEPEST:
        return 0.0
    above = 0.0
    for i in range(3):
        above += figures[NORMAL + i] * (figures[PROXY + i] - figures[HIP + i])
    above /= figures[NORMAL + 2]
    return float(above) if above + distance > PAST else 0.0


@linked
def _rises(
    c: Floats, poses: Floats, twists: Floats, hit: int, figures: Floats, distance: float, normal: Floats
) -> float:  # fmt: skip
    """Return how fast the surface that was hit moves along its normal [m/s], where the finger would rest on it."""
    x = figures[HIP] - c[RADIUS] * normal[0] - poses[hit, 0]
    y = figures[HIP + 1] - c[RADIUS] * normal[1] - poses[hit, 1]
    z = figures[HIP + 2] - distance - c[RADIUS] * normal[2] - poses[hit, 2]
    u = twists[hit, 0] + twists[hit, 4] * z - twists[hit, 5] * y
    v = twists[hit, 1] + twists[hit, 5] * x - twists[hit, 3] * z
    w = twists[hit, 2] + twists[hit, 3] * y - twists[hit, 4] * x
    return float(normal[0] * u + normal[1] * v + normal[2] * w)


@linked
def along_plate(c: Floats, normal: Floats) -> float:
    """Return the cosine of the angle between a normal (3,) in the world and the plate's.

    ``c`` (CONSTANTS,); normal and cosine have no unit [1].
    """
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * c[TABLE + 3 + 3 * i + 2]
    return cosine
