"""By how much a device misses its command, as learned: its compliance, its lag and its inertia, compensated ahead.

A device gives way under a force, is late where it goes up or down, and falls behind where it accelerates; it is sent
higher or lower by what that makes.  The acceleration is that of the virtual surface below the finger, which bends where
its slope changes, or where finger or object change their speed.

In every function ``c`` is `motion.Numbers`, and ``own`` (51,) are the modality's fields, with the units of
`own.FIELDS`; behind a wire there are more.
"""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin.carried_surfaces import TOUCH
from itouch.plugin.kernels import linked
from itouch_encountered.surface_fields import (
    BENDS,
    GIVE,
    HASTE,
    HERE,
    INERTIA,
    KINKS,
    LAG,
    RUSHES,
    SPEED,
)

#: Learning rate of the device's compliance, lag and inertia [1/s]; the greatest compliance [m/N] and lag [s] that are
#: compensated; and the error [m] above which something else is the cause, so that nothing is learned from it.
LEARNS, MOST_GIVE, MOST_LAG, ASTRAY = 80.0, 1e-4, 0.005, 1e-4
#: How far an axis falls behind for each m/s2 of acceleration [s2]: 1/w2 of a control with a bandwidth of 40 Hz, with
#: which learning begins; and the most that is compensated, that of 22 Hz.
INERTIA_FIRST, MOST_INERTIA = 1.6e-5, 5e-5
#: Damping ratio of such a control [1].
DAMPING_RATIO = 0.9
#: In what time half of a change of the finger's or object's acceleration is followed [s].
HALVED = 1e-3
#: A surface this far from where it was a tick ago [m] has not moved there: it is seen for the first time.
ELSEWHERE = 5e-3
#: Acceleration [m/s2] well below which a device's error is not due to its inertia.
EVEN = 2.0
#: Vertical speed [m/s] well below which a device's error is due to the force on it, and well above to its lag.
STILL = 0.06


@linked
def _smoothed(c: Any, own: Any, before: float, bends: float) -> float:
    """Return an acceleration [m/s2] smoothed by the low-pass filter of a position control's feed-forward.

    For a control of bandwidth w [rad/s] and damping ratio d to keep to a height x, it must be sent x + u, where
    2 d / w u' + u = x'' / w2.
    """
    return float(before + (bends - before) * c.period / (2.0 * DAMPING_RATIO * math.sqrt(own[INERTIA]) + c.period))


@linked
def bend(c: Any, own: Any, turns: float, hastens: float, goes_on: bool) -> float:
    """Follow the vertical acceleration of the virtual surface below the finger, in a contact that goes on.

    No device changes its speed at once, so a kink is rounded off: from the tick in which it is seen, ``ahead`` ticks
    before the finger is there, to as many ticks after that.  Return how much higher than the virtual surface the
    rounded path is now [m].

    ``turns`` and ``hastens``: how fast the speed of the height changes because the slope does, or because finger or
    object accelerate [m/s2]; ``goes_on``: whether the contact has lasted for a tick.
    """
    ticks = 2 * c.ahead
    if not goes_on:
        for i in range(ticks):
            own[KINKS + i] = 0.0
        own[BENDS] = own[HASTE] = 0.0
        return 0.0
    mean = rounds = 0.0
    for i in range(ticks - 1, -1, -1):
        turned = own[KINKS + i - 1] if i > 0 else turns
        own[KINKS + i] = turned
        mean += turned / ticks
        # The rounded path has changed its speed a little in each tick since then; the surface does so at once, when the
        # finger is there.
        rounds += turned * (0.5 * i * (i + 1) / ticks - max(0.0, i - c.ahead + 0.5))
    slope = _smoothed(c, own, own[BENDS] - own[HASTE], mean)
    # Changes to and fro are noise, for as long at every rate; a finger's speed is smoothed already.
    own[HASTE] += (1.0 - 0.5 ** (c.period / HALVED)) * (hastens - own[HASTE])
    own[BENDS] = slope + own[HASTE]
    return float(rounds * c.period * c.period)


@linked
def watch(c: Any, own: Any, here: float, climb: float) -> None:
    """Follow how fast the surface rises by its own reading ``here`` [m], and how it accelerates.

    Behind a wire, readings do not come in every tick: there its speed is taken to be that of the virtual surface,
    ``climb`` [m/s].
    """
    if c.wire:
        own[HERE], own[SPEED], own[RUSHES] = here, climb, own[BENDS]
        return
    if abs(here - own[HERE]) > ELSEWHERE:
        own[HERE], own[SPEED], own[RUSHES] = here, 0.0, 0.0
    speed = (here - own[HERE]) / c.period
    own[RUSHES] = _smoothed(c, own, own[RUSHES], (speed - own[SPEED]) / c.period)
    own[HERE], own[SPEED] = here, speed


@linked
def learn(c: Any, own: Any, last: float, here: float, pressed: float) -> None:
    """Learn by how much the device misses its command: its compliance, its lag and its inertia.

    These are the error for each newton on it, for each m/s of vertical speed, and for each m/s2 of acceleration.
    ``last`` and ``here``: the heights to which it was sent, and where it is [m];
    ``pressed``: the force on it [N].
    """
    speed, rushes = own[SPEED], own[RUSHES]
    off = last - here - own[GIVE] * pressed - own[LAG] * speed - own[INERTIA] * rushes
    if abs(off) > ASTRAY:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)  # 1: the error is due to the lag, 0: to the force
    turns = rushes * rushes / (rushes * rushes + EVEN * EVEN)  # 1: the error is due to the inertia
    step = LEARNS * c.period * off
    lets = (1.0 - turns) * step
    if pressed >= TOUCH:  # in the air the device goes as fast as it can: its control is saturated
        inertia = own[INERTIA] + turns * step * rushes / (rushes * rushes + EVEN * EVEN)
        own[INERTIA] = min(MOST_INERTIA, max(0.0, inertia))
        give = own[GIVE] + (1.0 - moves) * lets * pressed / (pressed * pressed + 0.01)
        own[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = own[LAG] + moves * lets * speed / (speed * speed + STILL * STILL)
    own[LAG] = min(MOST_LAG, max(-MOST_LAG, lag))
