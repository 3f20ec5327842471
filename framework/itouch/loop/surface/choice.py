"""Who renders a contact: the plate what is not too steep for it, and only where it is felt as its height says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.loop.render import BACK, COSINE, EARLY_FAR, HAS_LOAD, HIP, PAD_STIFFNESS, PERIOD, PLATE_TOP, RADIUS
from itouch.loop.surface.memory import (
    CHANGING,
    FREE,
    HIGH,
    LOW,
    MISSED,
    MISSED_AT,
    MISSED_DEPTH,
    MISSED_LOAD,
    MISSES,
    PRESSED,
    RENDERS,
    SETTLED,
    UNFELT,
    WITHDRAWN,
)

Floats = NDArray[np.float64]

#: After a change of hands the force is led over for so long at least [s].
LED = 0.3
#: A plate is missed where the finger seems to press it in deeper than the force explains by so much [m], at less than
#: so much of the force that the pad would give, for so long [s]; what is missed is tried again after so long apart [s].
MISS_DEPTH, MISS_PART, MISS_TIME, TRY_AGAIN = 1e-3, 0.4, 0.04, 0.02
#: A plate is too high that presses with so much [N] while it seems so far below the finger [m], for so long [s].
#: Further below than the constant EARLY_FAR the sensor is wrong (T8).
EARLY_FORCE, EARLY_GAP, EARLY_TIME = 0.1, 1e-3, 0.010
#: Where it hovers, further than this below the finger [m], what a real axis reads in the air (friction, its mass) is
#: no finger: the force by which a sensor would be doubted there [N], for half as long [s].
HOVER_GAP, HOVER_FORCE, HOVER_TIME = 4e-3, 0.5, 0.05


@kernel
def choose(c: Floats, memory: Floats, upright: float, touching: bool) -> None:
    """Say whose the contact is; one that has begun changes over only when it is well on the other side.

    ``upright`` is the cosine of the angle between the surface and the plate.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``upright`` has no unit [1].
    """
    before = memory[RENDERS]
    if touching:
        memory[FREE] = 0.0
        if upright < c[COSINE]:
            memory[RENDERS] = 0.0
        elif upright >= c[BACK]:
            memory[RENDERS] = 1.0
    else:
        memory[RENDERS] = 1.0 if upright >= c[COSINE] else 0.0
        memory[FREE] += c[PERIOD]
        if memory[FREE] > TRY_AGAIN and memory[MISSED] == LOW:
            memory[MISSED] = 0.0
    if memory[MISSED] > 0.0:
        memory[RENDERS] = 0.0
    if touching and memory[PRESSED] > 0.0 and memory[RENDERS] != before:
        memory[CHANGING] = LED


@kernel
def doubt(c: Floats, figures: Floats, memory: Floats, pressed: float, touching: bool, time: float) -> None:
    """Find that the plate is not where its height says: it is not felt where it should be, or the other way round.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    figures, memory
        The probe's part of State, and that of the carried surface.
    pressed
        What the table reads of the force on it [N].
    touching, time
        Whether there is a virtual contact, and the time of the tick [s].
    """
    depth = figures[PLATE_TOP] - (figures[HIP + 2] - c[RADIUS])
    if c[HAS_LOAD] == 0.0 or memory[MISSED] > 0.0:
        return
    hovers = depth < -HOVER_GAP
    if pressed > (HOVER_FORCE if hovers else EARLY_FORCE) and -c[EARLY_FAR] < depth < -EARLY_GAP:
        _count(c, memory, HIGH, HOVER_TIME if hovers else EARLY_TIME, depth, pressed, touching, time)
        return
    stiffness = c[PAD_STIFFNESS]
    there = touching and memory[RENDERS] > 0.0 and memory[SETTLED] > 0.0
    if there and depth - pressed / stiffness > MISS_DEPTH and pressed < MISS_PART * stiffness * depth:
        _count(c, memory, LOW, MISS_TIME, depth, pressed, touching, time)
        return
    memory[UNFELT] = 0.0


@kernel
def _miss(memory: Floats, what: float, depth: float, pressed: float, touching: bool, time: float) -> None:
    """Leave the contact to the arm: the surface is not where its height says."""
    if memory[MISSES] == 0.0:
        memory[MISSED_AT], memory[MISSED_DEPTH], memory[MISSED_LOAD] = time, depth, pressed
    memory[MISSES] += 1.0
    memory[MISSED], memory[RENDERS], memory[UNFELT] = what, 0.0, 0.0
    if touching:
        memory[CHANGING] = LED


@kernel
def _count(
    c: Floats, memory: Floats, what: float, patience: float, depth: float, pressed: float, touching: bool, time: float
) -> None:
    """Wait whether a plate stays where it should not be; then its force is the arm's."""
    memory[UNFELT] += c[PERIOD]
    if memory[UNFELT] >= patience:
        _miss(memory, what, depth, pressed, touching, time)


@kernel
def take_over_missed(
    c: Floats, figures: Floats, memory: Floats, said: float, pressed: float, touching: bool, time: float
) -> None:
    """Remember why a surface that somebody else carries renders no more, as that says it; T4 has the last word.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    figures, memory
        The probe's part of State, and that of the carried surface.
    said
        LOW, HIGH, or 0: nothing is wrong.
    pressed
        What the table reads of the force on it [N].
    touching, time
        Whether there is a virtual contact, and the time of the tick [s].
    """
    if memory[MISSED] == WITHDRAWN:
        return
    why = HIGH if said >= HIGH else LOW if said > 0.0 else 0.0
    if why > 0.0 and memory[MISSED] == 0.0:
        _miss(memory, why, figures[PLATE_TOP] - (figures[HIP + 2] - c[RADIUS]), pressed, touching, time)
    memory[MISSED] = why
