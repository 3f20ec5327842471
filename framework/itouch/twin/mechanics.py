"""One step of the finger between hand, arm and plate, and the minimum-jerk law of the hand's target, compiled.

Minimum-jerk movements: Flash and Hogan 1985.
The finger is a point mass on the hand's spring; the plate pushes it through the pad's spring and damper.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.blocks import Block, places, width
from itouch.compiling import kernel, linked, scratch
from itouch.twin.frame_rotation import FRAME, beside, turned_in, turned_out
from itouch.world import state_fields

Floats = NDArray[np.float64]

# Places of the constants: frames as origin and rotation matrix, then numbers.
_constants = Block()
# The extent is that of the plate along its own axes; its heading is the direction of its x axis in its carrier's frame.
ARM, TABLE, OFFSET, EXTENT, HEADING = _constants.parts(FRAME, FRAME, 3, 2, 2)
RADIUS, PAD_STIFFNESS, PAD_DAMPING, MASS, STIFFNESS, DAMPING, PERIOD = _constants.parts(1, 1, 1, 1, 1, 1, 1)
CONSTANTS = _constants.width

# Places of the finger's motion, which are State fields in this order.
_motion = Block()
PLACE, SPEED, TARGET = _motion.parts(3, 3, 3)

# Places of the plate's figures, which follow from the State fields.
_at = places(state_fields.PLATE)
FORCE, TOP = _at["plate_force"], _at["plate_true_top"]
DISTANCE, TOTAL = _at["plate_distance"], _at["total_force"]
FIGURES = width(state_fields.PLATE)

#: Least gap [m] of a finger beside the plate, and the gap [m] from which on the plate's speed is ignored.
BESIDE, FAR = 1e-3, 0.5


class AlongPath(NamedTuple):
    """A hand on its path.

    ``moving`` (whether scripts run), ``steered``, ``ticks`` along the path, ``time`` on it [s] and ``stage`` of a
    touch-off have shape (1,); ``offset`` from the path has shape (3,) [m]; ``period`` [s].  While scripts are paused
    the hand rests; once the touch-off is ``done`` it returns to its path, by ``back`` [m] per tick.
    """

    moving: Any
    steered: Any
    ticks: Any
    time: Floats
    period: float
    offset: Floats
    back: float
    stage: Any
    done: int


class Led(NamedTuple):
    """The finger's twin and the hand that leads it.

    The hand's path, as pieces (n, 8), its offset from it, shape (3,) [m], and position [m], velocity [m/s] and target
    [m] of the finger, shape (9,), world frame; these are updated.
    """

    pieces: Floats
    offset: Floats
    motion: Floats


class Pushes(NamedTuple):
    """Forces on the finger.

    That of the arm in the arm's frame, shape (3,) [N]; those of the arms and plates of other probes on the same finger,
    world frame, shape (n, 3) [N]; that of this arm and this plate, world frame, shape (3,) [N], which is written.
    """

    push: Floats
    others: Floats
    given: Floats


class Touched(NamedTuple):
    """The arm and the plate that the finger touches.

    Position of the plate's carrier in the table's frame, shape (3,) [m]; the figures of the plate, shape (FIGURES,),
    which are written, as are the finger's pose and twist in the arm's frame, shapes (7,) and (6,), of which position
    and velocity, and the force of the finger on the table, in the table's frame, shape (3,) [N].
    """

    table: Floats
    figures: Floats
    end: Floats
    pace: Floats
    load: Floats


@linked
def plate_force(constants: Floats, finger: Floats, table: Floats, figures: Floats) -> float:
    """Write force, top and distance of the plate below a finger (3,) [m]; return the gap between them [m]."""
    px, py, pz = table[0] + constants[OFFSET], table[1] + constants[OFFSET + 1], table[2] + constants[OFFSET + 2]
    _, _, up = turned_out(constants, TABLE, px, py, pz)
    figures[TOP] = constants[TABLE + 2] + up + beside(constants[RADIUS], constants[TABLE + 11])
    x, y, z = turned_in(
        constants, TABLE, finger[0] - constants[TABLE], finger[1] - constants[TABLE + 1],
        finger[2] - constants[TABLE + 2],
    )  # fmt: skip
    gap = float(z - pz - constants[RADIUS])
    along, across, cosine, sine = x - px, y - py, constants[HEADING], constants[HEADING + 1]
    outside = abs(cosine * along + sine * across) > constants[EXTENT]
    if outside or abs(cosine * across - sine * along) > constants[EXTENT + 1]:
        gap = max(gap, BESIDE)
    rate = (gap - figures[DISTANCE]) / constants[PERIOD] if figures[DISTANCE] < FAR else 0.0
    figures[DISTANCE] = gap
    push = -constants[PAD_STIFFNESS] * gap - constants[PAD_DAMPING] * rate
    figures[FORCE] = max(0.0, push) if gap < 0.0 else 0.0
    return gap


@linked
def aim(pieces: Floats, time: float, goal: Floats) -> None:
    """Write position [m] and velocity [m/s] of the hand's target at a time [s] to ``goal``, shape (6,).

    ``pieces``, shape (n, 8), has a row for each minimum-jerk movement: begin and duration [s], from and to [m].
    """
    last = 0
    while last + 1 < pieces.shape[0] and pieces[last + 1, 0] <= time:
        last += 1
    s = min(1.0, (time - pieces[last, 0]) / pieces[last, 1])
    blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / pieces[last, 1]
    for i in range(3):
        here, there = pieces[last, 2 + i], pieces[last, 5 + i]
        goal[i] = here + blend * (there - here) if s < 1.0 else there
        goal[3 + i] = rate * (there - here)


@kernel
def lower(offset: Floats, towards: float, step: float) -> None:
    """Move a hand's target towards a height above or below its path [m], by ``step`` [m] at most; offset (3,) [m]."""
    now = offset[2]
    if now != towards:
        offset[2] = now + max(-step, min(step, towards - now))


