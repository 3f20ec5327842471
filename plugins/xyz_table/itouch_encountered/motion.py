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
    BENDS,
    CLIMBED,
    COMING,
    DISTANCE,
    GAP,
    GIVE,
    HIGH,
    INERTIA,
    LAG,
    LEFT,
    LOST,
    PRESS,
    TAKES,
    TOUCH,
    YIELDS,
)

#: How fast it leaves a finger or comes to it in a contact, while it may be felt and while it is clear [m/s].
SOFTLY, QUICKLY = 0.015, 0.1
#: How near below the finger it may be felt soon [m].
SOON = 1.5e-3
#: An arm at its limit makes room for one that is nearer than this [m] after so long at the speed with which it comes
#: [s]: one that comes no faster takes nothing from the arm before it is there.
MADE, MAKES = 1e-3, 0.022
#: One that is further behind its command than this is waited for, so that it does not come in a hurry [m].
BEHIND = 2e-4
#: What a command may be ahead of the one sent last and not be held up [m].
SLACK = 3e-5
#: Gap [m] over which the arm takes over the normal force from a surface that is too low.
HAND_OVER = 1e-3
#: How fast it yields above its greatest force [m/s per N], and how fast it comes back [m/s].
YIELD_RATE, YIELD_RETURN = 0.02, 0.005
#: How fast its force goes from a finger whose virtual surface falls away [N/s]: 0.1 N a tick is felt.
FALLS = 45.0
#: How it brakes as it comes up to a finger that it may meet [m/s2], or else would push; below what speed it need not
#: [m/s].
BRAKES, CALM = 1.0, 0.03
#: How far a device may be behind as it goes up to a finger that is so near [m]: it would make up for it in a hurry.
LEADS, NEAR = 1e-3, 0.02
#: How far ahead its force is seen, for a device needs time [s].
AHEAD = 0.008
#: How fast it is learned how far the device gives way and how late it is [1/s], the most that is made good [m/N], [s],
#: and what is another error than that [m].
LEARNS, MOST_GIVE, MOST_LAG, ASTRAY = 80.0, 1e-4, 0.005, 1e-4
#: How far behind an axis is for each m/s2 if the bandwidth of its control is 50 Hz [s2], from where on it is learned;
#: and the most that is made good, that of 22 Hz.
INERTIA_FIRST, MOST_INERTIA = 1.0e-5, 5e-5
#: How fast that speed may change [m/s2] well below which what a device misses is not by its inertia.
EVEN = 4.0
#: Speed up or down [m/s] well below which what a device misses is by the force on it, and well above by its lag.
STILL = 0.01


class Numbers(NamedTuple):
    """What never changes; lengths [m], forces [N].

    ``cosine`` and ``back``: of the steepest slope that it renders, and of that below which it takes a contact back;
    ``most``: its greatest force beside the scene's limit; ``reach``: how far the device goes in a tick; ``early``: how
    far below the finger it may be and still be too high; ``x``, ``y``, ``z``: of its face on what the device carries.
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
    x: float
    y: float
    z: float


class Seen(NamedTuple):
    """What it reads of State: arrays, of one number where no shape is given.

    ``frame`` (12,): of the device; ``pose`` and ``sent`` (7,): where it is and was sent; ``load`` (6,): the force on
    it; ``hip`` and ``normal`` (3,): of finger and touched surface; ``height``, ``upright``, ``climb``: of the virtual
    surface below; ``level``, ``sink``, ``off``: of the finger's lowest point; then what the framework makes of the
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
    level: Any
    sink: Any
    off: Any
    pressed: Any
    present: Any
    object: Any
    withdrawn: Any
    ready: Any


@kernel
def _top(c: Any, frame: Any, pose: Any) -> float:
    """Return the height of the face [m] in the world, for a pose (7,) of the device."""
    x, y, z = pose[0] + c.x, pose[1] + c.y, pose[2] + c.z
    return float(frame[9] * x + frame[10] * y + frame[11] * z + frame[2])


