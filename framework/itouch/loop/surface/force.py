"""The force of a contact that plate and arm share: with which force it is felt, and what the arm gives of it.

Where a plate renders the contact, the arm gives only what the plate does not give.  No force is given twice, and arm
and plate together never push harder than the scene allows.  While the contact is handed over from one to the other, the
sum of both changes in small steps: the plate's force is measured, and the arm's force follows it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked, scratch
from itouch.loop.render import (
    ARM,
    CONTACT_FORCE,
    FORCE_LIMIT,
    HAS_LOAD,
    HAS_TABLE,
    HIP,
    NORMAL,
    NORMAL_FORCE,
    PERIOD,
    PLATE_GAP,
    PLATE_TOP,
    RADIUS,
    TABLE,
)
from itouch.loop.surface.force_estimate import believed
from itouch.loop.surface.ground import along_plate
from itouch.loop.surface.handover import LED
from itouch.loop.surface.plate import CLEAR_OF
from itouch.loop.surface.surface_memory import (
    CHANGING,
    CLEAR,
    CUT,
    FELT,
    FELT_FORCE,
    FELT_WEIGHT,
    LETS_GO,
    LINGERED,
    LINGERED_AT,
    LINGERS,
    LOAD,
    NOTHING,
    PRESENT,
    PRESSED,
    RENDERS,
    SETTLED,
    SHARE,
    STIRS,
    UNSURE,
    VIRTUAL,
    WANTED,
)
from itouch.plugin.carried_surfaces import ABOUT, HAND_OVER, LEFT, TOUCH
from itouch.twin.frame_rotation import turned_in, turned_out

Floats = NDArray[np.float64]

#: Greatest change per tick [N] of the normal force that the arm takes over or gives back.
HAND_STEP = 0.03
#: Greatest change per tick [N] of the sum of arm and plate while the contact is handed over from one to the other.
STEP = 0.06
#: The same just before the plate is felt, and while it sets out or turns round: how its force changes then cannot be
#: foreseen.
FIRST_STEP = 0.02
#: Where the plate presses by less than this [N] it may bounce: what it gave in one tick it takes back in the next.
LIGHT = 0.15
#: Greatest change per tick [N] of the arm's force there, so that with a bounce of the plate it stays below 0.1 N.
LIGHT_STEP = 0.055
#: Where the arm's force is to change in a tick by more than the virtual one and APART, and by more than FELT_STEP [N],
#: the plate's part has changed: the force is then led over again.
APART, FELT_STEP = 0.004, 0.095
#: To catch up, an arm that is alone may change in a tick by this much more than the virtual force does [N]; up to
#: FELT_STEP, by a tenth more than it is to.
CATCHES_UP = 4e-3
#: Greatest change per tick [N] of the arm's force while it is led over and a plate presses with LIGHT or more: the
#: plate's reading is a tick old, and noise is in it.
BESIDE = 0.07
#: Reading [N] of a force sensor that noise seldom exceeds, by which a plate that seems away is told from one that
#: presses although its height is wrong.
LOUD = 0.15
#: For how long [s] the sum is still kept to such steps after the plate has come or gone.
AFTER = 0.05
#: For how long [s] the plate sets out or turns round after a change of hands.
SETS_OUT = 0.005
#: How near the plate is to the finger when it may be felt in the next tick [m].
SOON = 1e-4
#: How much less per tick than a quickly changing virtual force the sum may change [N]: the plate adds to it.
BELOW = 0.02
#: How far the sum stays below the scene's limit [N], because the plate's force is known a tick late.
SPARE = 0.06
#: The same where it is known later still: more than safety leaves by itself, so that this is not felt to cut.
SPARE_LATE = 0.15
#: How far the plate's force, as it is told between two readings, may go down and up again [N] before the arm follows:
#: the next reading would cut the arm at once.
PLAY = 0.08

#: How long [s] the virtual force stands in for a plate that is not felt yet, and in what time it blends into the
#: plate's.
WAIT, BLEND = 0.080, 0.020
#: A plate that is felt again so soon [s] after it let go, with more than this [N], and is at the finger by its height
#: (`ABOUT`), has bounced: it counts as one that was felt all the time.  A sensor's noise alone does not look so.
BOUNCES, AGAIN = 0.05, 0.1
#: Least felt force [N] of a contact that the plate renders.
LEAST = 1e-3


@linked
def _part(c: Floats, figures: Floats, memory: Floats, normal: float, pressed: float, touching: bool) -> float:
    """Return the arm's share of the normal force, 0 to 1: what the plate does not give, so that no force acts twice.

    ``normal`` and ``pressed``: virtual normal force and the plate's measured force [N].
    """
    wanted = 1.0
    if touching and c[HAS_TABLE] > 0.0 and memory[RENDERS] > 0.0:
        wanted = min(1.0, max(0.0, figures[PLATE_GAP] / HAND_OVER))
    share = memory[SHARE]
    if not touching or share < 0.0:
        share = wanted
    else:
        step = HAND_STEP / max(min(abs(normal), c[FORCE_LIMIT]), HAND_STEP)
        share += min(step, max(-step, wanted - share))
    memory[SHARE] = share if touching else -1.0
    if touching and normal > 0.0 and share > 0.0:
        felt = max(0.0, pressed - NOTHING) * along_plate(c, figures[NORMAL : NORMAL + 3])
        share = min(share, max(0.0, 1.0 - felt / normal))
        memory[SHARE] = max(share, min(memory[SHARE], wanted))  # the next tick goes on from what it really is
    return float(share)


@linked
def _still_changes(c: Floats, memory: Floats, touching: bool) -> bool:
    """Tell whether the contact is still handed over between arm and plate; one that ends is so for one more tick."""
    left = memory[CHANGING]
    if left <= 0.0:
        return False
    done = memory[SETTLED] > 0.0 if memory[RENDERS] > 0.0 else memory[CLEAR] > 0.0 and memory[SHARE] >= 1.0
    left = min(left, AFTER) - c[PERIOD] if done else left - c[PERIOD]
    memory[CHANGING] = 0.0 if not touching else max(0.0 if done else AFTER, left)
    return True


@linked
def _within(c: Floats, memory: Floats, force: Floats, most: float, step: float, play: float) -> None:
    """Cut a force (3,) to ``most`` [N], what the plate leaves of the limit; the limit comes back in small steps.

    ``step``: by how much at most it is cut further in this tick [N]; ``play``: by how much too far it may stay cut [N].
    """
    cut = min(c[FORCE_LIMIT] - max(0.0, most), memory[CUT] + step)
    memory[CUT] = max(cut, memory[CUT] - 2.0 * HAND_STEP, min(memory[CUT], cut + play), 0.0)
    _shorten(force, c[FORCE_LIMIT] - memory[CUT])


@linked
def _shorten(force: Floats, most: float) -> None:
    """Shorten a force (3,) to at most ``most`` [N]; to zero where that is negative."""
    size, most = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2), max(0.0, most)
    if size > most:
        for i in range(3):
            force[i] *= most / size


@linked
def _lead(c: Floats, sent: Floats, force: Floats, rise: float, step: float, most: float) -> bool:
    """Bring a force (3,) near enough to the one sent last that its sum with the plate's changes by at most a step [N].

    ``rise``: change of the plate's force in this tick [N]; ``most``: by how much the force itself may change [N].
    Return whether the force had to be changed for that.
    """
    before, change = scratch(3), scratch(3)
    before[0], before[1], before[2] = turned_out(c, ARM, sent[0], sent[1], sent[2])
    square = 0.0
    for i in range(3):
        change[i] = force[i] - before[i] + rise * c[TABLE + 5 + 3 * i]
        square += change[i] ** 2
    if square > step * step:
        scale = step / math.sqrt(square)
        for i in range(3):
            force[i] = before[i] + scale * change[i] - rise * c[TABLE + 5 + 3 * i]
    own = 0.0
    for i in range(3):
        own += (force[i] - before[i]) ** 2
    if own > most * most:
        scale = most / math.sqrt(own)
        for i in range(3):
            force[i] = before[i] + scale * (force[i] - before[i])
    return bool(square > step * step or own > most * most)


@linked
def _anew(memory: Floats, begin: int, force: Floats) -> float:
    """Store a force (3,) in the memory from index ``begin`` on, and return how much it has changed in this tick [N]."""
    square = 0.0
    for i in range(3):
        square += (force[i] - memory[begin + i]) ** 2
        memory[begin + i] = force[i]
    return math.sqrt(square)


@linked
def on_plate(load: Floats, presses: Floats) -> float:
    """Return the force on a surface along its device's third axis [N], as is said (1,), or else as is read (6,)."""
    return float(-presses[0] if presses[0] >= 0.0 else load[2])


