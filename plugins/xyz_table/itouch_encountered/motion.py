"""The motion of the surface: where it is sent in each tick.

Let s be the height at which the finger's lowest point would rest on the highest virtual surface below it, f the height
of that point now, and c the clearance.  The top of the surface is sent to the height max(s, f - c); x and y follow the
finger.  The surface renders contacts whose normal is close to its own.  From others it withdraws to f - c and touches
nothing: the arm alone renders them.  A contact may change hands while it lasts.  The surface then leaves the finger, or
comes to it, slowly *relative to the finger* while it may be felt, however the finger moves.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from itouch.plugin.carried_surfaces import (
    ABOUT,
    AHEAD,
    HAND_OVER,
    HIGH,
    LEFT,
    STEEPEST,
    TOUCH,
    YIELD_RATE,
    YIELD_RETURN,
)
from itouch.plugin.kernels import kernel, linked
from itouch_encountered.choosing import along, choose, doubt, touches_unasked
from itouch_encountered.feed_forward import bend, learn, watch
from itouch_encountered.surface_fields import (
    ARRIVED,
    AT_FINGER,
    AT_MOST,
    BEHIND,
    BENDS,
    COMING,
    DISTANCE,
    EVENED,
    EVENED_X,
    EVENED_Y,
    EVENED_Z,
    GAP,
    GIVE,
    INERTIA,
    LAG,
    LOST,
    ORIGIN,
    ORIGIN_Z,
    PRESS,
    PRESSES,
    RESTS,
    RISE,
    ROW_X,
    ROW_Y,
    ROW_Z,
    SHIFT,
    SINCE,
    SLOWER,
    SPEED,
    TAKES,
    UPRIGHT,
    WAITED,
    WAY,
    YIELDS,
)

#: Speed relative to the finger [m/s] with which the surface leaves it or comes to it in a contact: while the surface
#: may be felt, and while it is clear of the finger.
SOFTLY, QUICKLY = 0.015, 0.1
#: With what force [N] at most the surface meets a finger in the first millisecond as it comes to it: the pad's damping
#: acts at once.  To a stiffer or more damped pad than usual it comes slower than `SOFTLY`.
MEETS = 0.045
#: How much faster it leaves a finger that comes down, for each m/s of the finger's speed: soon the finger may come down
#: faster than the device can.
FLEES = 0.25
#: Distance below the finger [m] within which the surface may be felt soon.
SOON = 1.5e-3
#: Nearer than this [m] below the finger, the surface may wait for a finger that turns; farther away it only slows down.
NEXT = 5e-4
#: How late the surface follows a finger that slows down on its way up, or turns [s]: what its smoothed speed and the
#: device's control take; and the deceleration below which that is not felt [m/s2].
LATE, STEADY = 0.013, 0.5
#: By how much less the surface comes for that at most, before it meets the finger all the same [m], and over what part
#: of it that ends: a finger that trembles, or that a material shakes, turns again and again.
WAITS, ENDS = 3e-3, 1e-3
#: An arm at its force limit makes room for a surface that, at its present speed, will be nearer to the finger than this
#: [m] in this time [s]: a surface that comes no faster than that takes no force from the arm before it is there.
MADE, MAKES = 1.2e-3, 0.022
#: MADE behind a wire [m]: the plate is later there anyway.
MADE_WIRED = 1e-3
#: A surface that is farther behind its command than this [m] is waited for, so that it does not rush to catch up.
WAITED_FOR = 2e-4
#: How fast, at most, the surface goes sideways past a finger that touches it or soon may, to catch up with it [m/s]:
#: well below the speed past a finger at which safety stops it (K5).
PASSES = 0.1
#: How far the wanted height may be ahead of the one sent last [m] before it counts as held up.
SLACK = 3e-5
#: How fast the force on a finger may decrease when its virtual surface falls away, at first and at most [N/s], because
#: 0.1 N a tick is felt; and by how much the surface may then fall faster from tick to tick [m/s].
FALLS, MOST_FALLS, FASTER = 45.0, 60.0, 0.005
#: Deceleration with which it comes up to a finger that it may meet [m/s2], so as not to push the finger; and
#: the speed below which it need not brake [m/s].
BRAKES, CALM = 3.0, 0.03
#: Deceleration with which it arrives at the virtual surface while it is felt [m/s2]: an abrupt stop would be felt.
EASES = 4.0
#: How far a device may be behind its command on the way up to a finger, and within what distance of the finger that
#: matters [m]: it would rush to catch up.
LEADS, NEAR = 1e-3, 0.02
#: The most by which the surface is sent higher or lower because the virtual one bends [m].
MOST_SHIFT = 3e-4
#: Cosines of the tilts from which on the height of a face is evened out, and evened out wholly [1]: the steeper it is,
#: the larger the steps in which it follows a finger whose place an arm reads in steps.
EVENED_FROM, EVENED_AT = math.cos(math.radians(30.0)), math.cos(math.radians(35.0))
#: Time constant [s] with which the evened height follows what its speed did not foretell, and the difference from which
#: on it begins anew [m].
EVENLY, ANEW = 1.5e-3, 1e-3
#: How long at least [s] the surface takes to follow a step in which an arm reads the finger's place.  A drive is told
#: how fast its goal moves: in a shorter tick a step would ask for more than it can do, and it would be late.
STEPS = 1e-3
#: The rotation of a device that is sent upright, as a quaternion.
UPRIGHT_POSE = (1.0, 0.0, 0.0, 0.0)


class Numbers(NamedTuple):
    """The constants of the motion; lengths [m], forces [N], ``period`` [s], ``stiffness`` of the finger's pad [N/m].

    ``cosine`` and ``back``: cosines of the steepest slope that the surface renders, and of the slope below which it
    takes a contact back; ``limit``: its greatest force; ``most``: the same, lowered to what the arm's limit allows;
    ``has_load``: whether the device measures force; ``reach``: how far the device goes in a tick; ``early``: how far
    below the finger a surface that is in truth too high may seem to be; ``ahead``: how many ticks ahead the slope is
    known; ``x``, ``y``, ``z``: position of the face in the frame whose pose the device reads; ``wire``: whether
    readings come late, and not in every tick; ``softly``: speed relative to the finger [m/s] with which it comes to it.
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
    softly: float = SOFTLY


