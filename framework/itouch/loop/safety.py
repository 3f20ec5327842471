"""Safety: the only path from a command to a device.

Every command passes ``Guard.limit``; what is not a number stops; a trip latches until the operator re-arms.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import RETRACT, Channel, Record
from itouch.schema import ItouchError
from itouch.world import limits as default
from itouch.world.limits import DeviceLimits

Floats = NDArray[np.float64]


class Trip(enum.IntEnum):
    """Why a device was stopped; latched in State."""

    NONE = 0
    NOT_A_NUMBER = 1
    SENSOR_RANGE = 2
    PLATE_TEMPERATURE = 3
    SINK_TEMPERATURE = 4
    PLATE_FORCE = 5
    TRACKING = 6
    SPEED = 7
    SILENT = 8
    DEVICE_ERROR = 9
    CALIBRATION = 10
    OVERRUN = 11


class TripError(ItouchError):
    """A limit was passed: which, on what, and how far."""

    def __init__(self, trip: Trip, sentence: str) -> None:
        super().__init__(sentence)
        self.trip = trip


class Guard:
    """Limits one command channel: hardware ceiling, then the limits in force, then ramp and slew."""

    __slots__ = ("_apply", "_high", "_limits", "_locked", "_low", "_resting", "_shut", "channel")

    def __init__(self, channel: Channel, limits: DeviceLimits) -> None:
        self.channel, self._limits = channel, limits
        self._shut = _locked_components(channel)
        tail = [rest for index, rest in self._shut if index >= 3]
        self._resting = tail if len(tail) == channel.size - 3 else None  # what all but x, y, z must be, if locked
        self._locked = self._resting is None or len(tail) < len(self._shut)
        self._high, self._low = channel.high, channel.low
        kinds = {"wrench": self._wrench, "pose_target": self._pose_target}
        self._apply = kinds.get(channel.name, self._plain)

    def limit(self, wanted: Floats, sent: Floats, ramp: float, period: float, closing: float) -> tuple[int, int]:
        """Write what may be sent.

        Parameters
        ----------
        wanted, sent
            The command asked for, and the one sent last, which is overwritten.
        ramp
            0 just after enabling to 1.
        period
            Seconds since the last command.
        closing
            Greatest speed [m/s] at which a surface may approach the finger now.

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
            raise TripError(Trip.NOT_A_NUMBER, f"was commanded with {_not_finite(values)} ({self.channel.name})")
        dropped = 0
        if values[3:] != self._resting or self._locked:
            for index, rest in self._shut:
                if values[index] != rest:
                    values[index] = rest
                    dropped += 1
        clamped = self._apply(values, sent.tolist(), ramp, period, closing)
        sent[:] = values
        return clamped, dropped

    def _wrench(self, values: list[float], last: list[float], ramp: float, period: float, closing: float) -> int:
        x, y, z = values[0:3]
        size = math.sqrt(x * x + y * y + z * z)
        x, y, z = last[0:3]
        grown = math.sqrt(x * x + y * y + z * z) + default.FORCE_SLEW * period
        allowed = min((self._limits.force or 0.0) * ramp, grown)
        clamped = 0
        if size > allowed:
            scale = allowed / size
            values[0], values[1], values[2] = values[0] * scale, values[1] * scale, values[2] * scale
            clamped = 1
        if self._resting is not None:
            return clamped
        for index in (3, 4, 5):
            top = self._high[index] * ramp if self._high else 0.0
            if abs(values[index]) > top:
                values[index] = math.copysign(top, values[index])
                clamped = 1
        return clamped

    def _pose_target(self, values: list[float], last: list[float], ramp: float, period: float, closing: float) -> int:
        clamped = _into_box(values, self.channel, 3)
        x, y, z = last[0:3]
        dx, dy, dz = values[0] - x, values[1] - y, values[2] - z
        rise, reach = closing * period, (self._limits.speed or 0.0) * period
        if dz > rise:
            dz, clamped = rise, 1
        square = dx * dx + dy * dy + dz * dz
        if square > reach * reach:
            scale = reach / math.sqrt(square)
            dx, dy, dz, clamped = dx * scale, dy * scale, dz * scale, 1
        values[0], values[1], values[2] = x + dx, y + dy, z + dz
        return clamped

    def _plain(self, values: list[float], last: list[float], ramp: float, period: float, closing: float) -> int:
        clamped = _into_box(values, self.channel, len(values))
        if self.channel.name == "current" and self._limits.current is not None:
            top = self._limits.current * ramp
            if abs(values[0]) > top:
                values[0], clamped = math.copysign(top, values[0]), 1
        for index, rate in enumerate(self.channel.slew):
            step = values[index] - last[index]
            if abs(step) > rate * period:
                values[index], clamped = last[index] + math.copysign(rate * period, step), 1
        return clamped

    def safe(self, sent: Floats, period: float) -> None:
        """Write the safe command: its value, or hold, or retract along -z as fast as is allowed."""
        safe = self.channel.safe
        if isinstance(safe, tuple):
            sent[:] = safe
        elif safe is RETRACT and self.channel.low:
            sent[2] = max(self.channel.low[2], sent[2] - (self._limits.speed or 0.0) * period)


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


