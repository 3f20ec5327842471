"""The limits of one command channel (ceiling, limit, ramp-in, slew rate), compiled: the arithmetic of `Guard`.

First the hardware's ceiling, then the limits in force, then ramp and slew.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.joining import SKIP
from itouch.monitors.default_limits import FINGER_LEVER
from itouch.monitors.thresholds import COLDEST_TARGET

Floats = NDArray[np.float64]

#: Kinds of channel, which decide how it is limited.
PLAIN, WRENCH, POSE, DRIVE, TEMPERATURE = range(5)
#: Least share of its speed that a surface has while it ramps in.
LEAST_RAMP = 0.05
#: Code that leaves the step to Python: the device is not enabled, or a command is not a number.
PYTHON = 1


class Bounds(NamedTuple):
    """The limits of one channel of n components; an array is empty where there is no such limit.

    ``kind``: PLAIN to TEMPERATURE; ``locked`` and ``resting``: the components that locked degrees of freedom fix, and
    their resting values; ``low`` and ``high`` (n,): the range; ``ceilings`` (2, n): of a drive, negative and positive,
    infinite: none; ``torques`` (n,): of a wrench; ``slew`` (n,); ``figures`` (5,): greatest force [N] and speed [m/s],
    lowest and highest temperature [K], greatest torque [N m]; ``free``: the components of a wrench that are torques and
    not locked; all in the channel's unit, ``slew`` per second; ``off`` (n,): the value that switches a temperature's
    control off, NaN: there is none; ``work`` (n,): memory to work in.
    """

    kind: NDArray[np.int64]
    locked: NDArray[np.int64]
    resting: Floats
    low: Floats
    high: Floats
    ceilings: Floats
    torques: Floats
    slew: Floats
    figures: Floats
    free: NDArray[np.int64]
    off: Floats
    work: Floats


class TickLimits(NamedTuple):
    """What changes from tick to tick in the limits of a device's channels, each of shape (1,).

    ``share``: the part of force, current or speed that is let through; ``closing`` [m/s]: how fast a surface may
    approach the finger; ``room`` [N] and ``turning`` [N m]: the force and torque that everything else on the finger
    leaves; ``taken`` [N] and ``turned`` [N m]: force and torque of those channels of the device that were limited
    before this one.
    """

    share: Floats
    closing: Floats
    room: Floats
    taken: Floats
    turning: Floats
    turned: Floats

    @classmethod
    def of(
        cls, share: float = 1.0, closing: float = 0.0, room: float = math.inf, turning: float = math.inf
    ) -> TickLimits:
        """Return these values, as they are before the first channel of a device is limited."""
        return cls(*(np.array([value]) for value in (share, closing, room, 0.0, turning, 0.0)))


@linked
def _into_box(bounds: Any, values: Floats) -> int:
    clamped = 0
    for i in range(len(bounds.high)):
        if values[i] > bounds.high[i]:
            values[i], clamped = bounds.high[i], 1
        elif values[i] < bounds.low[i]:
            values[i], clamped = bounds.low[i], 1
    return clamped


@linked
def _slew(bounds: Any, values: Floats, last: Floats, period: float) -> int:
    clamped = 0
    for i in range(len(bounds.slew)):
        step = values[i] - last[i]
        if abs(step) > bounds.slew[i] * period:
            values[i], clamped = last[i] + math.copysign(bounds.slew[i] * period, step), 1
    return clamped


@linked
def _wrench(bounds: Any, moving: Any, values: Floats, last: Floats, share: float, growth: float) -> int:
    """Limit a force together with those of the device's channels before it: all push no harder than one alone may."""
    size = math.sqrt(values[0] * values[0] + values[1] * values[1] + values[2] * values[2])
    grown = math.sqrt(last[0] * last[0] + last[1] * last[1] + last[2] * last[2]) + growth
    allowed = bounds.figures[0] * share
    if moving.room[0] < allowed:
        allowed = moving.room[0]
    allowed = max(0.0, allowed - moving.taken[0])
    if grown < allowed:
        allowed = grown
    clamped, scale = 0, 1.0
    moving.taken[0] += min(size, allowed)
    if size > allowed:
        scale, clamped = allowed / size, 1
    for i in range(len(bounds.high) and 3):  # an arm may be weaker along one axis, or in one direction
        top = bounds.high[i] if values[i] > 0.0 else -bounds.low[i]
        if abs(values[i]) * scale > top:
            scale, clamped = max(0.0, top) / abs(values[i]), 1
    if scale < 1.0:
        for i in range(3):
            values[i] *= scale
    if len(bounds.free) > 0:
        clamped |= _torque(bounds, moving, values, last, share, growth)
    return clamped


@linked
def _torque(bounds: Any, moving: Any, values: Floats, last: Floats, share: float, growth: float) -> int:
    """Limit a torque: about each axis to what the device can give, then its magnitude, also by the force that is left.

    ``growth``: by how much a force may grow [N]; a torque may grow by that times a finger's lever.
    """
    clamped, square, before = 0, 0.0, 0.0
    for k in range(len(bounds.free)):
        i = bounds.free[k]
        top = bounds.torques[i] * share
        if abs(values[i]) > top:
            values[i], clamped = math.copysign(top, values[i]), 1
        square += values[i] * values[i]
        before += last[i] * last[i]
    allowed = min(bounds.figures[4] * share, moving.turning[0], moving.room[0] * FINGER_LEVER)
    allowed = min(max(0.0, allowed - moving.turned[0]), math.sqrt(before) + growth * FINGER_LEVER)
    size = math.sqrt(square)
    moving.turned[0] += min(size, allowed)
    if size > allowed:
        for k in range(len(bounds.free)):
            values[bounds.free[k]] *= allowed / size
        clamped = 1
    return clamped


