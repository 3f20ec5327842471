"""The surface behind a wire, where a command acts late and for some milliseconds, and readings are older still.

The surface is sent to where the virtual surface will be under the finger in the middle of the time in which the command
acts.  The delays are observed: State says when commands left and when readings were measured.  A reading is compared
with the command that acted when it was measured, and with the motion of the virtual surface at that time.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from itouch.plugin.carried_surfaces import ABOUT, LEFT, SURELY, TOUCH
from itouch.plugin.kernels import kernel, linked
from itouch_encountered.motion import top
from itouch_encountered.surface_fields import (
    AT_MOST,
    BEHIND,
    BENDS,
    COMMANDS,
    GIVE,
    GOES,
    GONE_BY,
    HOISTS,
    HOLD,
    INERTIA,
    LAG,
    LIFTED,
    LIFTS,
    ORIGIN_Z,
    PAST,
    PLACE,
    PRESSES,
    READ_AT,
    RESTS,
    RISE,
    ROW_Z,
    SENT_TO,
    SINCE,
    WAY,
)

#: Time constant [s] of the fading memory of the filter that follows the finger's position, speed and acceleration
#: (g-h-k filter, Benedict and Bordner 1962): an arm's readings are quantised.
FADES = 4.5e-3
#: A finger this far from where it was expected has not moved there [m]: the filter begins anew.
ELSEWHERE = 5e-3
#: Time constant with which the framework smooths the speed of an object [s], and the jump in that speed [m/s] that is
#: no acceleration but another object.
SMOOTHED, JUMPS = 5e-3, 0.1
#: Weight of an exchange in the running estimates of the wire's times [1]; and the longest time for which a command
#: acts, or is on its way [s].
LEARNT, LONGEST = 0.2, 0.1
#: Learning rate of the device's lag, compliance and inertia [1/s], and the greatest weight of one reading [1].
LEARNS, MOST_LEARNT = 120.0, 0.6
#: How long the surface must have rested at the virtual one before something is learned [s], and the least time over
#: which the speed of its commands is taken [s].
RESTED, SPAN = 0.015, 3e-3
#: Time constant with which readings correct the estimate of the surface's height [s].
CORRECTS = 3e-3
#: First guess of the lag of a drive [s] whose goal moves in steps: it is not told the speed between two of them.
LAG_FIRST = 2e-3
#: The greatest lag [s] and the greatest compliance [m/N] that are compensated.
MOST_LAG, MOST_GIVE = 0.015, 1e-4
#: Error [m] above which something else is the cause, so that nothing is learned from it.
ASTRAY = 1e-3
#: Vertical speed [m/s] well below which the device's error is due to the force on it, and well above to its lag.
STILL = 0.01
#: Acceleration [m/s2] well below which its error is not due to its inertia; and the most of that which is compensated
#: [s2], the error for each m/s2.
EVEN, MOST_INERTIA = 2.0, 1e-4


class Wire(NamedTuple):
    """What is read of State behind a wire: arrays, of one number where no shape is given.

    ``tick``; ``measured``: the tick in which the newest pose was measured; ``gone`` (GONE, 4): the ticks from which the
    newest commands have acted, and the positions to which they sent the device [m]; ``goings``: how many commands have
    left; ``pose`` (7,), ``frame`` (12,), ``hip`` (3,) and ``loud`` as in `Seen`; ``load`` (6,): the force on it as read
    [N, N m], of which the third number is negative where a finger presses; ``slope_x``, ``slope_y`` [1]: the
    slope of the virtual surface; ``lifts``: how fast its object lifts it [m/s].
    """

    tick: Any
    measured: Any
    gone: Any
    goings: Any
    pose: Any
    load: Any
    frame: Any
    hip: Any
    slope_x: Any
    slope_y: Any
    lifts: Any
    loud: Any


@kernel
def _height(frame: Any, x: float, y: float, z: float) -> float:
    """Return the height in the world [m] of a position in the device's frame [m]."""
    return float(frame[ROW_Z] * x + frame[ROW_Z + 1] * y + frame[ROW_Z + 2] * z + frame[ORIGIN_Z])


@kernel
def _follow(c: Any, own: Any, axis: int, place: float) -> None:
    """Update the g-h-k filter of the finger along an axis, 0: x or 1: y; ``place``: its position now [m]."""
    at, fades = GOES + 3 * axis, math.exp(-c.period / FADES)
    x = own[at] + c.period * (own[at + 1] + 0.5 * c.period * own[at + 2])
    speed = own[at + 1] + c.period * own[at + 2]
    off = place - x
    if abs(off) > ELSEWHERE:
        own[at], own[at + 1], own[at + 2] = place, 0.0, 0.0
        return
    own[at] = x + (1.0 - fades**3) * off
    own[at + 1] = speed + 1.5 * (1.0 - fades * fades) * (1.0 - fades) * off / c.period
    own[at + 2] += (1.0 - fades) ** 3 * off / (c.period * c.period)


