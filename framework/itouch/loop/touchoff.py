"""Touch-off: at start the plate rises until it presses, at three points; the fit gives the table's true height.

While the force grows from a touch to 0.3 N, a line is fitted to the height of the plate against the finger over the
force; at zero force the plate just touched, however soft the finger pad is.  Only the height can be found with a flat
plate; the result is the State field ``DEVICE.calibration``.

Its work in a tick is compiled; Python tells why it failed.
"""

from __future__ import annotations

import enum
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.joining import SKIP, runner
from itouch.loop import render
from itouch.loop.device_runner import DeviceFaultError, Runner
from itouch.loop.rigid_transforms import Vector
from itouch.loop.surface import plate, surface_memory
from itouch.loop.touch import ContactStep
from itouch.plugin import Bound, Record, Role
from itouch.plugin.carried_surfaces import LEFT
from itouch.safety import Trip
from itouch.safety.latch import ENABLED
from itouch.twin.hand import LEAD_SPEED, Hand
from itouch.twin.mechanics import lower

Floats = NDArray[np.float64]

#: Speed of the rising plate [m/s], force that ends the rise, and force from which samples count [N].
RISE, FORCE, SAMPLE = 0.005, 0.3, 0.05
#: A sensor whose noise has at least this rms [N] is loud: without a touch it often reads as much as a touch would; and
#: the time constant with which its noise is measured [s].
LOUD, LISTENS = 0.008, 0.05
#: A loud sensor feels something from so many times its noise on, until it reads less than that; meanwhile the plate
#: rises slower by this factor, so that noise averages out, and until it reads so many times its noise more than FORCE.
#: Where its average is known (`itouch.loop.surface.force_estimate`), that is taken instead of readings, until FORCE.
BEGINS, SLOWER, BEYOND = 3.0, 0.25, 2.0
#: How far below the finger the slow rise begins, and how far the plate drops between points, where the skin has time to
#: lose what it was warmed [m].
MARGIN, DROP = 0.0079, 0.003
#: Distance of the touched points from the plate's centre [m].
SPREAD = 0.006
#: How far below the end of its travel the plate should meet the finger: mounts are inexact, and hands give way [m].
ROOM = 0.012
#: How near its goal a plate counts as arrived, and how far behind it as having been stopped meanwhile [m].
_ARRIVED, _BEHIND = 3e-4, 1.5e-3
#: How long a finger may rest on a plate that can go no lower before the touch-off gives up [s].
RESTS = 5.0
#: Codes left to Python: the plate is at the upper end of its travel and was not felt, or at the lower and still is.
UNFELT, TOO_HIGH = 2, 3


def lasts(points: int) -> float:
    """Return how long [s] a touch-off of so many points lasts, with a second to go to the first one.

    For each the plate rises from below the finger to where it presses; mounts are inexact and pads soft, so that it may
    have to rise twice as far as it was lowered.
    """
    return 1.0 + 2.0 * (MARGIN + (points - 1) * DROP) / RISE


class TouchOffPhase(enum.IntEnum):
    """The phases of a touch-off."""

    PLACE = 0
    RISE = 1
    RELEASE = 2
    DONE = 3


_PLACE, _RISE, _RELEASE, DONE = (int(phase) for phase in TouchOffPhase)


class Search(NamedTuple):
    """A touch-off's part of State: stage, point and target [m] (1,), sums (5,), offsets (points,), calibration (7,).

    ``aside`` (2,): where the finger is to be on the plate [m]; ``noise`` (1,): mean square of the sensor's readings of
    nothing [N^2]; ``squares`` (1,): sum of the squares of heights [m^2]; ``hand`` (3,): how far the operator twin's
    hand is led away from its path [m].
    """

    stage: Any
    point: Any
    sums: Floats
    offsets: Floats
    target: Floats
    calibration: Floats
    hand: Floats
    aside: Floats
    noise: Floats
    squares: Floats


