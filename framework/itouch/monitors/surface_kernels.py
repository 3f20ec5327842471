"""The checks of a carried surface (T4, T8, K4-K6), compiled: the arithmetic of `Surface`, and what it remembers.

In every function ``allowed`` is an `Allowed`, ``memory`` a `Memory`, ``load`` a `Load`, ``seen`` a
`SurfaceObservation`, ``finger`` the finger's position in the device's frame, (3,) [m], and ``nearing`` a `FingerAbove`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.monitors.default_limits import (
    NEAR,
    SPEED_NEAR_TRIP,
    SPEED_TRIP,
    TRACKING_TIME,
    TRACKING_TRIP,
)
from itouch.monitors.thresholds import (
    DOUBT_FORCE,
    DOUBT_GAP,
    DOUBT_GAP_UNCALIBRATED,
    DOUBT_TIME,
    DUE,
    PLACES,
    SPEED_TIME,
    TOUCH_FORCE,
    TOUCH_GAP,
    TOUCH_GUESS,
    WINDOW,
)

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Load(NamedTuple):
    """The reading of a surface (m,) [N, N m], empty if it has no force sensor, and the lever of torques [m], (1,).

    ``sensors`` (n,): the indices at which the force of each sensor begins, ``torques`` (n, 3): those of the torques
    that count, -1: none.
    """

    reading: Floats
    sensors: Numbers
    torques: Numbers
    lever: Floats


class Allowed(NamedTuple):
    """What one surface may do, and the codes of the trips.

    ``force``: the greatest [N]; ``clamp``, ``longest``: times in touch that make it withdraw, and that trip [s].
    """

    force: float
    clamp: float
    longest: float
    plate_force: int
    tracking: int
    contact_time: int
    speed: int
    disagree: int


class Memory(NamedTuple):
    """What is remembered of a surface, as State has it; shape (1,) unless said otherwise, times [s].

    ``contact_time``: how long it has been touched, which falls while it is not; ``withdrawn``: 1 while it is withdrawn
    because of that; ``counted``: when that clock was looked at last; ``strayed_for``: how long it has been away from
    its command; ``doubted``: how long a force without a finger has been felt; ``near_since``: since when the finger has
    been near, NaN: it is not; ``looked``: when it was looked at last, NaN: after a pause.

    ``places``: how many places are remembered; ``track`` (PLACES, 7): time [s], places of the surface and of the finger
    [m]; ``figure`` (2,): the figures of the last trip, in the units of its limit.
    """

    contact_time: Floats
    withdrawn: Numbers
    counted: Floats
    strayed_for: Floats
    doubted: Floats
    near_since: Floats
    looked: Floats
    places: Numbers
    track: Floats
    figure: Floats


class SurfaceObservation(NamedTuple):
    """A surface at one time: times as in `Moment` [s]; how far it is from its command and from the finger [m]."""

    now: float
    time: float
    seconds: float
    tracking_error: float
    gap: float
    calibrated: bool


@kernel
def _greater(load: Any, k: int, third: float, most: float) -> float:
    """Return ``most`` [N] or the force [N] by sensor ``k`` with ``third`` [N] along its third axis, if that is greater.

    A torque counts as a force, too, also beside a force that is not a number.
    """
    begin, square = load.sensors[k], 0.0
    for i in range(3):
        if load.torques[k, i] >= 0:
            square += load.reading[load.torques[k, i]] ** 2
    x, y = load.reading[begin], load.reading[begin + 1]
    return float(max(most, math.sqrt(x * x + y * y + third * third), math.sqrt(square) / load.lever[0]))


@kernel
def felt(load: Any) -> float:
    """Return the magnitude of the force [N] on the surface, by the sensor that reads most.

    A torque counts as a force, too.
    """
    most = 0.0
    for k in range(len(load.sensors)):
        most = _greater(load, k, load.reading[load.sensors[k] + 2], most)
    return float(most)


#: Force [N] up to which nothing counts as a touch, and by how much a plate's force may rise without being foreseen [N].
TOUCH, UNSEEN = 0.03, 0.06
#: The same where its readings are old: what is thought of it since then is wrong by more.
UNSEEN_LATE = 0.12
#: How near below the finger [m] a plate may be felt in the next tick, and the age of what is known of plate and finger
#: [ticks].
SOON, LATE = 5e-4, 2.0
#: Over how many ticks before that the arm makes room for it: at once, an arm at its limit would be felt to jerk.
RAMP = 20.0
#: A finger that hardly moves counts as closing in at this speed [m/s].
SLOW = 0.02
#: By how much a step in which an arm reads may change a finger's velocity [m/s]: 30 um in the 2 ms over which that is
#: smoothed.  No more of it is allowed for than makes UNSEEN: an arm that lets go of more lets the finger fall.
STEPPED = 0.015


#: Places in the pad of a finger, see `FingerAbove`; and in a row of the places where surface and finger were: when,
#: where the surface was, and where the finger was.
_RADIUS, _STIFFNESS, _DAMPING, _PERIOD = range(4)
_THEN, _X, _Y, _Z, _FINGER_X, _FINGER_Y = range(6)


class FingerAbove(NamedTuple):
    """A finger over a surface: place [m] and velocity [m/s], (3,) in the world; height of the surface's top [m], (1,).

    ``rising`` (1,): how fast the surface rises [m/s], by its last two places;
    ``pad`` (4,): radius [m] of the finger, stiffness [N/m] and damping [N s/m] of its pad, and the period [s];
    ``presses`` (1,): how hard the surface is said to press now [N], where readings are older; below 0: nothing is said.
    ``estimated`` (3,) [N]: rms of the noise of the surface's first force sensor, 0 where it is quiet; where it is not,
    the force along its third axis with the noise averaged out, and how far the true one may be from that.  ``sink``
    (1,): the finger's vertical velocity, smoothed for longer [m/s]; NaN: not known.
    """

    finger: Floats
    velocity: Floats
    top: Floats
    rising: Floats
    pad: Floats
    presses: Floats = np.full(1, -1.0)
    estimated: Floats = np.zeros(3)
    sink: Floats = np.full(1, math.nan)


#: Places in `FingerAbove.estimated`.
_LOUD, _BORNE, _UNSURE = range(3)


@kernel
def pressed_by(load: Any, nearing: Any) -> float:
    """Return the force [N] on the surface as `felt` does, but with the noise of a loud sensor averaged out.

    It is for how much an arm may add: a reading of noise, taken for a touch, would be felt in the arm.  What stops a
    device is `felt`.
    """
    if not nearing.estimated[_LOUD] > 0.0 or len(load.sensors) == 0:
        return float(felt(load))
    most = 0.0
    for k in range(len(load.sensors)):
        third = nearing.estimated[_BORNE] if k == 0 else load.reading[load.sensors[k] + 2]
        most = _greater(load, k, third, most)
    return float(most)


@kernel
def rise(nearing: Any, pressed: float) -> float:
    """Return by how much [N] a surface may press harder in the next tick than it was last felt to press.

    A finger that comes down, or a surface that rises, presses the pad deeper; where they meet, the pad's damping acts
    at once.
    """
    pad = nearing.pad
    radius, stiffness, damping, period = pad[_RADIUS], pad[_STIFFNESS], pad[_DAMPING], pad[_PERIOD]
    closing = max(0.0, nearing.rising[0] - nearing.velocity[2])
    way = LATE * period * closing
    said = nearing.presses[0]
    loud, unsure = nearing.estimated[_LOUD] > 0.0, nearing.estimated[_UNSURE]
    since = said - pressed if said > pressed and not loud else 0.0  # a loud sensor's average has moved on to now
    if pressed + since > TOUCH + unsure:
        return float((UNSEEN_LATE if said >= 0.0 else UNSEEN) + unsure + stiffness * way + since)
    beyond = nearing.finger[2] - radius - nearing.top[0] - SOON - way
    part = 1.0 if beyond <= 0.0 else max(0.0, 1.0 - beyond / (RAMP * period * max(closing, SLOW)))
    # A step of the arm's reading is no faster finger: with the most that it may make, it makes no difference.  Behind a
    # wire the surface steps by more.
    stepped = min(STEPPED, UNSEEN / (damping + LATE * period * stiffness))
    steadily = nearing.rising[0] - nearing.sink[0] + stepped
    if steadily > closing and said < 0.0:
        closing, way = steadily, LATE * period * steadily
    return float(part * (UNSEEN + unsure + stiffness * way + damping * closing))


@kernel
def pace(gap: float, tracking_error: float, largest: float, near: float, close: float, far: float) -> float:
    """Return how fast [m/s] a surface may approach: not at all while its tracking error is above ``largest`` [m].

    Else ``close`` where the gap is less than ``near`` [m], and ``far`` where it is not [m/s].
    """
    if tracking_error > largest:
        return 0.0
    return close if gap < near else far


@kernel
def check(allowed: Any, memory: Any, load: Any, pose: Floats, finger: Any, seen: Any, touch: Floats) -> float:
    """Return 1, or minus the code of a trip.

    Parameters
    ----------
    allowed, memory, load, finger, seen
        See above.
    pose
        Its reading, shape (7,) [m; quaternion], or (0,) if nothing tells where it is.
    touch
        Shape (2,), written when a slow check is due: 1 if it is touched, and the force [N]; NaN: not measured.
    """
    pressed = felt(load)
    if _astray(memory, seen):
        memory.figure[0] = seen.tracking_error
        return -float(allowed.tracking)
    if pressed > allowed.force:
        memory.figure[0] = pressed
        return -float(allowed.plate_force)
    looked = memory.looked[0]
    if seen.now - looked < DUE:
        return 1.0
    passed = 0.0 if math.isnan(looked) else seen.now - looked
    memory.looked[0] = seen.now
    measured = len(load.sensors) > 0
    near = TOUCH_GAP if seen.calibrated else 0.0 if measured else TOUCH_GUESS
    touched = pressed > TOUCH_FORCE or (near > 0.0 and seen.gap < near)
    touch[0], touch[1] = 1.0 if touched else 0.0, pressed if measured else math.nan
    found = moves(allowed, memory, pose, finger, seen, touched)
    if found == 0.0:
        found = doubt(allowed, memory, pressed, passed, seen)
    return float(found if found != 0.0 else 1.0)


@linked
def _astray(memory: Any, seen: Any) -> bool:
    """Tell whether the surface has been away from its command for too long (K6)."""
    if not seen.tracking_error > TRACKING_TRIP:
        memory.strayed_for[0] = 0.0
        return False
    memory.strayed_for[0] += seen.seconds
    return bool(memory.strayed_for[0] > TRACKING_TIME + 1e-9)


@linked
def moves(allowed: Any, memory: Any, pose: Floats, finger: Any, seen: Any, touched: bool) -> float:
    """Return minus the trip of a mean speed over 50 ms that no command can have requested (K5), or 0.

    ``pose`` (7,) [m; quaternion], or (0,) if nothing tells where it is.
    """
    if not seen.gap < NEAR:
        memory.near_since[0] = math.nan
    elif math.isnan(memory.near_since[0]):
        memory.near_since[0] = seen.now
    if len(pose) == 0:
        return 0.0
    then = _before(memory, pose, finger, seen.time)
    if then < 0:
        return 0.0
    before, near = memory.track[then], memory.near_since[0]
    window = seen.time - before[_THEN]
    x, y, z = pose[0] - before[_X], pose[1] - before[_Y], pose[2] - before[_Z]
    speed, closing = math.sqrt(x * x + y * y + z * z) / window, z / window
    if speed > SPEED_TRIP:
        memory.figure[0], memory.figure[1] = speed, 0.0
        return -float(allowed.speed)
    # a surface that was far when the window began may have come near at the speed that is allowed there
    if math.isnan(near) or seen.now - near < window - 1e-7:
        return 0.0
    if closing > SPEED_NEAR_TRIP:
        memory.figure[0], memory.figure[1] = closing, 1.0
        return -float(allowed.speed)
    along, across = x - (finger[0] - before[_FINGER_X]), y - (finger[1] - before[_FINGER_Y])
    past = math.sqrt(along * along + across * across) / window
    if touched and min(past, math.sqrt(x * x + y * y) / window) > SPEED_NEAR_TRIP:
        memory.figure[0], memory.figure[1] = past, 2.0
        return -float(allowed.speed)
    return 0.0


@linked
def _before(memory: Any, pose: Floats, finger: Any, time: float) -> int:
    """Note where surface and finger are; return the row of where they were 50 ms or more ago, -1: not known."""
    count, track = memory.places[0], memory.track
    if count > 0:
        passed = time - track[(count - 1) % PLACES, 0]
        if passed < DUE:
            return -1
        if passed > 4 * SPEED_TIME:
            count = 0
    row = count % PLACES
    track[row, 0] = time
    for i in range(3):
        track[row, 1 + i], track[row, 4 + i] = pose[i], finger[i]
    memory.places[0] = count + 1
    for known in range(count, max(0, count + 1 - PLACES) - 1, -1):
        if track[known % PLACES, 0] <= time - WINDOW:
            return int(known % PLACES)
    return -1


@linked
def doubt(allowed: Any, memory: Any, pressed: float, passed: float, seen: Any) -> float:
    """Return minus the trip of a force [N] where no finger is, so that sensor and tracking disagree (T8), or 0."""
    far = seen.gap > (DOUBT_GAP if seen.calibrated else DOUBT_GAP_UNCALIBRATED)
    if pressed <= DOUBT_FORCE or not far:
        memory.doubted[0] = 0.0
        return 0.0
    memory.doubted[0] += passed
    if memory.doubted[0] <= DOUBT_TIME + 1e-9:
        return 0.0
    memory.figure[0], memory.figure[1] = pressed, seen.gap
    return -float(allowed.disagree)


@kernel
def count(allowed: Any, memory: Any, now: float, touched: bool) -> float:
    """Run the clock of T4: forwards in touch, else backwards no faster than real time; return 1, or minus its trip.

    ``now``: session time [s]; ``touched``: whether the finger touches this surface, or another one.
    """
    counted = memory.counted[0]
    if now - counted < DUE:
        return 1.0
    seconds = 0.0 if math.isnan(counted) else now - counted
    memory.counted[0] = now
    passed = max(0.0, memory.contact_time[0] + (seconds if touched else -seconds))
    memory.contact_time[0] = passed
    if passed > allowed.longest:
        memory.figure[0] = passed
        return -float(allowed.contact_time)
    if passed > allowed.clamp:
        memory.withdrawn[0] = 1
    return 1.0
