"""A probe's HIP and velocity, contact force with damping, and contact area by Hertz's law, compiled.

``follow`` turns the tracker's reading into the HIP, ``itouch.contact.step`` finds the proxy, ``touch`` computes the
contact force from it.  (They are separate kernels because a caller compiles again all that it calls.)

The proxy's spring force comes from the contact engine; damping is added here, where time is known.  What a carried
plate renders of the force, and what is left for the arm, is decided in ``itouch.loop.surface``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.blocks import Block, places, width
from itouch.compiling import kernel, linked
from itouch.contact import layout as at
from itouch.twin.frame_rotation import FRAME, turned_out
from itouch.world import state_fields

Floats = NDArray[np.float64]

# --- figures of a probe: their places follow from the State fields -----------------------------------------------
_at = places(state_fields.FIGURES)
HIP, VELOCITY, PROXY = _at["hip"], _at["velocity"], _at["proxy"]
FORCE, NORMAL, POINT = _at["force"], _at["normal"], _at["point"]
PENETRATION, NORMAL_FORCE = _at["penetration"], _at["normal_force"]
NEAR_DISTANCE, TIME_TO_CONTACT = _at["near_distance"], _at["time_to_contact"]
CONTACT_FORCE, EFFECT_FORCE, AREA = _at["contact_force"], _at["effect_force"], _at["area"]
PLATE_GAP, SURFACE_HEIGHT, PLATE_YIELD = _at["plate_gap"], _at["surface_height"], _at["plate_yield"]
PLATE_TOP, TRACKING = _at["plate_top"], _at["tracking"]
FIGURES = width(state_fields.FIGURES)

# --- constants of a probe ----------------------------------------------------------------------------------------
_constants = Block()
TRACKER, ARM, TABLE = _constants.parts(FRAME, FRAME, FRAME)  # frames in the world
OFFSET = _constants.part(3)  # of the plate's top from the point whose pose the table reads
RADIUS, NEAR, CLEARANCE, PERIOD, SMOOTH, PLATE_LIMIT, PAD = _constants.parts(1, 1, 1, 1, 1, 1, 1)
FORCE_LIMIT, PAD_STIFFNESS = _constants.parts(1, 1)  # greatest force on the finger [N]; stiffness of its pad [N/m]
HAS_LOAD, HAS_TABLE = _constants.parts(1, 1)  # whether a table reads the force on it; whether there is one
PLATE_COSINE = _constants.part()  # of the steepest slope that a plate renders [1]
CONSTANTS = _constants.width


@kernel
def size(vector: Floats) -> float:
    """Return the length of a vector (3,), in its unit."""
    return float(math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]))


@kernel
def follow(c: Floats, tracker: Floats, figures: Floats, afresh: Any, tick: Any) -> int:
    """Take the tracker's position as the HIP, and filter its velocity, which stays as it is in the first tick.

    ``c`` (CONSTANTS,) and ``figures`` (FIGURES,) as above; ``tracker`` (7,) [m; quaternion], of which only the
    position is read; ``tick`` (1,): the number of this tick; ``afresh`` (1,): whether the velocity stays as it is this
    once, set to 0.
    """
    first = tick[0] == 0 or afresh[0] != 0
    afresh[0] = 0
    x, y, z = turned_out(c, TRACKER, tracker[0], tracker[1], tracker[2])
    place = (x + c[TRACKER], y + c[TRACKER + 1], z + c[TRACKER + 2])
    for i in range(3):
        if not first:
            rate = (place[i] - figures[HIP + i]) / c[PERIOD]
            figures[VELOCITY + i] += c[SMOOTH] * (rate - figures[VELOCITY + i])
        figures[HIP + i] = place[i]
    return 0


@linked
def _spin(poses: Floats, twists: Floats, obj: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Velocity that an object's rotation gives its point at ``x``, ``y``, ``z`` [m], in [m/s].

    ``poses`` (objects, 7) [m; quaternion], ``twists`` (objects, 6) [m/s, rad/s].
    """
    x, y, z = x - poses[obj, 0], y - poses[obj, 1], z - poses[obj, 2]
    return (
        twists[obj, 4] * z - twists[obj, 5] * y,
        twists[obj, 5] * x - twists[obj, 3] * z,
        twists[obj, 3] * y - twists[obj, 4] * x,
    )