class Reach(NamedTuple):
    """Lengths [m]: ends of the travel, the finger's radius, and the height at which the hand's path begins (NaN: none).

    ``x``, ``y``, ``z``: of the plate's top from the point whose pose the table reads; ``near``: greatest speed near a
    finger [m/s]; ``period``: of a tick [s]; ``damping``: of the finger's pad [N s/m]; ``wire``: whether its readings
    are late.
    """

    low: float
    high: float
    radius: float
    start: float
    x: float
    y: float
    z: float
    near: float
    period: float
    damping: float
    wire: bool


class Reading(NamedTuple):
    """What a table read last: its pose (7,) [m; quaternion] and the force on it (6,) [N, N m].

    ``tick`` (1,): the tick now; ``measured`` (1,): that in which the pose was measured.
    """

    pose: Floats
    load: Floats
    tick: Any
    measured: Any


@linked
def _lead(c: Floats, search: Any, reach: Any) -> bool:
    """Lead the operator twin's hand down to where the plate can reach it, if its path begins higher.

    Return whether it is still on its way.
    """
    r, z = render.TABLE + 3, reach.z + reach.high
    top = c[render.TABLE + 2] + c[r + 6] * reach.x + c[r + 7] * reach.y + c[r + 8] * z
    goal = min(0.0, top + reach.radius - ROOM - reach.start)
    lower(search.hand, goal, LEAD_SPEED * reach.period)
    return bool(search.hand[2] != goal)


#: What is summed of the samples of a touch: their number, force, height, and products of force with both.
_COUNT, _FORCE, _HEIGHT, _FORCE_HEIGHT, _FORCE_FORCE = range(5)


@linked
def _at_zero_force(sums: Floats) -> float:
    """Return the height [m] at zero force of the line through the samples; their mean if they don't tell a slope."""
    n, f, h, fh, ff = sums[_COUNT], sums[_FORCE], sums[_HEIGHT], sums[_FORCE_HEIGHT], sums[_FORCE_FORCE]
    spread = n * ff - f * f
    if n < 5 or spread <= 1e-9:
        return float(h / n)
    slope = (n * fh - f * h) / spread
    return float((h - slope * f) / n)


@linked
def _at_no_force(sums: Floats, squares: float) -> float:
    """Return the height [m] at zero force of the line through the samples of a loud sensor.

    The force is fitted over the height, not the other way round: all noise is the force's, and would make the line of
    the height flatter than it is.  ``squares``: sum of the heights' squares [m^2].
    """
    n, f, h, fh = sums[_COUNT], sums[_FORCE], sums[_HEIGHT], sums[_FORCE_HEIGHT]
    spread, slope = n * squares - h * h, n * fh - f * h
    if n < 5 or spread <= 0.0 or slope <= 0.0:
        return float(h / n)
    return float((h - f * spread / slope) / n)


@linked
def _begin(search: Any) -> None:
    """Forget all samples."""
    search.sums[:] = 0.0
    search.squares[0] = 0.0


@linked
def _noise(search: Any) -> float:
    """Return the rms of the sensor's noise [N] if it is loud, else 0."""
    return math.sqrt(search.noise[0]) if search.noise[0] > LOUD * LOUD else 0.0


@linked
def _damped(reach: Any, figures: Floats, kept: Floats, speed: float) -> float:
    """Return the force [N] of the pad's damping as the plate rises at ``speed`` [m/s] to a finger that presses.

    A finger that rests on a virtual object stays where it is, as the arm gives the less, the more the plate gives; one
    in the air gives way to the plate.
    """
    return reach.damping * max(0.0, speed - kept[surface_memory.SINK]) if figures[render.PENETRATION] > 0.0 else 0.0


@linked
def _sample(search: Any, height: float, force: float) -> None:
    """Add a height of the plate against the finger [m], and the force there [N], to the samples."""
    sums = search.sums
    sums[_COUNT] += 1
    sums[_FORCE] += force
    sums[_HEIGHT] += height
    sums[_FORCE_HEIGHT] += force * height
    sums[_FORCE_FORCE] += force * force
    search.squares[0] += height * height


