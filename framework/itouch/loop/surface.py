"""The carried surface of one probe in a tick, compiled: where its plate goes, what it renders, and what the arm adds.

With s the height at which the finger would rest on the highest virtual surface below it, f the lowest point of the
probe and c the clearance, the plate's top goes to max(s, f - c); x and y follow the finger.  It renders contacts whose
normal is near its own.  From others it withdraws to f - c and touches nothing: they are the arm's alone.  Which of the
two it is may change while the contact lasts.  Then the plate is let down, or brought up, slowly while it may be felt,
and the arm's part of the normal force follows in small steps, never more than what the finger does not feel already.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.contact.cast import sphere_cast
from itouch.loop.render import (
    ARM,
    BACK,
    CLEARANCE,
    CONTACT_FORCE,
    COSINE,
    FORCE_LIMIT,
    HAS_LOAD,
    HAS_TABLE,
    HIP,
    NORMAL,
    NORMAL_FORCE,
    OFFSET,
    PAD_STIFFNESS,
    PERIOD,
    PLATE_GAP,
    PLATE_LIMIT,
    PLATE_TOP,
    PLATE_YIELD,
    RADIUS,
    SURFACE_HEIGHT,
    TABLE,
    TRACKING,
)
from itouch.twin.turning import turned_in, turned_out

Floats = NDArray[np.float64]

# --- memory of a carried surface: State fields in this order ------------------------------------------------------
RENDERS = 0  # 1: the plate's to render, 0: the arm's alone
PRESENT = 1  # 1: the plate is there, or still felt: what touches the finger is the plate
DROP = 2  # how far below the virtual surface the plate is kept [m]
SHARE = 3  # the arm's part of the normal force; -1: no contact
PRESSED, FREE = 4, 5  # how long the virtual contact has lasted, and how long there has been none [s]
FELT, FELT_WEIGHT, FELT_FORCE = 6, 7, 8  # felt since the begin; weight of the measured force; their blend [N]
UNFELT, MISSED = 9, 10  # how long the plate should have been felt and was not [s]; 1: so its force is the arm's
MISSES, MISSED_AT, MISSED_DEPTH, MISSED_LOAD = 11, 12, 13, 14  # how often; the first: when [s], how deep [m], load [N]
CUT = 15  # the part of the arm's force that is held back because of the plate's
MEMORY = 16

#: Gap [m] over which the arm takes over the normal force from a plate that is too low.
HAND_OVER = 1e-3
#: Greatest change a tick [N] of the normal force that the arm takes over or gives back.
HAND_STEP = 0.03
#: How fast a plate leaves a finger or comes to it in a contact, while it may be felt and while it is clear [m/s].
SOFTLY, QUICKLY = 0.015, 0.1
#: How near below the finger a plate may be felt soon [m].
SOON = 1.5e-3
#: A plate that is further behind its command than this is waited for, so that it does not come in a hurry [m].
BEHIND = 2e-4
#: A plate that is so near below the finger as it comes is as good as there [m].
ABOUT = 3e-4
#: How fast the plate yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: What the force of arm and plate stays below the scene's limit, because the reading of one is late [N].
SPARE = 0.06
#: Part of the force that a scene allows at which the plate gives way at once, and how far a pad is in it then [m].
ALLOWED, THIN = 0.9, 2e-4
#: How far below the finger a surface is looked for [m].
REACH = 0.2
#: Force [N] from which on a plate is felt, below which it is left, and what a sensor may read of nothing.
TOUCH, LEFT, NOTHING = 0.05, 0.02, 0.02
#: How long [s] the virtual force stands for one that is not felt yet, and in which time it is blended into the other.
WAIT, BLEND = 0.080, 0.020
#: Least force [N] that a contact is said to be felt with.
LEAST = 1e-3
#: A plate is missed where the finger seems to press it in deeper than the force explains by so much [m], at less than
#: so much of the force that the pad would give, for so long [s]; what is missed is tried again after so long apart [s].
MISS_DEPTH, MISS_PART, MISS_TIME, TRY_AGAIN = 1e-3, 0.4, 0.04, 0.02


@kernel
def _along_plate(c: Floats, normal: Floats) -> float:
    """Return the cosine of the angle between a normal (3,) in the world and the plate's."""
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * c[TABLE + 3 + 3 * i + 2]
    return cosine


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
def _choose(c: Floats, memory: Floats, upright: float, touching: bool) -> None:
    """Say whose the contact is; one that has begun changes over only when it is well on the other side."""
    if touching:
        memory[FREE] = 0.0
        if upright < c[COSINE]:
            memory[RENDERS] = 0.0
        elif upright >= c[BACK]:
            memory[RENDERS] = 1.0
    else:
        memory[RENDERS] = 1.0 if upright >= c[COSINE] else 0.0
        memory[FREE] += c[PERIOD]
        if memory[FREE] > TRY_AGAIN:
            memory[MISSED] = 0.0
    if memory[MISSED] > 0.0:
        memory[RENDERS] = 0.0


