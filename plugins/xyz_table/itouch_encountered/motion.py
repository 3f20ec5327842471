"""Where the surface goes.

With s the height at which the finger would rest on the highest virtual surface below it, f the lowest point of the
finger and c the clearance, its top goes to max(s, f - c); x and y follow the finger.  It renders contacts whose normal
is near its own.  From others it withdraws to f - c and touches nothing: they are the arm's alone.  Which of the two it
is may change while the contact lasts.  Then it leaves the finger, or comes to it, slowly *against the finger* while it
may be felt, however the finger moves.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin.kernels import kernel
from itouch_encountered.choosing import along, choose, doubt, touches_unasked
from itouch_encountered.own import (
    ABOUT,
    ARRIVED,
    AT_FINGER,
    BEHIND,
    BENDS,
    COMING,
    DISTANCE,
    GAP,
    GIVE,
    HASTE,
    HERE,
    HIGH,
    INERTIA,
    KINKS,
    LAG,
    LEFT,
    LOST,
    PRESS,
    PRESSES,
    RESTS,
    RISE,
    RUSHES,
    SHIFT,
    SINCE,
    SPEED,
    TAKES,
    TOUCH,
    WAY,
    YIELDS,
)

#: How fast it leaves a finger or comes to it in a contact, while it may be felt and while it is clear [m/s].
SOFTLY, QUICKLY = 0.015, 0.1
#: How much faster it leaves one that comes down, for each m/s of that: soon it may come down faster than a device can.
FLEES = 0.25
#: How near below the finger it may be felt soon [m].
SOON = 1.5e-3
#: An arm at its limit makes room for one that is nearer than this [m] after so long at the speed with which it comes
#: [s]: one that comes no faster takes nothing from the arm before it is there.
MADE, MAKES = 1e-3, 0.022
#: One that is further behind its command than this is waited for, so that it does not come in a hurry [m].
WAITED_FOR = 2e-4
#: What a command may be ahead of the one sent last and not be held up [m].
SLACK = 3e-5
#: Gap [m] over which the arm takes over the normal force from a surface that is too low.
HAND_OVER = 1e-3
#: How fast it yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: How fast its force goes from a finger whose virtual surface falls away, at once and at last [N/s]: 0.1 N a tick is
#: felt; and by how much faster it falls then from tick to tick [m/s].
FALLS, MOST_FALLS, FASTER = 45.0, 60.0, 0.005
#: How it brakes as it comes up to a finger that it may meet [m/s2], or else would push; below what speed it need not
#: [m/s].
BRAKES, CALM = 3.0, 0.03
#: How it slows down as it comes to where the virtual surface is, while it is felt [m/s2]: what stops at once is felt.
EASES = 4.0
#: How far a device may be behind as it goes up to a finger that is so near [m]: it would make up for it in a hurry.
LEADS, NEAR = 1e-3, 0.02
#: How far ahead its force is seen, for a device needs time [s].
AHEAD = 0.008
#: How fast it is learned how far the device gives way and how late it is [1/s], the most that is made good [m/N], [s],
#: and what is another error than that [m].
LEARNS, MOST_GIVE, MOST_LAG, ASTRAY = 80.0, 1e-4, 0.005, 1e-4
#: How far behind an axis is for each m/s2 if the bandwidth of its control is 40 Hz [s2], from where on it is learned;
#: and the most that is made good, that of 22 Hz.
INERTIA_FIRST, MOST_INERTIA = 1.6e-5, 5e-5
#: Damping ratio of such a control [1]; by how much it is sent higher or lower for that at most [m].
DAMPING_RATIO, MOST_SHIFT = 0.9, 3e-4
#: How far ahead of the finger the framework looks at the slope [s].
SEEN_AHEAD = 0.003
#: What is so far from where it was a tick ago [m] has not gone there: it is seen for the first time.
ELSEWHERE = 5e-3
#: How fast that speed may change [m/s2] well below which what a device misses is not by its inertia.
EVEN = 2.0
#: Cosine of the angle of a face from which on it is no face for a finger.
STEEPEST = 0.1
#: Speed up or down [m/s] well below which what a device misses is by the force on it, and well above by its lag.
STILL = 0.06


class Numbers(NamedTuple):
    """What never changes; lengths [m], forces [N].

    ``cosine`` and ``back``: of the steepest slope that it renders, and of that below which it takes a contact back;
    ``most``: its greatest force beside the scene's limit; ``reach``: how far the device goes in a tick; ``early``: how
    far below the finger it may be and still be too high; ``ahead``: how many ticks ahead of time it is seen how the
    slope turns; ``x``, ``y``, ``z``: of its face on what the device carries; ``wire``: whether its readings come late,
    and not in every tick.
    """

    radius: float
    clearance: float
    cosine: float
    back: float
    period: float
    limit: float
    most: float
    stiffness: float
    has_load: bool
    reach: float
    early: float
    ahead: int
    x: float
    y: float
    z: float
    wire: bool = False


class Seen(NamedTuple):
    """What it reads of State: arrays, of one number where no shape is given.

    ``frame`` (12,): of the device; ``pose`` and ``sent`` (7,): where it is and was sent; ``load`` (6,): the force on
    it; ``hip`` and ``normal`` (3,): of finger and touched surface; ``height``, ``upright``, ``climb``: of the virtual
    surface below, and how fast ``climb`` changes, as that ``turns`` and as finger or object ``hastens``; how fast this
    surface ``rises``; ``level``, ``sink``, ``off``: of the finger's lowest point; then what the framework makes of the
    contact.
    """

    frame: Any
    pose: Any
    sent: Any
    load: Any
    hip: Any
    normal: Any
    height: Any
    upright: Any
    climb: Any
    turns: Any
    hastens: Any
    rises: Any
    level: Any
    sink: Any
    off: Any
    pressed: Any
    present: Any
    object: Any
    withdrawn: Any
    ready: Any


@kernel
def _beside(c: Any, frame: Any) -> float:
    """Return how much higher than the point of the face below a finger its lowest point is as they touch [m].

    0 on a level face; a ball rests on a face that is mounted at an angle beside that point.
    """
    return float(c.radius * (1.0 / max(STEEPEST, frame[11]) - 1.0))


@kernel
def _top(c: Any, frame: Any, pose: Any) -> float:
    """Return how high [m] in the world the lowest point of a finger on the face is, for a pose (7,) of the device."""
    x, y, z = pose[0] + c.x, pose[1] + c.y, pose[2] + c.z
    return float(frame[9] * x + frame[10] * y + frame[11] * z + frame[2] + _beside(c, frame))


@kernel
def _come(
    c: Any, own: Any, goal: float, climb: float, last: float, level: float, sink: float, depth: float, pressed: float,
    touching: bool, begins: bool,
) -> None:  # fmt: skip
    """Bring it to the finger, until it is at its goal [m]; ``depth``: how far it is in the finger [m].

    ``last`` is the height [m] to which it was sent last: what is in its way must not make it hurry later.
    """
    felt = pressed > LEFT
    if not touching and not felt:
        own[ARRIVED] = 1.0
        return
    if own[ARRIVED] > 0.0 and (begins or not felt) and depth < -ABOUT:  # not there in time, or left behind
        own[ARRIVED], own[PRESS] = 0.0, depth
    if own[ARRIVED] > 0.0:
        return
    own[PRESS] = min(own[PRESS], last - level + sink * c.period + SLACK)
    if (own[BEHIND] if c.wire else own[PRESS] - depth) < WAITED_FOR:
        pace = SOFTLY if felt else min(QUICKLY, max(SOFTLY, (-own[PRESS] - MADE) / MAKES))
        if felt:  # it goes on with the virtual surface, not with the finger
            left = max(0.0, goal - level - own[PRESS])
            pace = min(pace, climb - sink + math.sqrt(2.0 * EASES * left))
        own[PRESS] += pace * c.period
    if level + own[PRESS] >= goal:
        own[ARRIVED] = 1.0


@kernel
def _go(c: Any, own: Any, last: float, sink: float, pressed: float, touching: bool) -> None:
    """Take it away from the finger, by the clearance, or further if it is still felt there.

    ``last`` is where it was sent last, less the height of the finger [m]; at that time, so that it goes with a finger.
    """
    full, felt, high = -c.clearance, pressed > LEFT, own[LOST] == HIGH
    if own[ARRIVED] > 0.0:
        own[ARRIVED], own[PRESS] = 0.0, last if high else max(last, full)
    if not touching and not felt:
        own[PRESS] = min(own[PRESS], full) if high else full
        return
    softly = SOFTLY + FLEES * max(0.0, -sink)
    way = (softly if not high and (felt or own[PRESS] > -SOON) else max(softly, QUICKLY)) * c.period
    own[PRESS] = own[PRESS] - way if felt and high else min(own[PRESS], max(full, own[PRESS] - way))
    if not felt and not high:  # one that a finger left behind does not come after it
        own[PRESS] = min(own[PRESS], max(full, last))


@kernel
def _sink_below(c: Any, own: Any, surface: float, last: float, felt: bool) -> None:
    """Go no higher than the virtual surface on the way from the finger, and stay as low as it came by that.

    ``surface`` and ``last``, where it was sent last: heights [m] above the finger's lowest point.
    """
    lowest = last - 2.0 * SOFTLY * c.period if felt else -np.inf
    own[PRESS] = min(own[PRESS], max(surface, lowest))


@kernel
def _smoothed(c: Any, own: Any, before: float, bends: float) -> float:
    """Return an acceleration [m/s2] smoothed as a position control that follows it must be given more.

    What keeps to a height x by a control of a bandwidth w [rad/s] and a damping ratio d must be sent u more, where
    2 d / w u' + u = x'' / w2.
    """
    return float(before + (bends - before) * c.period / (2.0 * DAMPING_RATIO * math.sqrt(own[INERTIA]) + c.period))


@kernel
def _bend(c: Any, own: Any, turns: float, hastens: float, goes_on: bool) -> float:
    """Follow how fast the speed of the virtual surface's height changes, in a contact that goes on.

    No device changes its speed at once: a kink is rounded off, from as long before the finger is there as it is seen
    ahead of time to as long after that.  Return how much higher than the virtual surface that is now [m].
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
        # So far it has gone with a speed that grows from tick to tick, and the surface since it turned, at once.
        rounds += turned * (0.5 * i * (i + 1) / ticks - max(0.0, i - c.ahead + 0.5))
    slope = _smoothed(c, own, own[BENDS] - own[HASTE], mean)
    own[HASTE] += 0.5 * (hastens - own[HASTE])  # what changes to and fro is noise; a finger's speed is smoothed already
    own[BENDS] = slope + own[HASTE]
    return float(rounds * c.period * c.period)