@linked
def _slide(search: Any, reach: Any, x: float, y: float) -> None:
    """Bring the point at which the finger is touched to its place (x, y) on the plate [m].

    By a loud sensor the finger may seem to touch all the time: past such a finger no plate slides fast (K5).
    """
    u, v = x - search.aside[0], y - search.aside[1]
    way, most = math.sqrt(u * u + v * v), reach.near * reach.period
    part = most / way if _noise(search) > 0.0 and way > most else 1.0
    if part < 1.0:
        search.aside[0] += part * u
        search.aside[1] += part * v
    else:
        search.aside[0], search.aside[1] = x, y


@linked
def _place(search: Any, reach: Any, pose: Floats, x: float, y: float, force: float, led: bool) -> int:
    """Bring the plate below the finger; the sums' `_COUNT` is of the ticks in which it is felt and can go no lower.

    There it waits for a finger that is still ``led``: it would not rise to this one, but be struck by it.
    """
    target = search.target[0]
    if search.point[0] == 0 and force < FORCE / 3:
        search.noise[0] += reach.period / (LISTENS + reach.period) * (force * force - search.noise[0])
    if force > FORCE / 3:  # touched already: the table is mounted higher than the scene says
        search.target[0] = max(reach.low, target - DROP * 50 * reach.period)
        if target <= reach.low and pose[2] - reach.low < _ARRIVED:
            search.sums[_COUNT] += 1
            if search.sums[_COUNT] * reach.period > RESTS:
                return TOO_HIGH
    elif not led and abs(pose[0] - x) < _ARRIVED and abs(pose[1] - y) < _ARRIVED and abs(pose[2] - target) < _ARRIVED:
        _begin(search)
        search.stage[0] = _RISE
    return 0


@linked
def _rise(
    c: Floats, search: Any, reach: Any, pose: Floats, figures: Floats, kept: Floats, pressed: float, age: float
) -> int:
    """Raise the plate until it is felt; one that was stopped meanwhile drops first, then rises as slowly again.

    ``age``: that of its readings [s].
    """
    sums, force = search.sums, abs(pressed)
    if search.target[0] - pose[2] > _BEHIND:
        search.target[0] = max(reach.low, search.target[0] - DROP)
        _begin(search)
        search.stage[0] = _PLACE
        return 0
    noise = _noise(search)
    # Which samples count must not depend on their noise: those that read little would be left out.
    # Behind a wire the average goes with how deep the finger seems, which a mount that is not known yet makes wrong.
    averages = noise > 0.0 and kept[surface_memory.LOUD] > 0.0 and not reach.wire
    averaged = kept[surface_memory.FILTERED] if averages else pressed
    if averaged < max(LEFT, noise):  # what was sampled was noise
        _begin(search)
    felt = noise > 0.0 and sums[_COUNT] > 0.0
    if abs(averaged) > max(SAMPLE, BEGINS * noise) or felt:
        # By its own reading, not by what the modality says that carries it: it is the device that is calibrated.
        held = _damped(reach, figures, kept, SLOWER * RISE if felt else RISE)
        # A finger in the air gives way to the plate: it was where it is now less its way since the plate was there.
        lowest = figures[render.HIP + 2] - reach.radius - age * kept[surface_memory.SINK]
        _sample(search, plate.top(c, pose) - lowest, force - held)
    reached = averaged >= FORCE if averages else force >= FORCE + BEYOND * noise
    if reached:
        found = _at_no_force(sums, search.squares[0]) if noise > 0.0 else _at_zero_force(sums)
        search.offsets[search.point[0]] = found
        search.target[0] = max(reach.low, search.target[0] - DROP)  # but no lower than the end of its travel
        search.stage[0] = _RELEASE
        return 0
    if search.target[0] >= reach.high:
        return UNFELT
    search.target[0] = min(reach.high, search.target[0] + (SLOWER if felt else 1.0) * RISE * reach.period)
    return 0