@kernel
def _miss(c: Floats, figures: Floats, memory: Floats, pressed: float, touching: bool, time: float) -> None:
    """Find that the plate is not where its height says: the finger should press on it, and does not."""
    depth = figures[PLATE_TOP] - (figures[HIP + 2] - c[RADIUS])
    stiffness = c[PAD_STIFFNESS]
    there = touching and memory[RENDERS] > 0.0 and memory[DROP] == 0.0 and c[HAS_LOAD] > 0.0
    if not there or depth - pressed / stiffness < MISS_DEPTH or pressed > MISS_PART * stiffness * depth:
        memory[UNFELT] = 0.0
        return
    memory[UNFELT] += c[PERIOD]
    if memory[UNFELT] < MISS_TIME:
        return
    if memory[MISSES] == 0.0:
        memory[MISSED_AT], memory[MISSED_DEPTH], memory[MISSED_LOAD] = time, depth, pressed
    memory[MISSES] += 1.0
    memory[MISSED], memory[RENDERS], memory[UNFELT] = 1.0, 0.0, 0.0


@kernel
def _let_down(c: Floats, figures: Floats, memory: Floats, full: float, pressed: float, touching: bool) -> float:
    """Return how far below the virtual surface the plate is to be [m]; ``full`` is clear of the finger."""
    drop, renders = memory[DROP], memory[RENDERS] > 0.0
    felt = pressed > LEFT
    if not touching and not felt:
        drop = 0.0 if renders else full
    else:
        near = felt or figures[PLATE_TOP] > figures[HIP + 2] - c[RADIUS] - SOON
        way = (SOFTLY if near else QUICKLY) * c[PERIOD]
        if not renders:
            drop = min(full, drop + way)
        elif felt or figures[PLATE_GAP] < min(drop, full) + BEHIND:
            drop = max(0.0, min(drop, full) - way)
    memory[DROP] = drop
    return float(drop)


@kernel
def _there(memory: Floats, depth: float, pressed: float) -> bool:
    """Tell whether the plate is at the finger, or about to be; ``depth`` is how far the finger seems in it [m]."""
    if depth > -ABOUT or (memory[RENDERS] > 0.0 and memory[DROP] < HAND_OVER):
        return True
    return pressed > (LEFT if memory[PRESENT] > 0.0 else TOUCH)


@kernel
def _bearable(c: Floats, lowest: float, top: float, pressed: float) -> float:
    """Return the greatest height [m] at which the plate presses no harder than the scene allows, as the pad is now."""
    most = ALLOWED * c[FORCE_LIMIT]
    if top - lowest < THIN or pressed < 0.5 * most:
        return float(np.inf)
    return float(lowest + most * (top - lowest) / pressed)


@kernel
def feel(c: Floats, figures: Floats, memory: Floats, load: float, touching: bool) -> None:
    """Say with what force [N] the finger feels the contact: the plate's where the plate renders, else the virtual one.

    At first it is the virtual one, until the plate is felt, and then it is blended into the other.
    """
    if not touching:
        memory[PRESSED] = memory[FELT] = memory[FELT_WEIGHT] = memory[FELT_FORCE] = 0.0
        return
    memory[PRESSED] += c[PERIOD]
    pressed = max(0.0, -load)
    if pressed > TOUCH or memory[PRESSED] > WAIT:
        memory[FELT] = 1.0
    real = c[HAS_LOAD] > 0.0 and memory[PRESENT] > 0.0 and memory[FELT] > 0.0
    way = c[PERIOD] / BLEND
    weight = min(1.0, memory[FELT_WEIGHT] + way) if real else max(0.0, memory[FELT_WEIGHT] - way)
    memory[FELT_WEIGHT] = weight
    if weight > 0.0:
        memory[FELT_FORCE] = max(LEAST, (1.0 - weight) * figures[NORMAL_FORCE] + weight * pressed)
    else:
        memory[FELT_FORCE] = figures[NORMAL_FORCE]


