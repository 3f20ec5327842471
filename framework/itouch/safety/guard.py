"""What may be sent: every command passes here, whatever asked for it.

First the hardware's ceiling, then the limits in force, then ramp and slew; what is not a number stops.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import Trip, TripError
from itouch.monitors import limits as default
from itouch.monitors.limits import DeviceLimits
from itouch.monitors.readings import not_finite
from itouch.plugin import HURTING, RETRACT, Channel, Role

Floats = NDArray[np.float64]

#: Part of its speed that a surface has at least while it ramps in.
LEAST_RAMP = 0.05


class Guard:
    """Limits one command channel."""

    __slots__ = (
        "_apply", "_high", "_limits", "_locked", "_low", "_resting", "_room", "_shut", "_top", "_torques", "channel",
    )  # fmt: skip

    def __init__(self, channel: Channel, limits: DeviceLimits) -> None:
        self.channel, self._limits = channel, limits
        self._shut = _locked_components(channel)
        tail = [rest for index, rest in self._shut if index >= 3]
        self._resting = tail if len(tail) == channel.size - 3 else None  # what all but x, y, z must be, if locked
        self._locked = self._resting is None or len(tail) < len(self._shut)
        self._high, self._low = channel.high, channel.low
        self._torques = [high if math.isfinite(high) else 0.0 for high in channel.high] or [0.0] * channel.size
        self._room = math.inf
        kinds = {
            Role.FORCE_ON_OPERATOR: self._wrench, Role.SURFACE_POSE: self._pose_target,
            Role.TEMPERATURE_TARGET: self._temperature,
        }  # fmt: skip
        self._apply = kinds.get(channel.role, self._drive if channel.role in HURTING else self._plain)
        self._top = limits.current or 0.0 if channel.role is Role.DRIVE and channel.unit == "A" else None

    def limit(
        self, wanted: Floats, sent: Floats, share: float, period: float, closing: float, room: float = math.inf
    ) -> tuple[int, int]:
        """Write what may be sent.

        Parameters
        ----------
        wanted, sent
            The command asked for, and the one sent last, which is overwritten.
        share
            0 to 1: the part of force, current or speed that is let through (the ramp, or a limit that is near).
        period
            Seconds since the last command.
        closing
            Greatest speed [m/s] at which a surface may approach the finger now.
        room
            Force [N] that what else pushes on the finger leaves.

        Returns
        -------
        tuple
            How many limits were applied, and how many locked components were dropped.

        Raises
        ------
        TripError
            If the command is not a number.
        """
        values: list[float] = wanted.tolist()
        total = sum(values)
        if total - total != 0.0:
            raise TripError(Trip.NOT_A_NUMBER, f"was commanded with {not_finite(values)} ({self.channel.name})")
        dropped = 0
        if values[3:] != self._resting or self._locked:
            for index, rest in self._shut:
                if values[index] != rest:
                    values[index] = rest
                    dropped += 1
        self._room = room
        clamped = self._apply(values, sent.tolist(), share, period, closing)
        sent[:] = values
        return clamped, dropped

    def _wrench(self, values: list[float], last: list[float], share: float, period: float, closing: float) -> int:
        x, y, z = values[0:3]
        size = math.sqrt(x * x + y * y + z * z)
        x, y, z = last[0:3]
        grown = math.sqrt(x * x + y * y + z * z) + default.FORCE_SLEW * period
        allowed = min((self._limits.force or 0.0) * share, grown, self._room)
        clamped = 0
        if size > allowed:
            scale = allowed / size
            values[0], values[1], values[2] = values[0] * scale, values[1] * scale, values[2] * scale
            clamped = 1
        if self._resting is not None:
            return clamped
        for index in (3, 4, 5):
            top = self._torques[index] * share
            if abs(values[index]) > top:
                values[index] = math.copysign(top, values[index])
                clamped = 1
        return clamped

    def _pose_target(self, values: list[float], last: list[float], share: float, period: float, closing: float) -> int:
        clamped = _into_box(values, self.channel, self.channel.size)
        x, y, z = last[0:3]
        dx, dy, dz = values[0] - x, values[1] - y, values[2] - z
        if share < 1.0:
            period *= max(share, LEAST_RAMP)
        rise, reach = closing * period, (self._limits.speed or 0.0) * period
        if dz > rise:
            dz, clamped = rise, 1
        square = dx * dx + dy * dy + dz * dz
        if square > reach * reach:
            scale = reach / math.sqrt(square)
            dx, dy, dz, clamped = dx * scale, dy * scale, dz * scale, 1
        values[0], values[1], values[2] = x + dx, y + dy, z + dz
        return clamped

    def _drive(self, values: list[float], last: list[float], share: float, period: float, closing: float) -> int:
        """Limit a drive: its ceiling, the scene's limit, and the part that the monitors leave of it."""
        clamped = _into_box(values, self.channel, len(values))
        for index, value in enumerate(values):
            top = self._ceiling(index, value) * share
            if abs(value) > top:
                values[index], clamped = math.copysign(top, value), 1
        return clamped | self._slew(values, last, period)

    def _ceiling(self, index: int, value: float) -> float:
        """Return the greatest size of a component in the direction that it has."""
        hardware = (self._high if value > 0.0 else self._low)[index] if self._high else math.inf
        ceiling = abs(hardware) if self._top is None else min(abs(hardware), self._top)
        return ceiling if math.isfinite(ceiling) else abs(value)

    def _temperature(self, values: list[float], last: list[float], share: float, period: float, closing: float) -> int:
        clamped = _into_box(values, self.channel, len(values))
        low, high = self._limits.temperature or default.PLATE_TEMPERATURE
        if share < 1.0:  # nearer to the middle of what is allowed
            middle, half = 0.5 * (low + high), 0.5 * (high - low) * share
            low, high = middle - half, middle + half
        for index, value in enumerate(values):
            kept = min(max(value, low), high)
            if kept != value:
                values[index], clamped = kept, 1
        return clamped | self._slew(values, last, period)

    def _plain(self, values: list[float], last: list[float], share: float, period: float, closing: float) -> int:
        return _into_box(values, self.channel, len(values)) | self._slew(values, last, period)

    def _slew(self, values: list[float], last: list[float], period: float) -> int:
        clamped = 0
        for index, rate in enumerate(self.channel.slew):
            step = values[index] - last[index]
            if abs(step) > rate * period:
                values[index], clamped = last[index] + math.copysign(rate * period, step), 1
        return clamped

    def safe(self, sent: Floats, period: float, *, backwards: bool = False) -> None:
        """Write the safe command: its value, or hold, or retract along -z as fast as is allowed.

        ``backwards`` retracts along +z instead, for a drive that has been seen to go the wrong way.
        """
        safe, step = self.channel.safe, (self._limits.speed or 0.0) * period
        if isinstance(safe, tuple):
            sent[:] = safe
        elif safe is RETRACT and self.channel.low:
            sent[2] = min(self._high[2], sent[2] + step) if backwards else max(self._low[2], sent[2] - step)


def _locked_components(channel: Channel) -> tuple[tuple[int, float], ...]:
    """Return the components that a locked degree of freedom shuts, with the value that they rest at."""
    if channel.size == 7:
        turned = [axis for axis in channel.locked if axis >= 3]
        shut = [(axis, 0.0) for axis in channel.locked if axis < 3]
        rest = [(3, 1.0), (4, 0.0), (5, 0.0), (6, 0.0)] if len(turned) == 3 else []
        return tuple(shut + rest)
    return tuple((axis, 0.0) for axis in channel.locked if axis < channel.size)


def _into_box(values: list[float], channel: Channel, count: int) -> int:
    clamped = 0
    if not channel.high:
        return clamped
    for index in range(count):
        if values[index] > channel.high[index]:
            values[index], clamped = channel.high[index], 1
        elif values[index] < channel.low[index]:
            values[index], clamped = channel.low[index], 1
    return clamped