class Seen(NamedTuple):
    """What is read of State: arrays, of shape (1,) where none is given.

    Of the device: ``frame`` (12,), ``pose`` (7,), the pose ``sent`` last (7,), and the force on it, ``borne`` [N], with
    the noise of its sensor averaged out; ``loud``: the rms of that noise [N], 0 where it is quiet.
    ``hip`` (3,) of the finger; ``normal`` (3,) of the touched virtual surface.  Of the virtual surface below:
    ``height``, ``upright`` (cosine of its tilt), ``climb`` (how fast the height changes [m/s]), ``turns`` and
    ``hastens`` (how fast ``climb`` changes because the slope does, or because finger or object accelerate [m/s2]).
    ``rises``: how fast the carried surface goes up [m/s].  ``level``, ``sink``, ``acceleration`` and ``off``: the
    height of the finger's lowest point, its speed upwards and how fast that changes, and how much deeper it seems to be
    in the carried surface than the force explains, smoothed [m], [m/s], [m/s2], [m].  ``goes_x``, ``goes_y``: the
    finger's velocity, smoothed [m/s]; ``slope_x``, ``slope_y``: the slope of the virtual surface [1].  ``pressed``: how
    long the virtual contact has lasted [s]; ``present``: whether the carried surface was at the finger a tick ago;
    ``object``: index of the touched object, -1: none; ``withdrawn``: whether T4 keeps the surface away; ``ready``: 0
    until a touch-off is done.
    """

    frame: Any
    pose: Any
    sent: Any
    borne: Any
    loud: Any
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
    acceleration: Any
    off: Any
    goes_x: Any
    goes_y: Any
    slope_x: Any
    slope_y: Any
    pressed: Any
    present: Any
    object: Any
    withdrawn: Any
    ready: Any


def landing_speed(stiffness: float, damping: float) -> float:
    """Return how fast a surface comes to a finger [m/s] whose pad has a stiffness [N/m] and damping [N s/m]."""
    return min(SOFTLY, MEETS / (damping + 1e-3 * stiffness))


