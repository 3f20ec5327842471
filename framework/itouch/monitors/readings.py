"""Whether a reading is believed: range, jump, sensors that agree (T8, and the trips of T1, T2, T7).

A reading must be a number, in its range, and not further from the one before than the device can have gone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from itouch.monitors import default_limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import Channel, Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import readings_kernels

#: T8: greatest change of a temperature between two readings [K], and range of any temperature [K].
TEMPERATURE_JUMP, TEMPERATURE_RANGE = 20.0, (263.15, 353.15)
#: Greatest speed of a finger [m/s], room for the steps of encoders [m], how far from its origin a device reaches [m].
FINGER_SPEED, STEPS, WORKSPACE = 5.0, 0.002, 2.0
#: How many times faster than it can move a surface may seem to move before its sensor is not believed.
SURFACE_MARGIN = 3.0
#: Two sensors of one plate differ at most by this much [K].
DISAGREEMENT = 3.0
#: How far a quaternion's length may be from 1: three decimals are enough for that.  A worse one would stretch the frame
#: of what is mounted on the device.
STRETCH = 0.01
#: A flux sensor at the end of its scale is believed; its last count may lie beyond the scale by this factor.
SATURATED = 1.01
_MOST = 1e300
#: By how much the sum of the squares of a quaternion's parts may then differ from 1.
_STRETCHED = (1.0 + STRETCH) ** 2 - 1.0

Floats = list[float]


class Readings(Monitor):
    """Checks every reading of one device: that it is finite, in range, changes no faster than possible, and agrees."""

    name = "readings"
    trips: ClassVar[Mapping[int, str]] = {
        int(trip): trip.label
        for trip in (
            Trip.NOT_A_NUMBER, Trip.SENSOR_RANGE, Trip.PLATE_TEMPERATURE, Trip.SINK_TEMPERATURE, Trip.SENSOR_JUMP,
            Trip.SENSOR_DISAGREE,
        )
    }  # fmt: skip

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        self._channels = [channel for channel in device.reads for _ in range(channel.size)]
        low: Floats = []
        high: Floats = []
        speeds: list[tuple[float, float]] = []  # greatest change: per second [m/s or K/s], and at once [m or K]
        for channel in device.reads:
            least, most = _range(channel, device.limits)
            low += least
            high += most
            speeds += _change(channel, device.commands)
        self._low, self._high, self._speeds = low, high, speeds
        self._usable = [bounds for channel in device.reads for bounds in _usable(channel)]
        self._pairs = pairs(device)
        self._turns = turns(device)

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device that reads anything."""
        return (cls(device),) if device.reads else ()

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        count = len(self._channels)
        return (
            Field(
                "believed", "f8", count, unit="mixed", doc="the last reading that was believed, in the channels' units"
            ),
            Field("known", "i8", low=0, high=1, unit="1", doc="1 while the next reading is compared with that one"),
            Field(
                "figure",
                "f8",
                2,
                unit="mixed",
                doc="which number tripped; how far two sensors were apart, or how long a quaternion was",
            ),
        )

    def clear_history(self, state: Record) -> None:
        """Forget the last reading: the next one may be anywhere in its range."""
        state["known"][...] = 0

    def recall(self, state: Record, reading: Record) -> None:
        """Take a reading as the last one believed."""
        state["believed"][:] = reading.numbers
        state["known"][...] = 1

    def put_back(self, state: Record, reading: Record) -> None:
        """Replace a reading that is not believed by the last one that was, so that nobody works with it."""
        reading.numbers[:] = state["believed"]

    def mend(self, state: Record, reading: Record) -> None:
        """Replace the numbers of each channel that mean nothing by the last believed ones; other channels stay.

        The force that a device measures may be right although its position is not.
        """
        values, at = reading.numbers, 0
        for channel in self.device.reads:
            end = at + channel.size
            bounds = self._usable[at:end]
            within = all(
                low <= value <= high for value, (low, high) in zip(values[at:end].tolist(), bounds, strict=True)
            )
            if not within or not all(_rotation(values, turn) for turn in self._turns if at <= turn < end):
                values[at:end] = state["believed"][at:end]
            at = end

    def usable(self, reading: Record) -> bool:
        """Tell whether a reading can be worked with at all, even if it passes a limit."""
        values: Floats = reading.numbers.tolist()
        within = all(low <= value <= high for value, (low, high) in zip(values, self._usable, strict=True))
        return within and all(_rotation(values, turn) for turn in self._turns)

    def memory(self, state: Record) -> readings_kernels.Memory:
        """Return what it remembers, for compiled code."""
        from itouch.monitors.readings_kernels import Memory

        return Memory(state["believed"], state["known"].reshape(1), state["figure"])

    @cached_property
    def plausibility(self) -> readings_kernels.PlausibilityLimits:
        """What readings are plausible, for compiled code."""
        from itouch.monitors.readings_kernels import PlausibilityLimits

        checked = [
            index
            for index, (most, (speed, room)) in enumerate(zip(self._high, self._speeds, strict=True))
            if most < _MOST or speed + room < _MOST
        ]
        speeds = np.array(self._speeds, np.float64).reshape(-1, 2)
        trips = [int(_TRIPS.get(channel.role, Trip.SENSOR_RANGE)) for channel in self._channels]
        return PlausibilityLimits(
            np.array(self._low), np.array(self._high), np.array(trips, np.int64), np.array(checked, np.int64),
            speeds[:, 0].copy(), speeds[:, 1].copy(), np.array([one for one, _ in self._pairs], np.int64),
            np.array([other for _, other in self._pairs], np.int64), np.array([DISAGREEMENT]),
            np.array(self._turns, np.int64), np.array([_STRETCHED]), np.array([int(Trip.SENSOR_DISAGREE)]),
            np.array([int(Trip.SENSOR_JUMP)]), np.array([int(Trip.NOT_A_NUMBER)]), np.array([int(Trip.SENSOR_RANGE)]),
        )  # fmt: skip

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check the newest reading; ``moment.seconds`` is the time since the reading before."""
        from itouch.monitors.readings_kernels import check  # here, so that the compiler is loaded only if a device runs

        return check(self.plausibility, self.memory(state), reading.numbers, float(moment.seconds))

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return the reading that tripped, with its value."""
        index, apart = int(state["figure"][0]), float(state["figure"][1])
        if index < 0:
            return "reads numbers that are too large to add up"
        channel = self._channels[index]
        value, last = (float(x) for x in (reading.numbers[index], state["believed"][index]))
        if code == Trip.NOT_A_NUMBER:
            return f"reads {not_finite([value])} ({channel.name})"
        if code == Trip.SENSOR_RANGE and apart > 0.0:
            return f"reads a quaternion of length {apart:.3g} ({channel.name}), which is not a rotation"
        if code == Trip.SENSOR_DISAGREE:
            return f"has two sensors that differ by {apart:.1f} K"
        if code == Trip.SENSOR_JUMP:
            return f"reads {channel.name} {shown(channel, value)} after {shown(channel, last)}, which is not believable"
        what = "which is not believable" if code == Trip.SENSOR_RANGE else "past its trip"
        return f"reads {channel.name} {shown(channel, value)}, {what}"

    def rule(self, code: int, reading: Record) -> str:
        """Return the rule that a trip belongs to."""
        if code == Trip.PLATE_TEMPERATURE:
            plates = [c for c in self.device.reads if c.role is Role.SKIN_CONTACT_TEMPERATURE]
            low, _ = self.device.limits["temperature_trip"]
            return "T2" if any(value < low for c in plates for value in reading[c.name].ravel().tolist()) else "T1"
        return "T7" if code == Trip.SINK_TEMPERATURE else "T8"

    def rules(self) -> tuple[Rule, ...]:
        """Return the part of T8 that concerns single readings."""
        found = ["not a number"]
        roles = {channel.role for channel in self.device.reads}
        if any(channel.unit == "K" for channel in self.device.reads):
            found.append("outside -10 to 80 °C")
        if roles & {Role.SKIN_CONTACT_TEMPERATURE, Role.HEAT_SINK_TEMPERATURE}:
            found.append("jump of 20 K")
        if Role.TRACKED_POSE in roles:
            found.append("2 m from the device's origin, faster than it can move")
        if any(low > -_MOST for low in self._low) or any(high < _MOST for high in self._high):
            found.append("outside its range")
        if self._pairs:
            found.append(f"two sensors of one plate {DISAGREEMENT:g} K apart")
        return (Rule("T8", "plausibility of its readings", trip=", ".join(dict.fromkeys(found))),)


