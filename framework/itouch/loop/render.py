"""What one probe does in a tick besides the contact search, compiled.

``follow`` takes the tracker's reading to the HIP, ``itouch.contact.step`` finds the proxy, ``touch`` makes the contact
force of it, ``carry`` commands a plate and ``share`` the arm.  (They are apart, because a caller compiles again all
that it calls, and because they belong to different steps of the tick.)

The proxy's spring force comes from the contact engine; damping is added here, where time is known.  The plate follows
the encountered-type rule: with s the height at which the finger would rest on the highest virtual surface below it,
f the lowest point of the probe and c the clearance, the plate's top goes to max(s, f - c); x and y follow the finger.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.contact import layout as at
from itouch.contact.cast import sphere_cast
from itouch.twin.turning import turned_in, turned_out

Floats = NDArray[np.float64]

# --- figures of a probe: State fields in this order --------------------------------------------------------------
HIP, VELOCITY, PROXY, FORCE, NORMAL, POINT = 0, 3, 6, 9, 12, 15
PENETRATION, NORMAL_FORCE, NEAR_DISTANCE, TIME_TO_CONTACT = 18, 19, 20, 21
CONTACT_FORCE, EFFECT_FORCE, AREA = 22, 25, 28
PLATE_GAP, SURFACE_HEIGHT, PLATE_YIELD, PLATE_TOP, TRACKING = 29, 30, 31, 32, 33
FIGURES = 34

# --- constants of a probe ----------------------------------------------------------------------------------------
TRACKER, ARM, TABLE = 0, 12, 24  # frames in the world: origin, then rotation matrix
OFFSET = 36  # of the plate's top on what the table carries
RADIUS, NEAR, CLEARANCE, COSINE, PERIOD, SMOOTH, PLATE_LIMIT, PAD = 39, 40, 41, 42, 43, 44, 45, 46
CONSTANTS = 47

#: Gap [m] over which the arm takes over the normal force from a plate that is too low.
HAND_OVER = 1e-3
#: How fast the plate yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: How far below the finger a surface is looked for [m].
REACH = 0.2


@kernel
def follow(c: Floats, tracker: Floats, figures: Floats, first: bool) -> None:
    """Take the tracker's position as the HIP, and filter its velocity."""
    x, y, z = turned_out(c, TRACKER, tracker[0], tracker[1], tracker[2])
    place = (x + c[TRACKER], y + c[TRACKER + 1], z + c[TRACKER + 2])
    for i in range(3):
        if not first:
            rate = (place[i] - figures[HIP + i]) / c[PERIOD]
            figures[VELOCITY + i] += c[SMOOTH] * (rate - figures[VELOCITY + i])
        figures[HIP + i] = place[i]


@kernel
def _push(c: Floats, damping: Floats, figures: Floats, result: Floats) -> None:
    """Write the contact force: the spring's, with damping along the normal that may weaken it, but never pull.

    What the surface's effects put on top of that comes last; an attraction pulls without contact too.
    """
    primary = int(result[at.RESULT_PRIMARY])
    if primary < 0:
        for i in range(3):
            figures[FORCE + i] = 0.0
            figures[CONTACT_FORCE + i] = figures[EFFECT_FORCE + i]
        figures[PENETRATION] = figures[NORMAL_FORCE] = figures[AREA] = 0.0
        return
    spring, closing = 0.0, 0.0
    for i in range(3):
        n = result[at.RESULT_NORMAL + i]
        spring += result[at.RESULT_FORCE + i] * n
        closing += (figures[VELOCITY + i] - result[at.RESULT_SURFACE_VELOCITY + i]) * n
    push = max(0.0, spring - damping[primary] * closing)
    for i in range(3):
        n = result[at.RESULT_NORMAL + i]
        figures[NORMAL + i] = n
        figures[FORCE + i] = result[at.RESULT_FORCE + i]
        figures[CONTACT_FORCE + i] = result[at.RESULT_FORCE + i] + (push - spring) * n + figures[EFFECT_FORCE + i]
        figures[POINT + i] = result[at.RESULT_CONTACTS + at.CONTACT_POINT + i]
    figures[NORMAL_FORCE] = push
    figures[AREA] = min(c[PAD] * push ** (2.0 / 3.0), math.pi * c[RADIUS] ** 2)
    figures[PENETRATION] = result[at.RESULT_PENETRATION]


@kernel
def _approach(figures: Floats, result: Floats, poses: Floats, twists: Floats) -> None:
    """Write distance and time to the nearest object, by the speed relative to its surface."""
    figures[NEAR_DISTANCE] = figures[TIME_TO_CONTACT] = np.inf
    if result[at.RESULT_NEAREST] < 0.0:
        return
    obj, distance, speed = int(result[at.RESULT_NEAREST]), result[at.RESULT_DISTANCE], 0.0
    x = result[at.RESULT_NEAREST_POINT] - poses[obj, 0]
    y = result[at.RESULT_NEAREST_POINT + 1] - poses[obj, 1]
    z = result[at.RESULT_NEAREST_POINT + 2] - poses[obj, 2]
    spin = (
        twists[obj, 4] * z - twists[obj, 5] * y,
        twists[obj, 5] * x - twists[obj, 3] * z,
        twists[obj, 3] * y - twists[obj, 4] * x,
    )
    for i in range(3):
        rate = figures[VELOCITY + i] - twists[obj, i] - spin[i]
        speed -= rate * result[at.RESULT_NEAREST_NORMAL + i]
    figures[NEAR_DISTANCE] = distance
    if distance <= 0.0:
        figures[TIME_TO_CONTACT] = 0.0
    elif speed > 1e-6:
        figures[TIME_TO_CONTACT] = distance / speed


