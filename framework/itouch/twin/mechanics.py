"""One step of the finger's equation of motion between hand, arm and plate, compiled.

The finger is a point mass on the hand's spring; the plate pushes it through the pad's spring and damper.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.twin.frame_rotation import beside, turned_in, turned_out

Floats = NDArray[np.float64]

# The constants: frames as origin and rotation matrix, then numbers.
ARM, TABLE, OFFSET, EXTENT = 0, 12, 24, 27
RADIUS, PAD_STIFFNESS, PAD_DAMPING, MASS, STIFFNESS, DAMPING, PERIOD = 29, 30, 31, 32, 33, 34, 35
CONSTANTS = 36

# The figures of the plate: State fields in this order.
FORCE, TOP, DISTANCE, TOTAL = 0, 1, 2, 3
FIGURES = 4

#: A gap [m] that stands for "beside the plate", and one above which the plate's speed does not matter.
BESIDE, FAR = 1e-3, 0.5


@kernel
def plate_force(constants: Floats, finger: Floats, table: Floats, figures: Floats) -> float:
    """Write force, top and distance of the plate under a finger (3,); return the gap between them [m]."""
    px, py, pz = table[0] + constants[OFFSET], table[1] + constants[OFFSET + 1], table[2] + constants[OFFSET + 2]
    _, _, up = turned_out(constants, TABLE, px, py, pz)
    figures[TOP] = constants[TABLE + 2] + up + beside(constants[RADIUS], constants[TABLE + 11])
    x, y, z = turned_in(
        constants, TABLE, finger[0] - constants[TABLE], finger[1] - constants[TABLE + 1],
        finger[2] - constants[TABLE + 2],
    )  # fmt: skip
    gap = float(z - pz - constants[RADIUS])
    if abs(x - px) > constants[EXTENT] or abs(y - py) > constants[EXTENT + 1]:
        gap = max(gap, BESIDE)
    rate = (gap - figures[DISTANCE]) / constants[PERIOD] if figures[DISTANCE] < FAR else 0.0
    figures[DISTANCE] = gap
    push = -constants[PAD_STIFFNESS] * gap - constants[PAD_DAMPING] * rate
    figures[FORCE] = max(0.0, push) if gap < 0.0 else 0.0
    return gap


@kernel
def aim(pieces: Floats, time: float, goal: Floats) -> None:
    """Write the place and velocity of the hand's target at a time [s], shape (6,).

    ``pieces`` has a row for each movement of minimum jerk: begin and duration [s], from and to [m], shape (n, 8).
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
def follow_path(
    moving: Any, steered: Any, ticks: Any, time: Floats, period: float, offset: Floats, back: float, stage: Any,
    done: int,
) -> int:  # fmt: skip
    """Move on along a hand's path by one tick; return 1, and leave it to Python, if it is led.

    All but the numbers have shape (1,): whether scripts go on, whether the hand is led, the ticks along the path, the
    time on it [s], and the stage of a touch-off.  While scripts wait the hand rests; a touch-off that is ``done`` lets
    it go back to its path, by ``back`` [m] a tick: ``offset`` (3,) [m], ``period`` [s].
    """
    if steered[0] != 0:
        return 1
    if moving[0] != 0:
        ticks[0] += 1
    elif stage[0] == done:
        lower(offset, 0.0, back)
    time[0] = ticks[0] * period
    return 0