_TRIPS = {
    Role.SKIN_CONTACT_TEMPERATURE: Trip.PLATE_TEMPERATURE, Role.HEAT_SINK_TEMPERATURE: Trip.SINK_TEMPERATURE,
}  # fmt: skip


def not_finite(values: Sequence[float]) -> str:
    """Return what is wrong with numbers of which at least one is not finite, or whose sum is not."""
    return next(("NaN" if math.isnan(v) else "an infinite number" for v in values if not math.isfinite(v)), "too much")


def shown(channel: Channel, value: float) -> str:
    """Return a reading in words."""
    return f"{value - 273.15:.1f} degC" if channel.unit == "K" else f"{value:.4g} {channel.shown_unit}".rstrip()


def plates(device: Watched) -> list[tuple[int, str, int]]:
    """Return each sensor of the temperature that the skin touches: its index in the reading, channel, component."""
    at, found = 0, []
    for channel in device.reads:
        if channel.role is Role.SKIN_CONTACT_TEMPERATURE:
            found += [(at + index, channel.name, index) for index in range(channel.size)]
        at += channel.size
    return found


def drives(device: Watched) -> list[tuple[Channel, int]]:
    """Return the components of commands that heat or cool."""
    wanted = device.commands_with(Role.DRIVE, Role.TEMPERATURE_TARGET)
    return [(channel, index) for channel in wanted for index in range(channel.size)]