@linked
def _follow_lift(c: Any, own: Any, lifts: float) -> None:
    """Follow how fast the object lifts the virtual surface, and how that changes; ``lifts``: the speed smoothed [m/s].

    The smoothing is undone first.
    """
    raw, fades = lifts + SMOOTHED / c.period * (lifts - own[LIFTED]), math.exp(-c.period / FADES)
    own[LIFTED] = lifts
    speed = own[LIFTS] + c.period * own[HOISTS]
    off = raw - speed
    if abs(off) > JUMPS:
        own[LIFTS], own[HOISTS] = raw, 0.0
        return
    own[LIFTS] = speed + (1.0 - fades * fades) * off
    own[HOISTS] += (1.0 - fades) ** 2 * off / c.period


@linked
def _watch_wire(c: Any, own: Any, w: Any) -> None:
    """Estimate for how long commands act (HOLD), and how long after they are given the middle of that is (WAY)."""
    count = w.goings[0]
    if count == own[COMMANDS]:
        return
    own[COMMANDS] = count
    if count < 2:
        return
    acts = w.gone[(count - 1) % w.gone.shape[0], 0]
    hold = (acts - w.gone[(count - 2) % w.gone.shape[0], 0]) * c.period
    if not 0.0 < hold < LONGEST:
        return
    late = min(LONGEST, max(0.0, (acts - (w.tick[0] - 1)) * c.period))
    way = late + 0.5 * (hold - c.period)
    if own[HOLD] <= 0.0:
        own[HOLD], own[WAY] = hold, way
    else:
        own[HOLD] += LEARNT * (hold - own[HOLD])
        own[WAY] += LEARNT * (way - own[WAY])


@kernel
def _commanded(c: Any, own: Any, w: Any, tick: float) -> float:
    """Return the height to which the commands sent the surface at a tick [m]; NaN: not known.

    It is interpolated between commands, each taken at the middle of the time in which it acted.
    """
    size, count = w.gone.shape[0], w.goings[0]
    middle = 0.5 * (own[HOLD] / c.period - 1.0)
    after_at = after = math.nan
    for i in range(1, min(size, count) + 1):
        row = (count - i) % size
        at, height = w.gone[row, 0] + middle, _height(w.frame, w.gone[row, 1], w.gone[row, 2], w.gone[row, 3])
        if at <= tick:
            if math.isnan(after_at) or after_at <= at:
                return float(height)
            return float(height + (after - height) * (tick - at) / (after_at - at))
        after_at, after = at, height
    return math.nan


@kernel
def _highest(w: Any, since: float) -> float:
    """Return the greatest height [m] of the commands that have acted at a tick or since; NaN: not known."""
    size, count, most = w.gone.shape[0], w.goings[0], math.nan
    for i in range(1, min(size, count) + 1):
        row = (count - i) % size
        height = _height(w.frame, w.gone[row, 1], w.gone[row, 2], w.gone[row, 3])
        if not height <= most:
            most = height
        if w.gone[row, 0] <= since:
            break
    return float(most)