@linked
def _release(search: Any, pose: Floats, fixed: Any) -> None:
    """Let the plate drop, then go to the next point, or after the last one write the table's height."""
    if abs(pose[2] - search.target[0]) > _ARRIVED:
        return
    if search.point[0] + 1 < search.offsets.shape[0]:
        search.point[0] += 1
        _begin(search)
        search.stage[0] = _PLACE
        return
    total = 0.0
    for offset in search.offsets:
        total += offset
    search.calibration[2] -= total / search.offsets.shape[0]
    search.stage[0] = DONE
    fixed[0] = 0


@kernel
def sought(stage: Any, status: Any) -> int:
    """Skip the search where it is done or the table is not enabled.

    ``stage`` (1,): the number of the `TouchOffPhase`; ``status`` (1,): of the table, a code.

    Unpacking the arguments of the search would cost more than this in each later tick.
    """
    return SKIP if stage[0] == DONE or status[0] != ENABLED else 0


@kernel
def seek(
    c: Floats, search: Any, reach: Any, points: Floats, read: Any, figures: Floats, kept: Floats, goal: Floats,
    closing: Floats, fixed: Any,
) -> int:  # fmt: skip
    """Command the table for a tick of a touch-off that is not done; return UNFELT or TOO_HIGH at an end of its travel.

    Parameters
    ----------
    c, figures
        Constants (CONSTANTS,) and figures (FIGURES,) of the probe; see `render`.
    search, reach
        The touch-off's part of State, a `Search`, and how far the plate may go, a `Reach`.
    points
        Where the finger is touched, in the plate's plane, shape (points, 2) [m].
    read
        What the table read, a `Reading`.
    kept
        Memory (MEMORY,) of the surface: what is looked for renders no contact.
    goal, closing
        Written: its command (7,), and how fast it may approach the finger [m/s], shape (1,).
    fixed
        Whether frames stay as they are, shape (1,); set to 0 when the calibration changes, because they do then, too.
    """
    pose, load = read.pose, read.load
    led = not math.isnan(reach.start) and _lead(c, search, reach)
    force, target = abs(load[2]), search.target
    r, point = render.TABLE + 3, search.point[0]
    _slide(search, reach, points[point, 0], points[point, 1])
    x, y = figures[render.HIP] - c[render.TABLE], figures[render.HIP + 1] - c[render.TABLE + 1]
    z = figures[render.HIP + 2] - reach.radius - c[render.TABLE + 2]
    under_x = c[r] * x + c[r + 3] * y + c[r + 6] * z - reach.x + search.aside[0]
    under_y = c[r + 1] * x + c[r + 4] * y + c[r + 7] * z - reach.y + search.aside[1]
    under_z = c[r + 2] * x + c[r + 5] * y + c[r + 8] * z - reach.z
    if math.isnan(target[0]):
        rests = min(under_z, reach.high - ROOM) if led else under_z  # where it is, or will be led to
        target[0] = min(max(reach.low, rests - MARGIN), reach.high)
    if search.stage[0] == _PLACE:
        if _place(search, reach, pose, under_x, under_y, force, led) == TOO_HIGH:
            search.sums[:] = 0.0  # when it is enabled again, the finger has as long again
            return TOO_HIGH
    elif search.stage[0] == _RISE:
        age = reach.period * (read.tick[0] - read.measured[0])
        if _rise(c, search, reach, pose, figures, kept, -load[2], age) == UNFELT:
            return UNFELT
    else:
        _release(search, pose, fixed)
    goal[0], goal[1], goal[2], goal[3] = under_x, under_y, target[0], 1.0
    goal[4] = goal[5] = goal[6] = 0.0
    closing[0] = reach.near
    if figures[render.PENETRATION] > 0.0:
        # No height that is not known yet hands a finger over to the plate; the arm follows its force at once.
        kept[surface_memory.RENDERS] = kept[surface_memory.CHANGING] = 0.0
    return 0