@kernel
def _come(
    c: Any, own: Any, goal: float, last: float, level: float, sink: float, depth: float, pressed: float,
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
    if own[PRESS] < depth + BEHIND:
        pace = SOFTLY if felt else min(QUICKLY, max(SOFTLY, (-own[PRESS] - MADE) / MAKES))
        own[PRESS] += pace * c.period
    if level + own[PRESS] >= goal:
        own[ARRIVED] = 1.0


@kernel
def _go(c: Any, own: Any, last: float, pressed: float, touching: bool) -> None:
    """Take it away from the finger, by the clearance, or further if it is still felt there.

    ``last`` is where it was sent last, less the height of the finger [m]; at that time, so that it goes with a finger.
    """
    full, felt, high = -c.clearance, pressed > LEFT, own[LOST] == HIGH
    if own[ARRIVED] > 0.0:
        own[ARRIVED], own[PRESS] = 0.0, last if high else max(last, full)
    if not touching and not felt:
        own[PRESS] = min(own[PRESS], full) if high else full
        return
    way = (SOFTLY if not high and (felt or own[PRESS] > -SOON) else QUICKLY) * c.period
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
def _bend(c: Any, own: Any, climb: float, goes_on: bool) -> None:
    """Follow how fast the speed of the virtual surface's height changes, in a contact that goes on."""
    bends = (climb - own[CLIMBED]) / c.period if goes_on else 0.0
    own[BENDS] = own[BENDS] + 0.5 * (bends - own[BENDS]) if goes_on else 0.0  # what changes to and fro is noise
    own[CLIMBED] = climb


@kernel
def _learn(c: Any, own: Any, speed: float, last: float, here: float, pressed: float) -> None:
    """Learn by how much the device misses its command, where nothing but the virtual surface moves it.

    It misses it by so much for each newton on it, for each m/s up or down, and for each m/s2 by which that changes.
    """
    bends = own[BENDS]
    off = last - here - own[GIVE] * pressed - own[LAG] * speed - own[INERTIA] * bends
    if abs(off) > ASTRAY:
        return
    moves = speed * speed / (speed * speed + STILL * STILL)  # 1: what is seen is the lag, 0: it is the force
    turns = bends * bends / (bends * bends + EVEN * EVEN)  # 1: what is seen is the inertia
    step = LEARNS * c.period * off
    inertia = own[INERTIA] + turns * step * bends / (bends * bends + EVEN * EVEN)
    own[INERTIA] = min(MOST_INERTIA, max(0.0, inertia))
    step *= 1.0 - turns
    give = own[GIVE] + (1.0 - moves) * step * pressed / (pressed * pressed + 0.01)
    own[GIVE] = min(MOST_GIVE, max(0.0, give))
    lag = own[LAG] + moves * step * speed / (speed * speed + STILL * STILL)
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
    pressed: float, touching: bool, begins: bool,
) -> float:  # fmt: skip
    """Return the height [m] at which it is wanted, and say how far it is still to come or to go."""
    away = lowest - c.clearance
    goal = (
        height + climb * (c.period + own[LAG]) + own[BENDS] * own[INERTIA] + (own[GIVE] * pressed if touching else 0.0)
    )
    if own[TAKES] > 0.0:
        _come(c, own, goal, last, level, sink, here - lowest, pressed, touching, begins)
        own[COMING] = 0.0 if own[ARRIVED] > 0.0 else max(1e-6, goal - level - own[PRESS])
    else:
        before = last - level + (0.0 if own[LOST] == HIGH else sink * c.period)
        _go(c, own, before, pressed, touching)
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
def _fall(c: Any, own: Any, wanted: float, last: float, sink: float, pressed: float) -> float:
    """Return how low it may be wanted [m]: what falls away under a finger leaves it no faster than the pad eases.

    A finger that goes up by itself eases the pad already; ``last``: the height it was sent to last [m].
    """
    if pressed <= LEFT or own[LOST] == HIGH:
        return wanted
    return float(max(wanted, last + min(0.0, sink - FALLS / c.stiffness) * c.period))


@kernel
def _brake(c: Any, wanted: float, climb: float, last: float, here: float, level: float) -> float:
    """Return how high it may be wanted [m] as it comes up to a surface that a finger is near, or on; ``level`` [m]."""
    way = wanted - last
    if way > 0.0 and last - here > LEADS and level - here < NEAR:
        return last
    if way <= 0.0 or level - wanted > SOON:
        return wanted
    speed = max(0.0, climb) + max(CALM, math.sqrt(2.0 * BRAKES * way))
    return float(min(wanted, last + speed * c.period))


@kernel
def _bearable(c: Any, own: Any, climb: float, level: float, sink: float, off: float) -> float:
    """Return the greatest height [m] at which it presses no harder than it may.

    A finger that comes down takes it along: the device is told ahead of time where it will be.
    """
    goes = min(0.0, climb)
    soon = level + min(0.0, sink - goes) * AHEAD
    return float(soon + off + c.most / c.stiffness)


@kernel
def _command(c: Any, frame: Any, sent: Any, hip: Any, goal: Any, height: float, felt: bool) -> None:
    """Write the command (7,): the face under the finger at a height [m]; where it is felt it gives way first."""
    x, y, z = hip[0] - frame[0], hip[1] - frame[1], height - frame[2]
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
    the command; ``own`` (17,): its own fields.
    """
    frame, sent, hip = seen.frame, seen.sent, seen.hip
    height, climb, level, sink = seen.height[0], seen.climb[0], seen.level[0], seen.sink[0]
    lowest, here, last = hip[2] - c.radius, _top(c, frame, seen.pose), _top(c, frame, sent)
    pressed, touching, withdrawn = max(0.0, -seen.load[2]), seen.object[0] >= 0, seen.withdrawn[0] != 0
    own[GAP] = height - here if height > -np.inf else np.inf
    own[DISTANCE] = lowest - here
    if withdrawn:
        own[LOST] = 0.0
    choose(c, own, along(frame, seen.normal) if touching else seen.upright[0], touching, withdrawn)
    if seen.ready[0] != 0 and c.has_load and own[LOST] == 0.0 and not withdrawn:
        doubt(c, own, here - lowest, pressed, touching)
        if own[LOST] == 0.0:
            touches_unasked(c, own, here - lowest, pressed, touching)
    begins = touching and seen.pressed[0] == 0.0
    _bend(c, own, climb, touching and not begins)
    wanted = _wanted(c, own, height, climb, level, sink, lowest, here, last, pressed, touching, begins)
    wanted = _fall(c, own, _brake(c, wanted, climb, last, here, level), last, sink, pressed)
    most = _bearable(c, own, climb, level, sink, seen.off[0])
    still = own[TAKES] > 0.0 and own[ARRIVED] > 0.0 and wanted <= most
    if still and touching and pressed >= TOUCH and own[YIELDS] <= 0.0:
        _learn(c, own, climb, last, here, pressed)
    _command(c, frame, sent, hip, goal, min(wanted, most), touching or pressed > LEFT)
    own[AT_FINGER] = 1.0 if touching and _there(own, seen.present[0] > 0.0, here - lowest, pressed) else 0.0
    return 0