@linked
def _beside(c: Any, frame: Any) -> float:
    """Return how much higher than the face straight below it the finger's lowest point is when they touch [m].

    It is 0 on a level face; on a face mounted at an angle a ball rests beside that point.
    """
    return float(c.radius * (1.0 / max(STEEPEST, frame[UPRIGHT]) - 1.0))


@linked
def top(c: Any, frame: Any, pose: Any) -> float:
    """Return the height in the world [m] of the lowest point of a finger on the face, for a pose of the device.

    ``c``: `Numbers`; ``frame`` (12,): the device's frame in the world, origin [m] and rotation [1]; ``pose`` (7,)
    [m; quaternion].
    """
    x, y, z = pose[0] + c.x, pose[1] + c.y, pose[2] + c.z
    up = frame[ROW_Z] * x + frame[ROW_Z + 1] * y + frame[ROW_Z + 2] * z
    return float(up + frame[ORIGIN_Z] + _beside(c, frame))


@linked
def _come(
    c: Any, own: Any, goal: float, climb: float, last: float, level: float, sink: float, depth: float, pressed: float,
    touching: bool, begins: bool,
) -> None:  # fmt: skip
    """Bring the surface to the finger until it is at its goal [m]; ``depth``: how far it is in the finger [m].

    It comes slower (SLOWER) to a finger that slows down, because it would still come on when this has turned; but it
    does not wait for ever for one that turns again and again.

    ``last`` is the height [m] to which it was sent last: PRESS runs ahead of it by SLACK at most, so that a surface
    that was held up does not rush later.
    """
    felt = pressed > LEFT
    if not touching and not felt:
        own[ARRIVED] = 1.0
        return
    if own[ARRIVED] > 0.0 and (begins or not felt) and depth < -ABOUT:  # not there in time, or left behind
        own[ARRIVED], own[PRESS], own[WAITED] = 0.0, depth, 0.0
    if own[ARRIVED] > 0.0:
        return
    own[PRESS] = min(own[PRESS], last - level + sink * c.period + SLACK)
    if (own[BEHIND] if c.wire else own[PRESS] - depth) < WAITED_FOR:
        pace = (
            c.softly if felt else min(QUICKLY, max(c.softly, (-own[PRESS] - (MADE_WIRED if c.wire else MADE)) / MAKES))
        )
        if felt:  # it goes on with the virtual surface, not with the finger
            left = max(0.0, goal - level - own[PRESS])
            pace = min(pace, climb - sink + math.sqrt(2.0 * EASES * left))
        slower = pace - own[SLOWER] * min(1.0, max(0.0, WAITS - own[WAITED]) / ENDS)
        if felt or (not c.has_load and depth > -ABOUT):
            # The surface itself may be what turns the finger: it waits, but does not leave it, to come once more.
            slower = max(min(pace, 0.0), slower)
        elif own[PRESS] <= -NEXT:
            slower = min(pace, max(c.softly, slower))
        own[WAITED] += (pace - slower) * c.period
        own[PRESS] += slower * c.period
    if level + own[PRESS] >= goal:
        own[ARRIVED] = 1.0


@linked
def _go(c: Any, own: Any, last: float, sink: float, pressed: float, touching: bool) -> None:
    """Take the surface away from the finger, to the clearance, or farther if it is too high and still felt there.

    ``last``: the height to which it was sent last, relative to the finger's height at that time [m], so that it moves
    with the finger; relative to the finger's height now if the surface is too high.
    """
    full, felt, high = -c.clearance, pressed > LEFT, own[LOST] == HIGH
    if own[ARRIVED] > 0.0:
        own[ARRIVED], own[PRESS] = 0.0, last if high else max(last, full)
    own[WAITED] = 0.0
    if not touching and not felt:
        own[PRESS] = min(own[PRESS], full) if high else full
        return
    softly = SOFTLY + FLEES * max(0.0, -sink)
    way = (softly if not high and (felt or own[PRESS] > -SOON) else max(softly, QUICKLY)) * c.period
    own[PRESS] = own[PRESS] - way if felt and high else min(own[PRESS], max(full, own[PRESS] - way))
    if not felt and not high:  # one that a finger left behind does not come after it
        own[PRESS] = min(own[PRESS], max(full, last))