def _not_finite(values: Sequence[float]) -> str:
    return next(("NaN" if math.isnan(v) else "an infinite number" for v in values if not math.isfinite(v)), "NaN")


class Watch:
    """Checks the readings of one device; what is not believable or past a limit trips."""

    __slots__ = ("_bounded", "_channels", "_high", "_low", "_reading", "_values")

    _SPECIAL: ClassVar[dict[str, tuple[Trip, float, float]]] = {
        "plate_temperature": (Trip.PLATE_TEMPERATURE, *default.PLATE_TRIP),
        "sink_temperature": (Trip.SINK_TEMPERATURE, 0.0, default.SINK_TRIP),
    }

    def __init__(self, reads: Sequence[Channel], reading: Record) -> None:
        self._channels, self._reading = tuple(reads), reading
        self._values = reading.raw.view(np.float64)
        low: list[float] = []
        high: list[float] = []
        for channel in reads:
            special = self._SPECIAL.get(channel.name)
            open_ended = ((-math.inf,) * channel.size, (math.inf,) * channel.size)
            ranges = (channel.low, channel.high) if channel.high else open_ended
            low += (special[1],) if special else ranges[0]
            high += (special[2],) if special else ranges[1]
        self._low, self._high = low, high
        ranges_of = enumerate(zip(low, high, strict=True))
        self._bounded = [(i, least, most) for i, (least, most) in ranges_of if most < math.inf]

    def check(self) -> None:
        """Check the newest readings.

        Raises
        ------
        TripError
            Naming the reading and its value.
        """
        values: list[float] = self._values.tolist()
        total = sum(values)
        if total - total != 0.0:  # something is not a number, or infinite
            self._explain()
        for index, low, high in self._bounded:
            if not low <= values[index] <= high:
                self._explain()

    def _explain(self) -> None:
        at = 0
        for channel in self._channels:
            values = self._reading[channel.name].tolist()
            low, high = self._low[at : at + channel.size], self._high[at : at + channel.size]
            at += channel.size
            for value, least, most in zip(values, low, high, strict=True):
                if least <= value <= most and math.isfinite(value):
                    continue
                if not math.isfinite(value):
                    raise TripError(Trip.NOT_A_NUMBER, f"reads {_not_finite(values)} ({channel.name})")
                if channel.name in self._SPECIAL:
                    shown = f"{value - 273.15:.1f} degC"
                    raise TripError(self._SPECIAL[channel.name][0], f"reads {channel.name} {shown}, past its trip")
                shown = f"{channel.name} = {value:g} {channel.unit}"
                raise TripError(Trip.SENSOR_RANGE, f"reads {shown}, which is not believable")