@kernel
def _yield(c: Floats, figures: Floats, pressed: float) -> float:
    """Give way while the plate presses harder than it may."""
    limit, given = c[PLATE_LIMIT], figures[PLATE_YIELD]
    if pressed > limit:
        given += YIELD_RATE * (pressed - limit) * c[PERIOD]
    elif pressed < 0.9 * limit:
        given = max(0.0, given - YIELD_RETURN * c[PERIOD])
    figures[PLATE_YIELD] = given
    return float(given)


@kernel
def _carry(
    c: Floats, world: Floats, mesh: Any, poses: Floats, table: Floats, load: float, figures: Floats, goal: Floats
) -> int:
    """Find the virtual surface under the finger and command the plate to it; return whose it is, -1 for nobody's."""
    lowest = figures[HIP + 2] - c[RADIUS]
    x, y, z = turned_out(c, TABLE, table[0] + c[OFFSET], table[1] + c[OFFSET + 1], table[2] + c[OFFSET + 2])
    top = z + c[TABLE + 2]
    height, below = -np.inf, -1
    if world.shape[0] > 0:
        down, normal = np.zeros(3), np.empty(3)
        down[2] = -1.0
        distance, hit = sphere_cast(world, mesh, poses, figures[HIP : HIP + 3], down, c[RADIUS], REACH, normal)
        if hit >= 0:
            height, below = lowest - distance, int(hit)
    figures[PLATE_TOP], figures[SURFACE_HEIGHT] = top, height
    figures[PLATE_GAP] = height - top if height > -np.inf else np.inf
    wanted = max(height, lowest - c[CLEARANCE]) - _yield(c, figures, abs(load))
    goal[0], goal[1], goal[2] = turned_in(
        c, TABLE, figures[HIP] - c[TABLE], figures[HIP + 1] - c[TABLE + 1], wanted - c[TABLE + 2]
    )
    for i in range(3):
        goal[i] -= c[OFFSET + i]
        goal[4 + i] = 0.0
    goal[3] = 1.0
    return below


@kernel
def touch(
    c: Floats, poses: Floats, twists: Floats, damping: Floats, figures: Floats, result: Floats
) -> tuple[int, int]:  # fmt: skip
    """Write the contact force of one probe, and how far the nearest object is.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    poses, twists
        Of the objects, shapes (n, 7) and (n, 6).
    damping
        Of the coupling with each object [N s/m], shape (n,).
    figures, result
        The probe's part of State, and what the contact search found.

    Returns
    -------
    tuple
        The object touched most and the nearest one; -1: none.
    """
    for i in range(3):
        figures[PROXY + i] = result[at.RESULT_PROXY + i]
    _push(c, damping, figures, result)
    _approach(figures, result, poses, twists)
    return int(result[at.RESULT_PRIMARY]), int(result[at.RESULT_NEAREST])


@kernel
def carry(
    c: Floats,
    world: Floats,
    mesh: Any,
    poses: Floats,
    table: Floats,
    sent: Floats,
    figures: Floats,
    goal: Floats,
    load: float,
    touching: bool,
) -> tuple[bool, int]:
    """Command a table to the surface below the finger.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    world, mesh, poses
        The objects; see ``itouch.contact``.
    table, sent
        Pose reading of the table, and the pose last sent to it, shape (7,).
    figures
        The probe's part of State.
    goal
        The table's command, shape (7,); written.
    load
        The table's reading of the force along its z axis [N].
    touching
        Whether the finger touches an object.

    Returns
    -------
    tuple
        Whether it renders the contact, and whose surface it is, -1 for nobody's.
    """
    below = _carry(c, world, mesh, poses, table, load, figures, goal)
    upright, square = 0.0, 0.0
    for i in range(3):
        upright += figures[NORMAL + i] * c[TABLE + 3 + 3 * i + 2]
        square += (sent[i] - table[i]) ** 2
    figures[TRACKING] = math.sqrt(square)
    return bool(touching and upright >= c[COSINE]), below


@kernel
def share(c: Floats, figures: Floats, wrench: Floats, plate: bool) -> None:
    """Command the arm's part of the force.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    figures
        The probe's part of State.
    wrench
        The arm's command, shape (6,); its force is written.
    plate
        Whether a plate renders the contact: then the arm gives the normal part only across a gap.
    """
    keep = 1.0
    if plate:
        keep = min(1.0, max(0.0, figures[PLATE_GAP] / HAND_OVER))
    along = 0.0
    for i in range(3):
        along += figures[CONTACT_FORCE + i] * figures[NORMAL + i]
    along *= 1.0 - keep
    wrench[0], wrench[1], wrench[2] = turned_in(
        c, ARM,
        figures[CONTACT_FORCE] - along * figures[NORMAL],
        figures[CONTACT_FORCE + 1] - along * figures[NORMAL + 1],
        figures[CONTACT_FORCE + 2] - along * figures[NORMAL + 2],
    )  # fmt: skip