@linked
def _sink_below(c: Any, own: Any, surface: float, last: float, felt: bool) -> None:
    """Keep the surface no higher than the virtual one on its way from the finger; it does not come up again afterwards.

    While it is felt it goes down slowly even for that.

    ``surface`` and ``last`` (where it was sent last): heights [m] above the finger's lowest point.
    """
    lowest = last - 2.0 * SOFTLY * c.period if felt else -np.inf
    own[PRESS] = min(own[PRESS], max(surface, lowest))


@linked
def _give_way(c: Any, own: Any, pressed: float) -> float:
    """Yield while the surface presses harder than it may, come back afterwards; return how far it yields [m]."""
    if pressed > c.limit:
        own[YIELDS] += YIELD_RATE * (pressed - c.limit) * c.period
    elif pressed < 0.9 * c.limit:
        own[YIELDS] = max(0.0, own[YIELDS] - YIELD_RETURN * c.period)
    return float(own[YIELDS])


@linked
def _ease(c: Any, own: Any, at: int, place: float, goes: float) -> float:
    """Follow the finger's place along an axis [m], a step of a reading in STEPS; return how far it is beside that [m].

    ``at``: EVENED_X, EVENED_Y, or EVENED_Z for its lowest point; ``place``: the reading [m]; ``goes``: the finger's
    velocity along that axis, smoothed [m/s].
    """
    ahead = own[at] + goes * c.period
    if c.wire or c.period >= STEPS or not abs(place - ahead) < ANEW:
        own[at] = place
        return 0.0
    own[at] = ahead + c.period / STEPS * (place - ahead)
    return float(own[at] - place)


@linked
def _wanted(
    c: Any, own: Any, height: float, climb: float, level: float, sink: float, lowest: float, here: float, last: float,
    pressed: float, touching: bool, begins: bool,
) -> float:  # fmt: skip
    """Return the height [m] at which the surface is wanted; note how far it has still to come or to go (COMING)."""
    away = lowest + _ease(c, own, EVENED_Z, lowest, sink) - c.clearance
    ahead = own[RISE] if c.wire else climb * (c.period + own[LAG])
    goal = height + ahead + own[SHIFT] + (own[GIVE] * pressed if touching else 0.0)
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
    own[YIELDS] = 0.0  # PRESS, how far it is in the finger, includes what it yielded
    found = level + own[PRESS]
    comes = own[TAKES] > 0.0 and height > -np.inf
    return float(max(goal, away) if comes and found > goal else found)


@linked
def _fall(c: Any, own: Any, wanted: float, last: float, sink: float, pressed: float, touching: bool) -> float:
    """Return the wanted height [m], raised so far that the force on the finger does not decrease too fast.

    The surface may leave a finger only as fast as the pad's force then decreases by FALLS; a finger that goes up by
    itself already relieves the pad.  In a contact that goes on, the surface may nevertheless go down at SOFTLY, and one
    that is falling may fall a little faster in each tick, up to MOST_FALLS: the pad's damping makes changes of speed
    felt.  ``last``: the height to which it was sent last [m].
    """
    if pressed <= LEFT or own[LOST] == HIGH:
        return wanted
    speed = sink - FALLS / c.stiffness
    if touching:
        speed = min(-SOFTLY, max(sink - MOST_FALLS / c.stiffness, min(speed, own[SPEED] - FASTER)))
    return float(max(wanted, last + min(0.0, speed) * c.period))


@linked
def _brake(c: Any, own: Any, wanted: float, climb: float, last: float, here: float, level: float, more: float) -> float:
    """Return the wanted height [m], lowered so far that the surface brakes as it comes up to the finger.

    While the device is too far behind its command near the finger, that is the height sent last.
    ``level``: the height of the finger's lowest point [m].  ``more``, the increase of the feed-forward since the last
    tick [m], is not braked: the surface needs it to keep to a virtual surface that bends.
    """
    way = wanted - last
    if way > 0.0 and (own[BEHIND] if c.wire else last - here) > LEADS and level - here < NEAR:
        return last
    if way <= 0.0 or level - wanted > SOON:
        return wanted
    speed = max(0.0, climb) + max(CALM, math.sqrt(2.0 * BRAKES * way))
    return float(min(wanted, last + speed * c.period + max(0.0, more)))


