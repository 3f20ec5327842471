"""Who renders a contact: the surface what is not too steep for it, and only where it is felt as its height says."""

from __future__ import annotations

from typing import Any

from itouch.plugin.kernels import kernel
from itouch_encountered.own import ABOUT, FREE, HIGH, LOST, LOW, TAKES, TOUCH, UNASKED, UNFELT

#: A surface is missed where the finger seems to press it in deeper than the force explains by so much [m], at less than
#: so much of the force that the pad would give, for so long [s]; what is missed is tried again after so long apart [s].
MISS_DEPTH, MISS_PART, MISS_TIME, TRY_AGAIN = 1e-3, 0.4, 0.04, 0.02
#: A surface is too high that presses with so much [N] while it seems so far below the finger [m], for so long [s].
EARLY_FORCE, EARLY_GAP, EARLY_TIME = 0.1, 1e-3, 0.010
#: For how long it may press so where only its force and its place together say that it is too high by that much, and
#: there is no virtual contact: a tap [s].
TAP_TIME = 0.020
#: For how long it may be felt at all without a virtual contact [s], and how much faster that is forgotten while it is
#: not [1]: noise alone, however great, is above `TOUCH` less than half of the time, and so comes to nothing.
UNASKED_TIME, FORGETS = 0.06, 2.0
#: How far below the finger it may be by its height and still be too high [m], after a touch-off and without one: what
#: presses from further below has a sensor that is wrong (T8).
FAR, FAR_UNCALIBRATED = 0.004, 0.015
#: Where it hovers, further than this below the finger [m], what a real axis reads in the air (friction, its mass) is
#: no finger: the force by which a sensor would be doubted there [N], for half as long [s].
HOVER_GAP, HOVER_FORCE, HOVER_TIME = 4e-3, 0.5, 0.05


@kernel
def along(frame: Any, normal: Any) -> float:
    """Return the cosine between a normal (3,) in the world and the surface's; ``frame`` (12,): of the device.

    Normal and cosine have no unit [1].
    """
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * frame[5 + 3 * i]
    return cosine


@kernel
def choose(c: Any, own: Any, upright: float, touching: bool, withdrawn: bool) -> None:
    """Say whose the contact is; one that has begun changes over only when it is well on the other side.

    ``c``: `Numbers`; ``own`` (45,): its fields; ``upright``: the cosine of the angle between the virtual surface and
    this one [1]; ``withdrawn``: safety keeps it away (T4).
    """
    if touching:
        own[FREE] = 0.0
        if upright < c.cosine:
            own[TAKES] = 0.0
        elif upright >= c.back:
            own[TAKES] = 1.0
    else:
        own[TAKES] = 1.0 if upright >= c.cosine else 0.0
        own[FREE] += c.period
        if own[FREE] > TRY_AGAIN and own[LOST] == LOW:
            own[LOST] = 0.0
    if own[LOST] > 0.0 or withdrawn:
        own[TAKES] = 0.0


@kernel
def doubt(c: Any, own: Any, depth: float, pressed: float, touching: bool) -> None:
    """Find that it is not where its height says: it is not felt where it should be, or the other way round.

    ``c``: `Numbers`; ``own`` (45,); ``depth``: how far the finger seems to be in it [m]; ``pressed``: its force [N].
    """
    hovers = depth < -HOVER_GAP
    what, patience = 0.0, MISS_TIME
    if pressed > (HOVER_FORCE if hovers else EARLY_FORCE) and -c.early < depth < -EARLY_GAP:
        what, patience = HIGH, HOVER_TIME if hovers else EARLY_TIME
    elif (
        not touching and pressed > EARLY_FORCE
        and -EARLY_GAP <= depth < 0.0 and pressed / c.stiffness - depth > EARLY_GAP
    ):  # fmt: skip
        what, patience = HIGH, TAP_TIME
    elif (
        touching and own[TAKES] > 0.0
        and depth - pressed / c.stiffness > MISS_DEPTH and pressed < MISS_PART * c.stiffness * depth
    ):  # fmt: skip
        what = LOW
    if what == 0.0:
        own[UNFELT] = 0.0
        return
    own[UNFELT] += c.period
    if own[UNFELT] >= patience:
        own[LOST], own[TAKES], own[UNFELT] = what, 0.0, 0.0
        own[UNASKED] = 0.0


@kernel
def touches_unasked(c: Any, own: Any, depth: float, pressed: float, touching: bool) -> None:
    """Find that a finger which touches nothing virtual feels it: it is too high by what gap and force say together.

    ``c``: `Numbers`; ``own`` (45,); ``depth``: how far the finger seems to be in it [m]; ``pressed``: its force [N].
    """
    too_high = pressed / c.stiffness - depth
    if not touching and pressed > TOUCH and too_high > ABOUT and -HOVER_GAP < depth < 0.0:
        own[UNASKED] += c.period
    else:
        own[UNASKED] = max(0.0, own[UNASKED] - FORGETS * c.period)
    if own[UNASKED] >= UNASKED_TIME:
        own[LOST], own[TAKES], own[UNFELT], own[UNASKED] = HIGH, 0.0, 0.0, 0.0