@kernel
def couple_finger(
    constants: Floats,
    pieces: Floats,
    time: Floats,
    offset: Floats,
    hand: Floats,
    hip: Floats,
    push: Floats,
    table: Floats,
    figures: Floats,
    end: Floats,
    pace: Floats,
    load: Floats,
    tick: Any,
    touched: Any,
    face: Floats,
    others: Floats,
    given: Floats,
) -> int:
    """Advance the finger by one period, and tell what touches it; return 0.

    Parameters
    ----------
    constants, pieces, offset, hand, push, table, figures, end, pace, load, others, given
        As in ``step_finger``.
    time
        Where on the path the target is [s], shape (1,).
    hip
        Where a finger that is not moved here is, shape (3,).
    given
        The plate's force on the finger, world frame, shape (3,); written.
    tick, touched
        The tick, and that at which the plate was touched first (-1: it is not), shape (1,).
    face
        Force on the plate [N] and gap [m], shape (2,); written.
    """
    if constants[MASS] == 0.0:
        hand[0], hand[1], hand[2] = hip[0], hip[1], hip[2]
    gap = step_finger(constants, pieces, time[0], offset, hand, push, table, figures, end, pace, load, others, given)
    if figures[FORCE] <= 0.0:
        touched[0] = -1
    elif touched[0] < 0:
        touched[0] = tick[0]
    face[0], face[1] = figures[FORCE], gap
    return 0


@kernel
def step_finger(
    constants: Floats,
    pieces: Floats,
    time: float,
    offset: Floats,
    hand: Floats,
    push: Floats,
    table: Floats,
    figures: Floats,
    end: Floats,
    pace: Floats,
    load: Floats,
    others: Floats,
    given: Floats,
) -> float:
    """Advance the finger by one period.

    Parameters
    ----------
    constants
        Shape (CONSTANTS,); a mass of 0 leaves the finger where it is (it is a real one).
    pieces, time, offset
        The hand's path, where on it the target is [s], and how far it is led away from it, shape (3,) [m].
    hand
        Position, velocity and target of the finger, shape (9,), world frame; changed.
    push
        The arm's force on the finger in the arm's frame, shape (3,).
    table
        Where the plate's carrier is, in the table's frame, shape (3,).
    figures
        Of the plate, shape (FIGURES,); written.
    end, pace
        The finger's pose and twist in the arm's frame, shapes (7,) and (6,); position and velocity are written.
    load
        The plate's force on the table in the table's frame, shape (3,); written.
    others
        What the arms and plates of other probes push the same finger with, world frame, shape (n, 3).
    given
        What this arm and this plate push it with, world frame, shape (3,); written.

    Returns
    -------
    float
        The gap between plate and finger pad before the step [m].
    """
    gap = plate_force(constants, hand, table, figures)
    ax, ay, az = turned_out(constants, ARM, push[0], push[1], push[2])
    nx, ny, nz = turned_out(constants, TABLE, 0.0, 0.0, figures[FORCE])
    given[0], given[1], given[2] = fx, fy, fz = ax + nx, ay + ny, az + nz
    for i in range(others.shape[0]):
        fx, fy, fz = fx + others[i, 0], fy + others[i, 1], fz + others[i, 2]
    figures[TOTAL] = math.sqrt(fx * fx + fy * fy + fz * fz)
    load[0], load[1], load[2] = 0.0, 0.0, -figures[FORCE]
    mass, period = constants[MASS], constants[PERIOD]
    if mass > 0.0:
        goal = np.empty(6)
        aim(pieces, time, goal)
        for i, force in enumerate((fx, fy, fz)):
            goal[i] += offset[i]
            spring = constants[STIFFNESS] * (goal[i] - hand[i]) + constants[DAMPING] * (goal[3 + i] - hand[3 + i])
            hand[3 + i] += period * (spring + force) / mass
            hand[i] += period * hand[3 + i]
            hand[6 + i] = goal[i]
    tell_arm(constants, hand, end, pace)
    return gap


@kernel
def tell_arm(constants: Floats, hand: Floats, end: Floats, pace: Floats) -> None:
    """Write the finger's position and velocity in the arm's frame.

    ``constants`` as above, with the arm's frame; ``hand`` (6,) place [m] and velocity [m/s] in the world; ``end``
    and ``pace`` (3,) are written.
    """
    end[0], end[1], end[2] = turned_in(
        constants, ARM, hand[0] - constants[ARM], hand[1] - constants[ARM + 1], hand[2] - constants[ARM + 2]
    )
    pace[0], pace[1], pace[2] = turned_in(constants, ARM, hand[3], hand[4], hand[5])