def separate(device: Watched) -> bool:
    """Tell whether a device has several plates, each with its sensor and its drive, in this order."""
    return len(plates(device)) == len(drives(device)) > 1


def pairs(device: Watched) -> list[tuple[int, int]]:
    """Return the pairs of indices in the reading that measure the same plate."""
    found = [number for number, _, _ in plates(device)]
    return [] if separate(device) else [(found[0], other) for other in found[1:]]


def turns(device: Watched) -> list[int]:
    """Return the indices in the reading at which the quaternion of a pose begins."""
    at, found = 0, []
    for channel in device.reads:
        if channel.role is Role.TRACKED_POSE and channel.size == 7:
            found.append(at + 3)
        at += channel.size
    return found


def _rotation(values: Any, at: int) -> bool:
    """Tell whether four numbers of a reading (n,), from ``at`` on, are a rotation, or all zero, which tells none."""
    squared = math.fsum(float(value) ** 2 for value in values[at : at + 4])
    return squared == 0.0 or abs(squared - 1.0) <= _STRETCHED


def _range(channel: Channel, limits: Mapping[str, object]) -> tuple[Floats, Floats]:
    """Return the range in which a reading is believed; for plate and heat sink also that of their trips."""
    low = list(channel.low) or [-math.inf] * channel.size
    high = list(channel.high) or [math.inf] * channel.size
    trip = limits.get("temperature_trip", default.PLATE_TRIP)
    if channel.role is Role.SKIN_CONTACT_TEMPERATURE and isinstance(trip, tuple):
        least, most = trip
    elif channel.role is Role.HEAT_SINK_TEMPERATURE:
        least, most = TEMPERATURE_RANGE[0], default.SINK_TRIP
    elif channel.unit == "K":
        least, most = TEMPERATURE_RANGE
    elif channel.role is Role.HEAT_FLUX:
        return [SATURATED * value for value in low], [SATURATED * value for value in high]
    elif channel.role is Role.TRACKED_POSE and channel.size == 7:
        return [-WORKSPACE] * 3 + [-1.001] * 4, [WORKSPACE] * 3 + [1.001] * 4
    else:
        return low, high
    return [max(least, value) for value in low], [min(most, value) for value in high]


def _usable(channel: Channel) -> list[tuple[float, float]]:
    """Return the range of each component outside which a number means nothing."""
    if channel.unit == "K":
        return [TEMPERATURE_RANGE] * channel.size
    low, high = _range(channel, {})
    return [(max(-_MOST, least), min(_MOST, most)) for least, most in zip(low, high, strict=True)]


def _change(channel: Channel, commands: Sequence[Channel]) -> list[tuple[float, float]]:
    """Return the greatest change of each component: per second, and a step that is always let through."""
    free = [(0.0, math.inf)] * channel.size
    if channel.role in _TRIPS:
        return [(0.0, TEMPERATURE_JUMP)] * channel.size
    if channel.role is not Role.TRACKED_POSE or channel.size < 3:
        return free
    target = next((command for command in commands if command.role is Role.SURFACE_POSE), None)
    if target is None:
        return [(FINGER_SPEED, STEPS)] * 3 + free[3:]
    ceiling = target.slew[:3] if target.slew else (default.SPEED_TRIP,) * 3
    return [(SURFACE_MARGIN * speed, STEPS) for speed in ceiling] + free[3:]