@kernel
def carry(
    c: Floats, world: Floats, mesh: Any, poses: Floats, table: Floats, sent: Floats, figures: Floats, memory: Floats,
    goal: Floats, load: float, touching: bool, time: float,
) -> int:  # fmt: skip
    """Find the virtual surface under the finger, say who renders it, and command the plate.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    world, mesh, poses
        The objects; see ``itouch.contact``.
    table, sent
        Pose reading of the table, and the pose last sent to it, shape (7,).
    figures, memory
        The probe's part of State, and that of the carried surface.
    goal
        The table's command, shape (7,); written.
    load
        The table's reading of the force along its z axis [N]; a finger that presses makes it negative.
    touching, time
        Whether there is a virtual contact, and the time of the tick [s].

    Returns
    -------
    int
        Whose surface is below the finger, -1 for nobody's.
    """
    lowest = figures[HIP + 2] - c[RADIUS]
    x, y, z = turned_out(c, TABLE, table[0] + c[OFFSET], table[1] + c[OFFSET + 1], table[2] + c[OFFSET + 2])
    top = z + c[TABLE + 2]
    height, upright, below = -np.inf, 1.0, -1
    if world.shape[0] > 0:
        down, normal = np.zeros(3), np.empty(3)
        down[2] = -1.0
        distance, hit = sphere_cast(world, mesh, poses, figures[HIP : HIP + 3], down, c[RADIUS], REACH, normal)
        if hit >= 0:
            height, below = lowest - distance, int(hit)
            upright = _along_plate(c, normal)
    if touching:
        upright = _along_plate(c, figures[NORMAL : NORMAL + 3])
    figures[PLATE_TOP], figures[SURFACE_HEIGHT] = top, height
    figures[PLATE_GAP] = height - top if height > -np.inf else np.inf
    pressed = max(0.0, -load)
    _choose(c, memory, upright, touching)
    _miss(c, figures, memory, pressed, touching, time)
    away = lowest - c[CLEARANCE]
    drop = _let_down(c, figures, memory, max(0.0, height - away), pressed, touching)
    wanted = max(height - drop, away) - _yield(c, figures, abs(load))
    wanted = min(wanted, _bearable(c, lowest, top, pressed))
    goal[0], goal[1], goal[2] = turned_in(
        c, TABLE, figures[HIP] - c[TABLE], figures[HIP + 1] - c[TABLE + 1], wanted - c[TABLE + 2]
    )
    for i in range(3):
        goal[i] -= c[OFFSET + i]
        goal[4 + i] = 0.0
    goal[3] = 1.0
    memory[PRESENT] = 1.0 if touching and _there(memory, top - lowest, pressed) else 0.0
    square = 0.0
    for i in range(3):
        square += (sent[i] - table[i]) ** 2
    figures[TRACKING] = math.sqrt(square)
    feel(c, figures, memory, load, touching)
    return below


@kernel
def _part(c: Floats, figures: Floats, memory: Floats, normal: float, pressed: float, touching: bool) -> float:
    """Return the part of the normal force [N] that the arm gives: what the plate does not, and no force twice."""
    wanted = 1.0
    if touching and c[HAS_TABLE] > 0.0 and memory[RENDERS] > 0.0:
        wanted = min(1.0, max(0.0, figures[PLATE_GAP] / HAND_OVER))
    share = memory[SHARE]
    if not touching or share < 0.0:
        share = wanted
    else:
        step = HAND_STEP / max(abs(normal), HAND_STEP)
        share += min(step, max(-step, wanted - share))
    memory[SHARE] = share if touching else -1.0
    if touching and normal > 0.0 and share > 0.0:
        felt = max(0.0, pressed - NOTHING) * _along_plate(c, figures[NORMAL : NORMAL + 3])
        share = min(share, max(0.0, 1.0 - felt / normal))
    return float(share)


@kernel
def share(c: Floats, figures: Floats, memory: Floats, wrench: Floats, load: float, touching: bool) -> None:
    """Command the arm: where the plate renders the contact, the normal part only as far as the plate does not give it.

    Arm and plate together never push harder than the scene allows.
    """
    along = 0.0
    for i in range(3):
        along += figures[CONTACT_FORCE + i] * figures[NORMAL + i]
    pressed = max(0.0, -load)
    along *= 1.0 - _part(c, figures, memory, along, pressed, touching)
    x = figures[CONTACT_FORCE] - along * figures[NORMAL]
    y = figures[CONTACT_FORCE + 1] - along * figures[NORMAL + 1]
    z = figures[CONTACT_FORCE + 2] - along * figures[NORMAL + 2]
    scale = _beside(c, x, y, z, pressed) if pressed > TOUCH else 1.0
    if scale < 1.0 or memory[CUT] > 0.0:  # what was cut comes back in small steps
        step = 2.0 * HAND_STEP / max(math.sqrt(x * x + y * y + z * z), HAND_STEP)
        scale = min(scale, 1.0 - memory[CUT] + step)
        memory[CUT] = 1.0 - scale
        x, y, z = scale * x, scale * y, scale * z
    wrench[0], wrench[1], wrench[2] = turned_in(c, ARM, x, y, z)


@kernel
def _beside(c: Floats, x: float, y: float, z: float, pressed: float) -> float:
    """Return the greatest part of the arm's force that, with the plate's, stays within the limit."""
    square = x * x + y * y + z * z
    along = pressed * (x * c[TABLE + 5] + y * c[TABLE + 8] + z * c[TABLE + 11])
    over = pressed * pressed - (c[FORCE_LIMIT] - SPARE) ** 2
    if square + 2.0 * along + over <= 0.0 or square == 0.0:
        return 1.0
    root = along * along - square * over
    if root < 0.0:  # the plate alone is beyond it: the arm may only pull the other way
        return 1.0 if along < 0.0 else 0.0
    return float(min(1.0, max(0.0, (math.sqrt(root) - along) / square)))