@linked
def pressing(reading: float, depth: float) -> float:
    """Return with what force [N] a plate presses, by its sensor's reading [N] and how deep the finger seems in it [m].

    A plate that is away presses with nothing, whatever noise its sensor has; the arm would give that noise to the
    finger.  One whose height is wrong by millimetres may press all the same, but soon harder than noise: the farther it
    seems away, the more a reading must exceed `LOUD` to count in full.
    """
    away = min(1.0, max(0.0, (-depth - ABOUT) / (CLEAR_OF - ABOUT)))
    return float(min(reading, max(NOTHING, 2.0 * (reading - away * LOUD))))


@kernel
def push(
    c: Floats, figures: Floats, memory: Floats, sent: Floats, wrench: Floats, load: Floats, presses: Floats,
    primary: Any,
) -> int:  # fmt: skip
    """Command the arm; where the plate renders the contact, only that part of the normal force which it does not give.

    Parameters
    ----------
    c
        Constants of the probe, shape (CONSTANTS,).
    figures, memory
        The probe's part of State, shape (FIGURES,), and that of the carried surface, shape (MEMORY,).
    sent, wrench
        What was sent to the arm last, and its command, shape (6,), in the arm's frame; the command is written.
    load
        The table's reading of the wrench on it, shape (6,) [N, N m], of which the third number counts; a finger that
        presses makes it negative.
    presses
        What the plate's modality says of that force now [N], shape (1,), where the reading is an older one; below 0:
        nothing.
    primary
        Index of the touched object, shape (1,); -1: there is no virtual contact.
    """
    touching, guessed = primary[0] >= 0, presses[0] >= 0.0
    along = 0.0
    for i in range(3):
        along += figures[CONTACT_FORCE + i] * figures[NORMAL + i]
    depth = figures[PLATE_TOP] - (figures[HIP + 2] - c[RADIUS])
    pressed = pressing(max(0.0, -believed(memory, on_plate(load, presses))), depth)
    rise = pressed - memory[LOAD] if c[HAS_LOAD] > 0.0 else 0.0
    if memory[LOAD] <= NOTHING:
        # What a sensor reads without a touch is no rise; the pad's damping gives a force at once, and only once.
        rise = min(rise, HAND_STEP) if pressed > NOTHING else 0.0
    memory[LOAD] = pressed
    along *= 1.0 - _part(c, figures, memory, along, pressed, touching)
    force = scratch(3)
    for i in range(3):
        force[i] = figures[CONTACT_FORCE + i] - along * figures[NORMAL + i]
    if c[HAS_TABLE] > 0.0 and c[FORCE_LIMIT] < np.inf:
        near = pressed > TOUCH or depth > -ABOUT
        spare = max(SPARE_LATE if guessed else SPARE, rise + 0.5 * SPARE) + memory[UNSURE]
        left = c[FORCE_LIMIT] - (pressed + spare if near else 0.0)
        step = HAND_STEP if guessed else max(STEP, pressed + NOTHING - memory[CUT])
        _within(c, memory, force, left, step, PLAY if guessed and near else 0.0)
    own, virtual = _anew(memory, WANTED, force), _anew(memory, VIRTUAL, figures[CONTACT_FORCE : CONTACT_FORCE + 3])
    if memory[RENDERS] > 0.0 and memory[PRESSED] > AFTER and own > max(virtual + APART, FELT_STEP):
        memory[CHANGING] = max(memory[CHANGING], AFTER)  # the plate's part has changed, as where the normal jumps
    if _still_changes(c, memory, touching):
        # Where what presses is only thought to, the plate may be felt a tick later than that.
        unseen = (abs(depth) < SOON and (guessed or pressed < NOTHING)) or memory[CHANGING] > LED - SETS_OUT
        step = FIRST_STEP if unseen else STEP
        # Between two readings the plate's force steps unseen: the arm's own steps leave room for that.
        most = min(step, HAND_STEP) if guessed and (pressed > NOTHING or depth > -ABOUT) else np.inf
        if NOTHING < pressed < LIGHT:
            most = min(most, LIGHT_STEP)
        elif pressed >= LIGHT:
            most = min(most, BESIDE)
        if memory[CHANGING] <= AFTER and (memory[SETTLED] > 0.0 or (pressed <= NOTHING and depth < -ABOUT)):
            # The handover is over: friction that reverses must not be followed late.
            stirs = max(virtual, memory[STIRS], memory[STIRS + 1])
            step, most = max(step, stirs - BELOW), max(most, stirs)
        if memory[CHANGING] <= AFTER and memory[SHARE] >= 1.0 and memory[CUT] <= 0.0 and depth < -ABOUT:
            # the plate has long been away: the arm's force may follow the virtual one, and catch up with it
            step = max(step, min(own, virtual) + CATCHES_UP, min(1.1 * own, FELT_STEP))
        if _lead(c, sent, force, rise, step, most):  # it goes on in steps until it has arrived
            memory[CHANGING] = max(memory[CHANGING], c[PERIOD])
        _shorten(force, c[FORCE_LIMIT] - memory[CUT])
    memory[STIRS + 1], memory[STIRS] = memory[STIRS], virtual
    wrench[0], wrench[1], wrench[2] = turned_in(c, ARM, force[0], force[1], force[2])
    return 0