@kernel
def follow_path(path: AlongPath) -> int:
    """Advance along a hand's path by one tick; if the hand is steered, return 1 and leave it to Python."""
    if path.steered[0] != 0:
        return 1
    if path.moving[0] != 0:
        path.ticks[0] += 1
    elif path.stage[0] == path.done:
        lower(path.offset, 0.0, path.back)
    path.time[0] = path.ticks[0] * path.period
    return 0


@kernel
def couple_finger(
    constants: Floats, led: Led, pushes: Pushes, arm: Touched, time: Floats, hip: Floats, tick: Any, touched: Any,
    face: Floats,
) -> int:  # fmt: skip
    """Advance the finger by one period, and write what touches the plate; return 0.

    The named tuples are unpacked here, because passing a tuple of many arrays on is costly.

    Parameters
    ----------
    constants
        Shape (CONSTANTS,); with a mass of 0 the finger is not moved here (it is a real one).
    time
        The target's time on the path [s], shape (1,).
    hip
        Position [m] of a finger that is not moved here, shape (3,).
    tick, touched
        The tick, and the one in which the present touch of the plate began (-1: no touch), shape (1,).
    face
        Force on the plate [N] and gap between plate and finger pad before the step [m], shape (2,); written.
    """
    hand, push, figures, load = led.motion, pushes.push, arm.figures, arm.load
    given, others = pushes.given, pushes.others
    mass, period = constants[MASS], constants[PERIOD]
    if mass == 0.0:
        hand[0], hand[1], hand[2] = hip[0], hip[1], hip[2]
    gap = plate_force(constants, hand, arm.table, figures)
    ax, ay, az = turned_out(constants, ARM, push[0], push[1], push[2])
    nx, ny, nz = turned_out(constants, TABLE, 0.0, 0.0, figures[FORCE])
    given[0], given[1], given[2] = fx, fy, fz = ax + nx, ay + ny, az + nz
    for i in range(others.shape[0]):
        fx, fy, fz = fx + others[i, 0], fy + others[i, 1], fz + others[i, 2]
    figures[TOTAL] = math.sqrt(fx * fx + fy * fy + fz * fz)
    load[0], load[1], load[2] = 0.0, 0.0, -figures[FORCE]
    if mass > 0.0:
        goal = scratch(6)
        aim(led.pieces, time[0], goal)
        for i, force in enumerate((fx, fy, fz)):
            goal[i] += led.offset[i]
            spring = constants[STIFFNESS] * (goal[i] - hand[i])
            spring += constants[DAMPING] * (goal[SPEED + i] - hand[SPEED + i])
            hand[SPEED + i] += period * (spring + force) / mass
            hand[i] += period * hand[SPEED + i]
            hand[TARGET + i] = goal[i]
    tell_arm(constants, hand, arm.end, arm.pace)
    if figures[FORCE] <= 0.0:
        touched[0] = -1
    elif touched[0] < 0:
        touched[0] = tick[0]
    face[0], face[1] = figures[FORCE], gap
    return 0


@kernel
def tell_arm(constants: Floats, hand: Floats, end: Floats, pace: Floats) -> None:
    """Write the finger's position and velocity in the arm's frame.

    ``constants`` (CONSTANTS,) contain the arm's frame; ``hand`` begins with position [m] and velocity [m/s] in the
    world; the first three numbers of ``end`` and of ``pace`` are written.
    """
    end[0], end[1], end[2] = turned_in(
        constants, ARM, hand[0] - constants[ARM], hand[1] - constants[ARM + 1], hand[2] - constants[ARM + 2]
    )
    pace[0], pace[1], pace[2] = turned_in(constants, ARM, hand[SPEED], hand[SPEED + 1], hand[SPEED + 2])
