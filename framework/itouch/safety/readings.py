"""What is believed: every new reading passes here before anything is done with it (T1, T2, T7, T8).

A reading must be a number, in its range, and not further from the one before than the device can have gone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from itouch.plugin import Channel, Record
from itouch.safety.guard import not_finite
from itouch.safety.trips import Trip, TripError
from itouch.world import limits as default
from itouch.world.limits import DeviceLimits

#: T8: greatest change of a temperature between two readings [K], and range of any temperature [K].
TEMPERATURE_JUMP, TEMPERATURE_RANGE = 20.0, (263.15, 353.15)
#: Fastest that a finger goes [m/s], room for the steps of encoders [m], and how far from its origin a device reaches.
FINGER_SPEED, STEPS, WORKSPACE = 5.0, 0.002, 2.0
#: How much faster than it can a surface may seem to go before its sensor is not believed.
SURFACE_MARGIN = 3.0
#: Two sensors of the plate differ at most so much [K].
DISAGREEMENT = 3.0
#: A flux sensor at the end of its scale is believed; its last count may lie beyond.
SATURATED = 1.01
_MOST = 1e300


class Watch:
    """Checks the readings of one device."""

    __slots__ = ("_channels", "_checked", "_high", "_low", "_pairs", "_sane", "_speeds", "_values", "believed", "last")

    def __init__(
        self, reads: Sequence[Channel], reading: Record, limits: DeviceLimits, commands: Sequence[Channel] = ()
    ) -> None:
        self._channels = tuple(reads)
        self._values = reading.raw.view(np.float64)
        self._low: list[float] = []
        self._high: list[float] = []
        self._speeds: list[tuple[float, float]] = []  # greatest change: m/s or K/s, and what is always let through
        for channel in reads:
            low, high = _range(channel, limits)
            self._low += low
            self._high += high
            self._speeds += _change(channel, commands)
        rows = enumerate(zip(self._low, self._high, self._speeds, strict=True))
        self._checked = [
            (i, low, high, speed, room)
            for i, (low, high, (speed, room)) in rows
            if high < _MOST or speed + room < _MOST
        ]
        self._sane = [bounds for channel in reads for bounds in _sane(channel)]
        self._pairs = _pairs(reads)
        #: The values of the last reading that was believed, and those that the next one is compared with, if any.
        self.believed: list[float] = [0.0] * len(self._values)
        self.last: list[float] = []

    def check(self, seconds: float) -> None:
        """Check the newest readings.

        Parameters
        ----------
        seconds
            Since the reading before.

        Raises
        ------
        TripError
            Naming the reading and its value.
        """
        values: list[float] = self._values.tolist()
        total = sum(values)
        if total - total != 0.0:  # something is not a number, or infinite
            self._explain(values)
        last = self.last or values
        for index, low, high, speed, room in self._checked:
            value = values[index]
            if not low <= value <= high:
                self._explain(values)
            if abs(value - last[index]) > speed * seconds + room:
                self._jumped(index, value, last[index])
        for first, second in self._pairs:
            if abs(values[first] - values[second]) > DISAGREEMENT:
                difference = abs(values[first] - values[second])
                raise TripError(Trip.SENSOR_DISAGREE, f"has two sensors that differ by {difference:.1f} K")
        self.believed = self.last = values

    @property
    def values(self) -> list[float]:
        """All numbers of the newest reading."""
        values: list[float] = self._values.tolist()
        return values

    def put_back(self) -> None:
        """Put the last reading that was believed in the place of one that is not: nobody else shall work with it."""
        self._values[:] = self.believed

    def sane(self) -> bool:
        """Tell whether the newest reading can be worked with at all, though a limit may be passed."""
        values: list[float] = self._values.tolist()
        return all(low <= value <= high for value, (low, high) in zip(values, self._sane, strict=True))

    def forget(self) -> None:
        """Begin anew: the next reading may be anywhere in its range."""
        self.last = []

    def recall(self) -> None:
        """Take the reading that State holds as the last one believed."""
        self.believed = self.last = self._values.tolist()

    def _jumped(self, index: int, value: float, last: float) -> NoReturn:
        channel = self._channel_of(index)
        was, now = _shown(channel, last), _shown(channel, value)
        raise TripError(Trip.SENSOR_JUMP, f"reads {channel.name} {now} after {was}, which is not believable")

    def _channel_of(self, index: int) -> Channel:
        owners = [channel for channel in self._channels for _ in range(channel.size)]
        return owners[index]

    def _explain(self, values: list[float]) -> NoReturn:
        for index, value in enumerate(values):
            channel = self._channel_of(index)
            if not math.isfinite(value):
                raise TripError(Trip.NOT_A_NUMBER, f"reads {not_finite([value])} ({channel.name})")
            if not self._low[index] <= value <= self._high[index]:
                trip = _TRIPS.get(channel.name, Trip.SENSOR_RANGE)
                what = "past its trip" if channel.name in _TRIPS else "which is not believable"
                raise TripError(trip, f"reads {channel.name} {_shown(channel, value)}, {what}")
        raise TripError(Trip.NOT_A_NUMBER, "reads numbers that are too large to add up")


_TRIPS = {"plate_temperature": Trip.PLATE_TEMPERATURE, "sink_temperature": Trip.SINK_TEMPERATURE}


def _shown(channel: Channel, value: float) -> str:
    return f"{value - 273.15:.1f} degC" if channel.unit == "K" else f"{value:.4g} {channel.unit}".rstrip()


def _range(channel: Channel, limits: DeviceLimits) -> tuple[list[float], list[float]]:
    """Return the range in which a reading is believed, and beyond which the heat of plate or sink trips."""
    low = list(channel.low) or [-math.inf] * channel.size
    high = list(channel.high) or [math.inf] * channel.size
    if channel.name == "plate_temperature":
        least, most = limits.temperature_trip
    elif channel.name == "sink_temperature":
        least, most = TEMPERATURE_RANGE[0], default.SINK_TRIP
    elif channel.unit == "K":
        least, most = TEMPERATURE_RANGE
    elif channel.name == "heat_flux":
        return [SATURATED * value for value in low], [SATURATED * value for value in high]
    elif channel.name == "pose":
        return [-WORKSPACE] * 3 + [-1.001] * 4, [WORKSPACE] * 3 + [1.001] * 4
    else:
        return low, high
    return [max(least, value) for value in low], [min(most, value) for value in high]


def _sane(channel: Channel) -> list[tuple[float, float]]:
    """Return the range of each component in which a number means anything."""
    if channel.unit == "K":
        return [TEMPERATURE_RANGE] * channel.size
    low, high = _range(channel, DeviceLimits())
    return [(max(-_MOST, least), min(_MOST, most)) for least, most in zip(low, high, strict=True)]


def _change(channel: Channel, commands: Sequence[Channel]) -> list[tuple[float, float]]:
    """Return the greatest change of each component: a speed, and what is always let through."""
    free = [(0.0, math.inf)] * channel.size
    if channel.name in ("plate_temperature", "sink_temperature"):
        return [(0.0, TEMPERATURE_JUMP)]
    if channel.name != "pose":
        return free
    target = next((command for command in commands if command.name == "pose_target"), None)
    if target is None:
        return [(FINGER_SPEED, STEPS)] * 3 + free[3:]
    ceiling = target.slew[:3] if target.slew else (default.SPEED_TRIP,) * 3
    return [(SURFACE_MARGIN * speed, STEPS) for speed in ceiling] + free[3:]


def _pairs(reads: Sequence[Channel]) -> list[tuple[int, int]]:
    """Return which two components measure the same plate."""
    at, found = 0, []
    for channel in reads:
        if channel.name.startswith("plate_temperature"):
            found.append(at)
        at += channel.size
    return [(found[0], other) for other in found[1:]]