@kernel
def _watch(c: Any, own: Any, here: float, climb: float) -> None:
    """Follow how fast it rises by its own reading ``here`` [m], and how that changes.

    Behind a wire readings come now and then: there it is taken to go as its virtual surface does, ``climb``.
    """
    if c.wire:
        own[HERE], own[SPEED], own[RUSHES] = here, climb, own[BENDS]
        return
    if abs(here - own[HERE]) > ELSEWHERE:
        own[HERE], own[SPEED], own[RUSHES] = here, 0.0, 0.0
    speed = (here - own[HERE]) / c.period
    own[RUSHES] = _smoothed(c, own, own[RUSHES], (speed - own[SPEED]) / c.period)
    own[HERE], own[SPEED] = here, speed


@kernel
def _learn(c: Any, own: Any, last: float, here: float, pressed: float) -> None:
    """Learn by how much the device misses its command.

    It misses it by so much for each newton on it, for each m/s up or down, and for each m/s2 by which that changes.
    """
    speed, rushes = own[SPEED], own[RUSHES]
    off = last - here - own[GIVE] * pressed - own[LAG] * speed - own[INERTIA] * rushes
    if abs(off) > ASTRAY:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)  # 1: what is seen is the lag, 0: it is the force
    turns = rushes * rushes / (rushes * rushes + EVEN * EVEN)  # 1: what is seen is the inertia
    step = LEARNS * c.period * off
    lets = (1.0 - turns) * step
    if pressed >= TOUCH:  # in the air it goes as fast as it can, and its control is at its limits
        inertia = own[INERTIA] + turns * step * rushes / (rushes * rushes + EVEN * EVEN)
        own[INERTIA] = min(MOST_INERTIA, max(0.0, inertia))
        give = own[GIVE] + (1.0 - moves) * lets * pressed / (pressed * pressed + 0.01)
        own[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = own[LAG] + moves * lets * speed / (speed * speed + STILL * STILL)
    own[LAG] = min(MOST_LAG, max(-MOST_LAG, lag))


@kernel
def _give_way(c: Any, own: Any, pressed: float) -> float:
    """Give way while it presses harder than it may."""
    if pressed > c.limit:
        own[YIELDS] += YIELD_RATE * (pressed - c.limit) * c.period
    elif pressed < 0.9 * c.limit:
        own[YIELDS] = max(0.0, own[YIELDS] - YIELD_RETURN * c.period)
    return float(own[YIELDS])


@kernel
def _wanted(
    c: Any, own: Any, height: float, climb: float, level: float, sink: float, lowest: float, here: float, last: float,
    pressed: float, touching: bool, begins: bool, shift: float,
) -> float:  # fmt: skip
    """Return the height [m] at which it is wanted, and say how far it is still to come or to go."""
    away = lowest - c.clearance
    ahead = own[RISE] if c.wire else climb * (c.period + own[LAG])
    goal = height + ahead + shift + (own[GIVE] * pressed if touching else 0.0)
    if own[TAKES] > 0.0:
        _come(c, own, goal, climb, last, level, sink, here - lowest, pressed, touching, begins)
        own[COMING] = 0.0 if own[ARRIVED] > 0.0 else max(1e-6, goal - level - own[PRESS])
    else:
        before = last - level + (0.0 if own[LOST] == HIGH else sink * c.period)
        _go(c, own, before, sink, pressed, touching)
        if height > -np.inf:
            _sink_below(c, own, max(goal, away) - level, before, touching and pressed > LEFT)
        own[COMING] = max(0.0, own[PRESS] + c.clearance)
    if own[ARRIVED] > 0.0:
        return float(max(goal - _give_way(c, own, pressed), away))
    own[YIELDS] = 0.0  # what it yielded is in how far it is in the finger
    found = level + own[PRESS]
    comes = own[TAKES] > 0.0 and height > -np.inf
    return float(max(goal, away) if comes and found > goal else found)


@kernel
def _fall(c: Any, own: Any, wanted: float, last: float, sink: float, pressed: float, touching: bool) -> float:
    """Return how low it may be wanted [m]: what falls away under a finger leaves it no faster than the pad eases.

    A finger that goes up by itself eases the pad already.  In a contact that goes on it follows what falls away under
    it all the same, and what falls as fast already may fall a little faster, for the pad's damping feels how its speed
    changes.  ``last``: the height it was sent to last [m].
    """
    if pressed <= LEFT or own[LOST] == HIGH:
        return wanted
    speed = sink - FALLS / c.stiffness
    if touching:
        speed = min(-SOFTLY, max(sink - MOST_FALLS / c.stiffness, min(speed, own[SPEED] - FASTER)))
    return float(max(wanted, last + min(0.0, speed) * c.period))


@kernel
def _brake(c: Any, own: Any, wanted: float, climb: float, last: float, here: float, level: float, more: float) -> float:
    """Return how high it may be wanted [m] as it comes up to a surface that a finger is near, or on; ``level`` [m].

    What it is sent ``more`` than a tick ago, because the virtual surface bends, is not braked: it keeps to it by that.
    """
    way = wanted - last
    if way > 0.0 and (own[BEHIND] if c.wire else last - here) > LEADS and level - here < NEAR:
        return last
    if way <= 0.0 or level - wanted > SOON:
        return wanted
    speed = max(0.0, climb) + max(CALM, math.sqrt(2.0 * BRAKES * way))
    return float(min(wanted, last + speed * c.period + max(0.0, more)))


@kernel
def _bearable(c: Any, own: Any, rises: float, level: float, sink: float, off: float) -> float:
    """Return the greatest height [m] at which it presses no harder than it may.

    A finger that comes down takes it along: the device is told ahead of time where it will be.  ``rises``: how fast it
    goes up or down by itself [m/s].
    """
    ahead = AHEAD + own[WAY] if c.wire else AHEAD
    soon = level + min(0.0, sink - min(0.0, rises)) * ahead
    return float(soon + off + c.most / c.stiffness)


@kernel
def _command(c: Any, frame: Any, sent: Any, hip: Any, goal: Any, height: float, felt: bool) -> None:
    """Write the command (7,): the face so that a finger on it has its lowest point at a height [m].

    Where it is felt it gives way first.
    """
    x, y, z = hip[0] - frame[0], hip[1] - frame[1], height - _beside(c, frame) - frame[2]
    goal[0] = frame[3] * x + frame[6] * y + frame[9] * z - c.x
    goal[1] = frame[4] * x + frame[7] * y + frame[10] * z - c.y
    goal[2] = frame[5] * x + frame[8] * y + frame[11] * z - c.z
    goal[3], goal[4], goal[5], goal[6] = 1.0, 0.0, 0.0, 0.0
    down = sent[2] - goal[2]
    aside = math.sqrt((goal[0] - sent[0]) ** 2 + (goal[1] - sent[1]) ** 2)
    left = math.sqrt(max(0.0, c.reach * c.reach - down * down))
    if felt and down > 0.0 and aside > left:
        for i in range(2):
            goal[i] = sent[i] + (goal[i] - sent[i]) * left / aside


@kernel
def _there(own: Any, before: bool, depth: float, pressed: float) -> bool:
    """Tell whether it is at the finger, or about to be; ``depth``: how far the finger seems to be in it [m]."""
    if depth > -ABOUT or (own[TAKES] > 0.0 and (own[ARRIVED] > 0.0 or own[PRESS] > -HAND_OVER)):
        return True
    return bool(pressed > (LEFT if before else TOUCH))


@kernel
def carry(c: Any, seen: Any, goal: Any, own: Any) -> int:
    """Say who renders the virtual surface below the finger, and command the device; return 0.

    ``c``: `Numbers`; ``seen``: `Seen`, taken apart here, for a tuple of many arrays is dear to hand on; ``goal`` (7,):
    the command; ``own``: its own fields, (45,) without a wire.
    """
    frame, sent, hip = seen.frame, seen.sent, seen.hip
    height, climb, level, sink = seen.height[0], seen.climb[0], seen.level[0], seen.sink[0]
    lowest, here, last = hip[2] - c.radius, _top(c, frame, seen.pose), _top(c, frame, sent)
    pressed, touching, withdrawn = max(0.0, -seen.load[2]), seen.object[0] >= 0, seen.withdrawn[0] != 0
    if c.wire:
        here, pressed = here + own[SINCE], own[PRESSES]
    own[GAP] = height - here if height > -np.inf else np.inf
    own[DISTANCE] = lowest - here
    if withdrawn:
        own[LOST] = 0.0
    upright = seen.upright[0]  # of what it would go to; what the finger touches may be another face
    choose(c, own, min(upright, along(frame, seen.normal)) if touching else upright, touching, withdrawn)
    if seen.ready[0] != 0 and c.has_load and own[LOST] == 0.0 and not withdrawn:
        doubt(c, own, here - lowest, pressed, touching)
        if own[LOST] == 0.0:
            touches_unasked(c, own, here - lowest, pressed, touching)
    begins = touching and seen.pressed[0] == 0.0
    _watch(c, own, here, climb)
    rounds = _bend(c, own, seen.turns[0], seen.hastens[0], touching and not begins)
    if c.wire:
        rounds = 0.0  # it goes to where the surface is by then
    shift = min(MOST_SHIFT, max(-MOST_SHIFT, rounds + own[BENDS] * own[INERTIA])) if own[TAKES] > 0.0 else 0.0
    more, own[SHIFT] = shift - own[SHIFT], shift
    wanted = _wanted(c, own, height, climb, level, sink, lowest, here, last, pressed, touching, begins, shift)
    wanted = _fall(c, own, _brake(c, own, wanted, climb, last, here, level, more), last, sink, pressed, touching)
    most = _bearable(c, own, seen.rises[0], level, sink, seen.off[0])
    still = own[TAKES] > 0.0 and own[ARRIVED] > 0.0 and wanted <= most
    rests = still and touching and pressed >= TOUCH and own[YIELDS] <= 0.0
    if c.wire:
        own[RESTS] = own[RESTS] + c.period if rests else 0.0
    elif rests or (not touching and pressed < LEFT and own[LOST] == 0.0):
        _learn(c, own, last, here, pressed)
    _command(c, frame, sent, hip, goal, min(wanted, most), touching or pressed > LEFT)
    own[AT_FINGER] = 1.0 if touching and _there(own, seen.present[0] > 0.0, here - lowest, pressed) else 0.0
    return 0