@linked
def feel(c: Floats, figures: Floats, memory: Floats, load: float, touching: bool) -> None:
    """Write with what force [N] the finger feels the contact: the plate's where the plate is present, else the virtual.

    Until the plate is felt it is the virtual force, which is then blended into the plate's.

    ``c`` (CONSTANTS,) and ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``load``: the force that the
    plate reads [N]; a finger that presses makes it negative.
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


@linked
def linger(c: Floats, figures: Floats, memory: Floats, load: float, touching: bool, time: float) -> None:
    """Remember the longest time [s] for which the plate was felt after a virtual contact had ended, and when that was.

    ``c`` (CONSTANTS,), ``figures`` (FIGURES,) and ``memory`` (MEMORY,) of the surface; ``load``: the force that the
    plate reads [N], negative when pressed; ``time`` of the tick [s].
    """
    if touching:
        memory[LINGERS] = memory[LETS_GO] = 0.0
        return
    if memory[LINGERS] < 0.0:
        return
    near = figures[HIP + 2] - c[RADIUS] - figures[PLATE_TOP] < ABOUT
    if memory[LETS_GO] > 0.0:
        felt = near and -load > AGAIN
    else:
        felt = -load > (LEFT if near else TOUCH)
    if felt:
        memory[LINGERS] += memory[LETS_GO] + c[PERIOD]
        memory[LETS_GO] = 0.0
        if memory[LINGERS] > memory[LINGERED]:
            memory[LINGERED], memory[LINGERED_AT] = memory[LINGERS], time
        return
    memory[LETS_GO] += c[PERIOD]
    if memory[LETS_GO] > BOUNCES:
        memory[LINGERS], memory[LETS_GO] = -1.0, 0.0