@linked
def _bearable(c: Any, own: Any, rises: float, level: float, sink: float, off: float) -> float:
    """Return the greatest height [m] at which the surface presses no harder than it may.

    A finger that comes down takes the surface with it: the device is told ahead of time where the finger will be.
    ``rises``: how fast the surface goes up [m/s].
    """
    soon = level + min(0.0, sink - min(0.0, rises)) * AHEAD
    if c.wire:  # the surface goes on as it does only until the next command: nobody tells it how the finger goes on
        soon += min(0.0, sink) * (own[WAY] + c.period + max(0.0, own[LAG]))
    return float(soon + off + c.most / c.stiffness)


@linked
def _with(c: Any, frame: Any, goes_x: float, goes_y: float, axis: int) -> float:
    """Return how far the finger, with this velocity [m/s], goes in a tick along an axis of the device [m]."""
    return float((frame[ROW_X + axis] * goes_x + frame[ROW_Y + axis] * goes_y) * c.period)


@linked
def _command(
    c: Any, own: Any, frame: Any, sent: Any, goes_x: float, goes_y: float, goal: Any, height: float, felt: bool,
    slides: bool,
) -> None:  # fmt: skip
    """Write the command (7,): the pose at which a finger on the face has its lowest point at ``height`` [m].

    In a contact, or while it is felt, the surface gives way first: if it must go down and sideways and one tick is too
    short for both, the sideways motion is shortened.  Where it is left behind, and ``slides`` past the finger to catch
    up, it does that slowly.  ``goes_x``, ``goes_y``: the finger's velocity [m/s].
    """
    x, y = own[EVENED_X] - frame[ORIGIN], own[EVENED_Y] - frame[ORIGIN + 1]
    z = height - _beside(c, frame) - frame[ORIGIN_Z]
    for i, offset in enumerate((c.x, c.y, c.z)):
        goal[i] = frame[ROW_X + i] * x + frame[ROW_Y + i] * y + frame[ROW_Z + i] * z - offset
    if slides:
        square = 0.0
        for i in range(2):
            square += (goal[i] - sent[i] - _with(c, frame, goes_x, goes_y, i)) ** 2
        past = math.sqrt(square)
        if past > PASSES * c.period:
            for i in range(2):
                along = _with(c, frame, goes_x, goes_y, i)
                goal[i] = sent[i] + along + (goal[i] - sent[i] - along) * PASSES * c.period / past
    for i, number in enumerate(UPRIGHT_POSE):
        goal[3 + i] = number
    down = sent[2] - goal[2]
    aside = math.sqrt((goal[0] - sent[0]) ** 2 + (goal[1] - sent[1]) ** 2)
    left = math.sqrt(max(0.0, c.reach * c.reach - down * down))
    if felt and down > 0.0 and aside > left:
        for i in range(2):
            goal[i] = sent[i] + (goal[i] - sent[i]) * left / aside


@linked
def _there(own: Any, before: bool, depth: float, pressed: float) -> bool:
    """Tell whether the surface is at the finger, or about to be.

    ``before``: whether it was a tick ago; ``depth``: how far the finger seems to be in it, or behind a wire may be [m];
    ``pressed``: the force on it [N].
    """
    if depth > -ABOUT or (own[TAKES] > 0.0 and (own[ARRIVED] > 0.0 or own[PRESS] > -HAND_OVER)):
        return True
    return bool(pressed > (LEFT if before else TOUCH))


@linked
def _even(c: Any, own: Any, height: float, climb: float, upright: float) -> float:
    """Return the height of the virtual surface [m]; of a steep face that this one may render, without an arm's steps.

    A plate that followed these would press unevenly, because the pad damps its speed.

    ``climb``: how fast the height changes [m/s]; ``upright``: the cosine of the face's tilt [1].
    """
    ahead = own[EVENED] + climb * c.period
    if not abs(height - ahead) < ANEW:
        own[EVENED] = height if height > -np.inf else 0.0
        return height
    own[EVENED] = ahead + c.period / (EVENLY + c.period) * (height - ahead)
    if upright < c.cosine:
        return height
    part = min(1.0, max(0.0, (EVENED_FROM - upright) / (EVENED_FROM - EVENED_AT)))
    return float(height + part * (own[EVENED] - height))