@linked
def _pose(bounds: Any, values: Floats, last: Floats, share: float, period: float, closing: float) -> int:
    clamped = _into_box(bounds, values)
    if share < 1.0:
        period *= max(share, LEAST_RAMP)
    dx, dy, dz = values[0] - last[0], values[1] - last[1], values[2] - last[2]
    rise, reach = closing * period, bounds.figures[1] * period
    if dz > rise:
        dz, clamped = rise, 1
    square = dx * dx + dy * dy + dz * dz
    if square > reach * reach:
        scale = reach / math.sqrt(square)
        dx, dy, dz, clamped = dx * scale, dy * scale, dz * scale, 1
    values[0], values[1], values[2] = last[0] + dx, last[1] + dy, last[2] + dz
    return clamped


@linked
def _drive(bounds: Any, values: Floats, last: Floats, share: float, period: float) -> int:
    """Limit a drive to its range, then to the share of its ceiling that is let through, then in its slew."""
    clamped = _into_box(bounds, values)
    for i in range(len(values)):
        value = values[i]
        ceiling = bounds.ceilings[1 if value > 0.0 else 0, i]
        top = (ceiling if math.isfinite(ceiling) else abs(value)) * share
        if abs(value) > top:
            values[i], clamped = math.copysign(top, value), 1
    return clamped | _slew(bounds, values, last, period)


@linked
def _temperature(bounds: Any, values: Floats, last: Floats, share: float, period: float) -> int:
    """Limit a temperature target: to its range, nearer to the middle of that for a share below 1, and in its slew.

    A component that is requested off stays off, and a share of 0 switches it off.  While it is off it has no
    temperature to start from, so that a slew starts in the middle of the range.
    """
    clamped = 0
    low, high = bounds.figures[2], bounds.figures[3]
    middle = 0.5 * (low + high)
    if share < 1.0:
        half = 0.5 * (high - low) * share
        low, high = middle - half, middle + half
    for i in range(len(values)):
        asked, kept = values[i], bounds.off[i]
        if math.isnan(kept) or (share > 0.0 and asked >= COLDEST_TARGET):
            if len(bounds.high) > 0:
                values[i] = min(max(values[i], bounds.low[i]), bounds.high[i])
            kept = min(max(values[i], low), high)
            if len(bounds.slew) > 0:
                begin, most = last[i] if last[i] >= COLDEST_TARGET else middle, bounds.slew[i] * period
                kept = min(max(kept, begin - most), begin + most)
        values[i] = kept
        if kept != asked:
            clamped = 1
    return clamped


@linked
def finite(values: Floats) -> bool:
    """Tell whether numbers (n,), in any unit, and their sum are finite."""
    total = 0.0
    for i in range(len(values)):
        total += float(values[i])
    return math.isfinite(total)


@kernel
def limit(
    bounds: Any, moving: Any, wanted: Floats, sent: Floats, clamped: Any, dropped: Any, period: float, growth: float
) -> int:  # fmt: skip
    """Limit the command of a channel, and write what may be sent.

    Parameters
    ----------
    bounds, moving
        The channel's `Bounds`, and `TickLimits`.
    wanted, sent
        The command requested, and the one sent last, which is overwritten, shape (n,), in the channel's unit.
    clamped, dropped
        How many limits were applied, and how many locked components were dropped; added to, shape (1,).
    period, growth
        Seconds since the last command, and by how much a force may grow meanwhile [N].

    Returns
    -------
    int
        0, or PYTHON if the command is not a number: nothing has been written then.
    """
    values = bounds.work
    for i in range(len(wanted)):
        values[i] = wanted[i]
    if not finite(values):  # of the copy: a plugin's thread may write to ``wanted`` meanwhile
        return PYTHON
    for k in range(len(bounds.locked)):
        i = bounds.locked[k]
        if values[i] != bounds.resting[k]:
            values[i] = bounds.resting[k]
            dropped[0] += 1
    kind, share = bounds.kind[0], moving.share[0]
    if kind == WRENCH:
        found = _wrench(bounds, moving, values, sent, share, growth)
    elif kind == POSE:
        found = _pose(bounds, values, sent, share, period, moving.closing[0])
    elif kind == DRIVE:
        found = _drive(bounds, values, sent, share, period)
    elif kind == TEMPERATURE:
        found = _temperature(bounds, values, sent, share, period)
    else:
        found = _into_box(bounds, values) | _slew(bounds, values, sent, period)
    for i in range(len(values)):
        sent[i] = values[i]
    clamped[0] += found
    return 0


@kernel
def begin(
    status: Any, enabled: int, closed: int, wanted: Floats, ends: Any, ramp: Floats, left: Floats, moving: Any,
    growth: float,
) -> int:  # fmt: skip
    """Set the share of commands that is let through in this tick: that of the ramp, times what all monitors allow.

    ``wanted`` (n,): all commands, in their channels' units; ``ends`` (channels,): the index in it at which each ends;
    ``status`` (1,): the device's, a code; ``ramp`` and ``left`` (1,): the shares of the ramp and of the monitors [1];
    ``growth``: of the ramp in a tick [1]; ``moving``: a `TickLimits`.  ``ramp`` and ``moving`` are written.

    Returns 0; SKIP if the device is closed; PYTHON if it is not enabled, or any command is not a number.
    """
    if status[0] == closed:
        return SKIP
    if status[0] != enabled:
        return PYTHON
    first = 0
    for k in range(len(ends)):
        if not finite(wanted[first : ends[k]]):
            return PYTHON
        first = ends[k]
    part = ramp[0]
    if part < 1.0:
        part = min(1.0, part + growth)
        ramp[0] = part
    moving.share[0], moving.taken[0], moving.turned[0] = part * left[0], 0.0, 0.0
    return 0