class TouchOff:
    """Finds the height of one table's mount, on its part of State; ``fixed`` (1,): whether frames stay as they are."""

    def __init__(
        self, table: Runner, contact_step: ContactStep, offset: Vector, state: Record, period: float, hand: Hand | None,
        fixed: NDArray[np.int64],
    ) -> None:  # fmt: skip
        self._table = table
        name, count = table.model.name, table.model.touch_off
        part = f"{name}.touch_off"
        self.stage, self.point, self._target = (state[f"{part}.{field}"] for field in ("stage", "point", "target"))
        self._tick = state["tick"]
        channel = table.model.command(Role.SURFACE_POSE)
        low, high = (channel.low[2], channel.high[2]) if channel else (0.0, 0.0)
        search = Search(
            self.stage.reshape(1), self.point.reshape(1), state[f"{part}.sums"], state[f"{part}.offsets"],
            self._target.reshape(1), state[f"{name}.calibration"], hand.offset if hand is not None else np.zeros(3),
            state[f"{part}.aside"], state[f"{part}.noise"].reshape(1), state[f"{part}.squares"].reshape(1),
        )  # fmt: skip
        start = hand.path.start[2] if hand is not None else math.nan
        near = table.model.limits.speed_near or 0.0
        carried = contact_step.model.surfaces.get(contact_step.probe.name)
        damping = carried.pad_damping if carried is not None else 0.0
        x, y, z = map(float, offset)
        reach = Reach(
            float(low), float(high), float(contact_step.probe.scene.radius), start, x, y, z, near, period, damping,
            bool(table.model.wire),
        )  # fmt: skip
        angles = [math.pi / 2 + 2 * math.pi * point / count for point in range(count)]
        points = np.array([(SPREAD * math.cos(angle), SPREAD * math.sin(angle)) for angle in angles])
        self._load = table.read_as(Role.CONTACT_FORCE)
        read = Reading(
            table.read_as(Role.TRACKED_POSE), self._load, state["tick"].reshape(1),
            table.gate.acquisition.measured_of(Role.TRACKED_POSE),
        )  # fmt: skip
        search_on = Bound(
            seek, contact_step.constants, search, reach, points, read, contact_step.figures, contact_step.surface,
            table.commanded(Role.SURFACE_POSE), table.gate.actuation.moving.closing, fixed,
        )  # fmt: skip
        #: One tick of it as compiled calls, which must be the last ones of their step.
        self.bounds = (Bound(sought, self.stage.reshape(1), table.latch.seen), search_on)
        self._seek = runner((search_on,))

    @property
    def done(self) -> bool:
        """Whether the height is known."""
        return int(self.stage) == DONE

    def reset(self) -> None:
        """Set the touch-off to its start."""
        self.stage[...] = TouchOffPhase.PLACE
        self.point[...] = 0
        self._target[...] = math.nan

    def update(self) -> None:
        """Command the table for this tick.

        Raises
        ------
        DeviceFaultError
            If the plate was not felt up to the end of its travel, or is still felt where it can go no lower.
        """
        self.give_up(self._seek())

    def give_up(self, code: int) -> None:
        """Raise the fault that tells why the height can't be found, if the kernel returned UNFELT or TOO_HIGH.

        Raises
        ------
        DeviceFaultError
            With either of these codes; with any other nothing happens.
        """
        if code == UNFELT:
            cause = "was raised to the end of its travel and felt no finger (touch-off); start the motion lower"
        elif code == TOO_HIGH:
            cause = (
                f"feels {abs(self._load[2]):.1g} N though it can go no lower, for {RESTS:g} s (touch-off); lift the "
                "finger, tare its force sensor, or mount it lower"
            )
        else:
            return
        raise DeviceFaultError(self._table.model.name, int(self._tick), Trip.CALIBRATION, cause)
