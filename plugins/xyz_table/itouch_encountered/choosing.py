"""Who renders a contact: the surface where the slope is not too steep and its height proves right, else the arm.

In every function ``c`` is `motion.Numbers`, and ``own`` (51,) are the modality's fields, with the units of
`own.FIELDS`; behind a wire there are more.
"""

from __future__ import annotations

from typing import Any

from itouch.plugin.carried_surfaces import ABOUT, HIGH, LOW, TOUCH
from itouch.plugin.kernels import linked
from itouch_encountered.surface_fields import FREE, LOST, TAKES, UNASKED, UNFELT

#: A surface is missed (too low) if the finger seems deeper in it than the force explains by more than this [m], while
#: the force is below this share of what the pad would give, for this long [s]; after so long out of contact [s] it is
#: tried again.
MISS_DEPTH, MISS_PART, MISS_TIME, TRY_AGAIN = 1e-3, 0.4, 0.04, 0.02
#: A surface is missed, too, if it is not felt at all (`TOUCH`) where the pad would give more than this [N] and the
#: finger seems deeper in it than this [m], for MISS_TIME: a light touch never gets as deep as MISS_DEPTH.  There even a
#: pad that is eight times softer than it is said to be is felt.
UNFELT_FORCE, UNFELT_DEPTH = 0.4, 4e-4
#: A surface is too high if it presses with more than this [N] while it seems farther below the finger than this [m],
#: for this long [s].
EARLY_FORCE, EARLY_GAP, EARLY_TIME = 0.1, 1e-3, 0.010
#: The same time [s] where the gap alone is smaller, but gap and pad deformation together exceed EARLY_GAP and there is
#: no virtual contact: a tap is noticed by that.
TAP_TIME = 0.020
#: For how long the surface may be felt without a virtual contact [s], and how many times faster this time runs back
#: while it is not felt [1]: noise alone, however great, exceeds `TOUCH` less than half of the time: it does not add up.
UNASKED_TIME, FORGETS = 0.06, 2.0
#: A finger that rests on a surface lightly, with more than this [N], and seems nearer to it than this [m]: such a tick
#: counts by this part [1], so that what looks like it in passing is no finger.
LIGHTLY, NEARLY, PARTLY = 0.025, 6e-4, 0.2
#: How far below the finger a surface that is in truth too high may seem to be [m], after a touch-off and without one:
#: if it presses from farther below, its sensor is wrong (T8).
FAR, FAR_UNCALIBRATED = 0.004, 0.015
#: While the surface hovers, farther below the finger than this [m], a real axis reads forces in the air (friction, its
#: mass) that no finger causes: there it counts as too high only from the force on at which T8 doubts the sensor [N],
#: within half of T8's time [s].
HOVER_GAP, HOVER_FORCE, HOVER_TIME = 4e-3, 0.5, 0.05


@linked
def along(frame: Any, normal: Any) -> float:
    """Return the cosine [1] of the angle between a normal in the world and the surface's normal.

    ``frame`` (12,): the device's frame in the world, origin [m] and rotation [1]; ``normal`` (3,) [1].
    """
    cosine = 0.0
    for i in range(3):
        cosine += normal[i] * frame[5 + 3 * i]
    return cosine


@linked
def choose(c: Any, own: Any, upright: float, touching: bool, away: bool) -> None:
    """Decide whether surface or arm renders the contact, with hysteresis: a contact that has begun changes hands late.

    ``upright``: the cosine of the angle between the virtual surface and this one [1]; ``away``: safety keeps this one
    away (T4), or there is no virtual surface below the finger.
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
    if own[LOST] > 0.0 or away:
        own[TAKES] = 0.0


@linked
def doubt(c: Any, own: Any, depth: float, pressed: float, touching: bool) -> None:
    """Note that the surface is not where its height says: not felt where it should be (LOW), or felt below that (HIGH).

    ``depth``: how far the finger seems to be in the surface [m]; ``pressed``: the force on the surface [N].
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
    ) or (
        touching and own[TAKES] > 0.0
        and depth > max(UNFELT_DEPTH, UNFELT_FORCE / c.stiffness) and pressed < TOUCH
    ):  # fmt: skip
        what = LOW
    if what == 0.0:
        own[UNFELT] = 0.0
        return
    own[UNFELT] += c.period
    if own[UNFELT] >= patience:
        own[LOST], own[TAKES], own[UNFELT] = what, 0.0, 0.0
        own[UNASKED] = 0.0


@linked
def touches_unasked(c: Any, own: Any, depth: float, pressed: float, touching: bool) -> None:
    """Note that the surface is too high (HIGH) because a finger feels it that touches nothing virtual.

    Too high by how much: the gap by its height, and the pad deformation that the force means.  ``depth`` and
    ``pressed`` as in `doubt`.
    """
    too_high = not touching and pressed / c.stiffness - depth > ABOUT and -HOVER_GAP < depth < 0.0
    if too_high and pressed > TOUCH:
        own[UNASKED] += c.period
    elif too_high and pressed > LIGHTLY and depth > -NEARLY:
        own[UNASKED] += PARTLY * c.period
    else:
        own[UNASKED] = max(0.0, own[UNASKED] - FORGETS * c.period)
    if own[UNASKED] >= UNASKED_TIME:
        own[LOST], own[TAKES], own[UNFELT], own[UNASKED] = HIGH, 0.0, 0.0, 0.0