@linked
def _damped(damping: Floats, poses: Floats, twists: Floats, figures: Floats, result: Floats, row: int) -> float:
    """Return what the object of a contact would take from the force if it bore all of it [N].

    ``damping`` (objects,) [N s/m]; ``poses`` and ``twists`` (objects, 7 and 6); ``figures`` (FIGURES,) and ``result``
    (RESULT_SIZE,), where the contact begins at ``row``.
    """
    obj, place, closing = int(result[row + at.CONTACT_OBJECT]), row + at.CONTACT_POINT, 0.0
    spin = _spin(poses, twists, obj, result[place], result[place + 1], result[place + 2])
    for i in range(3):
        closing += (figures[VELOCITY + i] - twists[obj, i] - spin[i]) * result[at.RESULT_NORMAL + i]
    return float(damping[obj] * closing)


@linked
def _push(c: Floats, poses: Floats, twists: Floats, damping: Floats, figures: Floats, result: Floats) -> None:
    """Write the contact force: the spring's, with damping along the normal, which may weaken it but never make it pull.

    Where several objects bear the force, each damps it by its share: with the damping of the one that bears most the
    force would step where two change places, and be the file's order's where both bear the same.

    The force of the surface's effects is added last; an attraction may pull, also without contact.
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
    drag = damping[primary] * closing
    for row in range(
        at.RESULT_CONTACTS + at.CONTACT_WIDTH,
        at.RESULT_CONTACTS + int(result[at.RESULT_COUNT]) * at.CONTACT_WIDTH,
        at.CONTACT_WIDTH,
    ):
        if result[row + at.CONTACT_OBJECT] != primary:  # the same object is damped alike
            other = _damped(damping, poses, twists, figures, result, row)
            drag += result[row + at.CONTACT_SHARE] * (other - damping[primary] * closing)
    push = max(0.0, spring - drag)
    for i in range(3):
        n = result[at.RESULT_NORMAL + i]
        figures[NORMAL + i] = n
        figures[FORCE + i] = result[at.RESULT_FORCE + i]
        figures[CONTACT_FORCE + i] = result[at.RESULT_FORCE + i] + (push - spring) * n + figures[EFFECT_FORCE + i]
        figures[POINT + i] = result[at.RESULT_CONTACTS + at.CONTACT_POINT + i]
    figures[NORMAL_FORCE] = push
    figures[AREA] = min(c[PAD] * push ** (2.0 / 3.0), math.pi * c[RADIUS] ** 2)
    figures[PENETRATION] = result[at.RESULT_PENETRATION]


@linked
def _approach(figures: Floats, result: Floats, poses: Floats, twists: Floats) -> None:
    """Write the distance to the nearest object, and the time to contact by the speed relative to its surface."""
    figures[NEAR_DISTANCE] = figures[TIME_TO_CONTACT] = np.inf
    if result[at.RESULT_NEAREST] < 0.0:
        return
    obj, distance, speed = int(result[at.RESULT_NEAREST]), result[at.RESULT_DISTANCE], 0.0
    place = at.RESULT_NEAREST_POINT
    spin = _spin(poses, twists, obj, result[place], result[place + 1], result[place + 2])
    for i in range(3):
        rate = figures[VELOCITY + i] - twists[obj, i] - spin[i]
        speed -= rate * result[at.RESULT_NEAREST_NORMAL + i]
    figures[NEAR_DISTANCE] = distance
    if distance <= 0.0:
        figures[TIME_TO_CONTACT] = 0.0
    elif speed > 1e-6:
        figures[TIME_TO_CONTACT] = distance / speed


@kernel
def touch(
    c: Floats, poses: Floats, twists: Floats, damping: Floats, figures: Floats, result: Floats, primary: Any,
    nearest: Any,
) -> int:  # fmt: skip
    """Write the contact force of one probe, and how far the nearest object is.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    poses, twists
        Of the objects, shapes (n, 7) [m; quaternion] and (n, 6) [m/s, rad/s].
    damping
        Of the coupling with each object [N s/m], shape (n,).
    figures, result
        The probe's part of State, and what the contact search found, shapes (FIGURES,) and (RESULT_SIZE,).
    primary, nearest
        Written: indices of the object touched most and of the nearest one, shape (1,) each; -1: none.
    """
    for i in range(3):
        figures[PROXY + i] = result[at.RESULT_PROXY + i]
    _push(c, poses, twists, damping, figures, result)
    _approach(figures, result, poses, twists)
    primary[0], nearest[0] = int(result[at.RESULT_PRIMARY]), int(result[at.RESULT_NEAREST])
    return 0