@kernel
def _learn(c: Any, own: Any, w: Any, acted: float, here: float, rushes: float, speed: float, elapsed: float) -> None:
    """Learn compliance, lag and inertia of the device from the error of a reading.

    ``acted`` and ``here``: the commanded height when it was measured, and the height read [m]; ``speed``: of the
    commands then [m/s]; ``rushes``: the acceleration of the virtual surface's height then [m/s2]; ``elapsed``: time
    since the reading before [s].
    """
    pressed = max(0.0, -w.load[2])
    off = acted - here - own[GIVE] * pressed - own[LAG] * speed - own[INERTIA] * rushes
    if not abs(off) <= ASTRAY or pressed < TOUCH:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)
    turns = rushes * rushes / (rushes * rushes + EVEN * EVEN)
    step = min(MOST_LEARNT, LEARNS * elapsed) * off
    inertia = own[INERTIA] + turns * step * rushes / (rushes * rushes + EVEN * EVEN)
    own[INERTIA] = min(MOST_INERTIA, max(0.0, inertia))
    give = own[GIVE] + (1.0 - moves) * (1.0 - turns) * step * pressed / (pressed * pressed + 0.01)
    own[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = own[LAG] + moves * (1.0 - turns) * step * speed / (speed * speed + STILL * STILL)
    own[LAG] = min(MOST_LAG, max(-MOST_LAG, lag))


@kernel
def _since(c: Any, own: Any, here: float, then: float, now: float) -> float:
    """Return how much higher the surface is now than its reading ``here`` [m].

    ``then`` and ``now``: the heights to which its commands sent it when that was measured, and now [m].  A correction
    by a new reading is no motion: it enters smoothly, or the surface would seem to rush at the finger.
    """
    if math.isnan(then) or math.isnan(now):
        own[SENT_TO] = 0.0
        return 0.0
    found = here + now - then
    off = own[PLACE] + now - own[SENT_TO] - found if own[SENT_TO] != 0.0 else 0.0
    place = found + off * math.exp(-c.period / CORRECTS) if abs(off) < ELSEWHERE else found
    own[PLACE], own[SENT_TO] = place, now
    return float(place - here)


@kernel
def _pressed(c: Any, own: Any, w: Any, here: float, age: int) -> float:
    """Return how hard the finger presses now [N]: the force read, corrected for how much deeper it has come since.

    ``here``: the height of the face by its reading [m], which was measured ``age`` ticks ago.
    """
    then = max(0.0, -w.load[2])
    if not c.has_load or not 0 <= age < PAST:
        return float(then)
    before = here - own[GONE_BY + 3 * ((w.tick[0] - age) % PAST) + 2]
    now = here + own[SINCE] - (w.hip[2] - c.radius)
    if then < LEFT or (then < TOUCH and before < -ABOUT):  # it did not touch, whatever a sensor reads without a touch
        return float(max(0.0, c.stiffness * (now - max(0.0, before))))
    if before < 0.0 and then < LEFT + SURELY * w.loud[0]:  # that may be noise: no pad is deeper for it than it seems
        return float(max(then, c.stiffness * now))
    return float(max(0.0, then + c.stiffness * (now - before)))


@kernel
def look_over_wire(c: Any, w: Any, own: Any) -> int:
    """Predict where the virtual surface will be when a command acts, and estimate where this one is now; return 0.

    ``c``: `motion.Numbers`; ``w``: `Wire`; ``own`` (n,): all fields of the modality, those behind a wire included, with
    the units of `own.FIELDS`.
    """
    tick = w.tick[0]
    was = GONE_BY + 3 * ((tick - 1) % PAST)
    own[was], own[was + 1] = own[RESTS], own[BENDS]
    own[GONE_BY + 3 * (tick % PAST) + 2] = w.hip[2] - c.radius
    _follow(c, own, 0, w.hip[0])
    _follow(c, own, 1, w.hip[1])
    _follow_lift(c, own, w.lifts[0])
    _watch_wire(c, own, w)
    here = _height(w.frame, w.pose[0], w.pose[1], w.pose[2])
    measured = w.measured[0]
    acted = _commanded(c, own, w, measured - 1.0)
    if measured > own[READ_AT]:
        elapsed = min(LONGEST, (measured - own[READ_AT]) * c.period)
        own[READ_AT] = measured
        past = GONE_BY + 3 * ((measured - 1) % PAST)
        rested = own[past] > RESTED + own[HOLD]
        if 0 < tick - measured < PAST - 1 and rested and not math.isnan(acted):
            span = max(own[HOLD], SPAN)
            speed = (acted - _commanded(c, own, w, measured - 1.0 - span / c.period)) / span
            _learn(c, own, w, acted, here, own[past + 1], speed, elapsed)
    late = max(0.0, own[LAG]) / c.period
    now, then = _commanded(c, own, w, tick - 1.0 - late), _commanded(c, own, w, measured - 1.0 - late)
    own[SINCE] = _since(c, own, here, then, now)
    highest = _highest(w, measured - 1.0 - late)
    own[AT_MOST] = own[SINCE] if math.isnan(highest) else max(0.0, own[SINCE], highest - here)
    acts = _commanded(c, own, w, tick - 1.0)
    own[BEHIND] = 0.0 if math.isnan(acts) else acts - here - own[SINCE]
    own[PRESSES] = _pressed(c, own, w, top(c, w.frame, w.pose), tick - measured)  # the pose is not that of the face
    ahead = own[WAY] + c.period + own[LAG]
    x = ahead * (own[GOES + 1] + 0.5 * ahead * own[GOES + 2])
    y = ahead * (own[GOES + 4] + 0.5 * ahead * own[GOES + 5])
    own[RISE] = w.slope_x[0] * x + w.slope_y[0] * y + ahead * (own[LIFTS] + 0.5 * ahead * own[HOISTS])
    return 0