@kernel
def carry(c: Any, seen: Any, goal: Any, own: Any) -> int:
    """Decide who renders the virtual surface below the finger, and command the device; return 0.

    ``c``: `Numbers`; ``seen``: `Seen`, unpacked here, because passing a tuple of many arrays on is costly; ``goal``
    (7,): the command [m; quaternion]; ``own`` (51,), more behind a wire: the modality's fields, with the units of
    `own.FIELDS`.
    """
    frame, sent, hip = seen.frame, seen.sent, seen.hip
    height, climb, level, sink = seen.height[0], seen.climb[0], seen.level[0], seen.sink[0]
    lowest, here, last = hip[2] - c.radius, top(c, frame, seen.pose), top(c, frame, sent)
    pressed, touching, withdrawn = seen.borne[0], seen.object[0] >= 0, seen.withdrawn[0] != 0
    if c.wire:
        here += own[SINCE]
        if not seen.loud[0] > 0.0:  # else its average is of now, too
            pressed = own[PRESSES]
    height += seen.slope_x[0] * _ease(c, own, EVENED_X, hip[0], seen.goes_x[0])
    height += seen.slope_y[0] * _ease(c, own, EVENED_Y, hip[1], seen.goes_y[0])
    if not c.wire:
        height = _even(c, own, height, climb, seen.upright[0])
    own[GAP] = height - here if height > -np.inf else np.inf
    own[DISTANCE] = lowest - here
    if withdrawn:
        own[LOST] = 0.0
    upright = seen.upright[0]  # of the face below, where the surface would go; the finger may touch another one
    bare = touching and not height > -np.inf  # round the rim of an open surface: there is nothing below to present
    choose(c, own, min(upright, along(frame, seen.normal)) if touching else upright, touching, withdrawn or bare)
    if seen.ready[0] != 0 and c.has_load and own[LOST] == 0.0 and not withdrawn:
        doubt(c, own, here - lowest, pressed, touching)
        if own[LOST] == 0.0:
            touches_unasked(c, own, here - lowest, pressed, touching)
    begins = touching and seen.pressed[0] == 0.0
    watch(c, own, here, climb)
    rounds = bend(c, own, seen.turns[0], seen.hastens[0], touching and not begins)
    if c.wire:
        rounds = 0.0  # the command already goes to where the virtual surface will be (RISE)
    shift = min(MOST_SHIFT, max(-MOST_SHIFT, rounds + own[BENDS] * own[INERTIA])) if own[TAKES] > 0.0 else 0.0
    more, own[SHIFT] = shift - own[SHIFT], shift
    # Behind a wire the surface would turn for what the finger did long ago.
    own[SLOWER] = 0.0 if c.wire else max(0.0, -seen.acceleration[0] - STEADY) * LATE
    wanted = _wanted(c, own, height, climb, level, sink, lowest, here, last, pressed, touching, begins)
    wanted = _fall(c, own, _brake(c, own, wanted, climb, last, here, level, more), last, sink, pressed, touching)
    most = _bearable(c, own, seen.rises[0], level, sink, seen.off[0])
    still = own[TAKES] > 0.0 and own[ARRIVED] > 0.0 and wanted <= most
    rests = still and touching and pressed >= TOUCH and own[YIELDS] <= 0.0
    if c.wire:
        own[RESTS] = own[RESTS] + c.period if rests else 0.0
    elif rests or (not touching and pressed < LEFT and own[LOST] == 0.0):
        learn(c, own, last, here, pressed)
    felt, slides = touching or pressed > LEFT, pressed > LEFT or lowest - here < SOON
    _command(c, own, frame, sent, seen.goes_x[0], seen.goes_y[0], goal, min(wanted, most), felt, slides)
    # Behind a wire it may still come, though newer commands have called it back.
    highest = here + max(0.0, own[AT_MOST] - own[SINCE]) if c.wire else here
    own[AT_FINGER] = 1.0 if touching and _there(own, seen.present[0] > 0.0, highest - lowest, pressed) else 0.0
    return 0
