"""Heat: the limits of a plate that a finger touches (T1 to T7), and whether its sensor and drive can be right (T8, T9).

Everything is computed by time, not by counting readings: windows, rates, doses and means use the times at which
readings were measured, and the time between two checks, however often the device is read.  Between a limit and its trip
the drive is cut down in proportion; past the trip the device stops.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import default_limits as default
from itouch.monitors.readings import drives, plates, separate
from itouch.monitors.runaway import Runaway, drive_of, signed
from itouch.monitors.thresholds import COLDEST_TARGET, DRIVEN, READINGS, WINDOWS
from itouch.monitors.trips import Trip
from itouch.plugin import Channel, Field, Moment, Monitor, Record, Role, Rule, Watched

if TYPE_CHECKING:
    from itouch.monitors import heat_kernels, history_kernels, runaway_kernels

_TRIPS = (
    Trip.PLATE_TEMPERATURE, Trip.PLATE_RATE, Trip.FLUX, Trip.DOSE, Trip.COLD, Trip.SENSOR_JUMP, Trip.SENSOR_FROZEN,
    Trip.SENSOR_DISAGREE, Trip.RUNAWAY,
)  # fmt: skip
_RULES = {
    Trip.PLATE_RATE: "T5", Trip.FLUX: "T6", Trip.DOSE: "T3", Trip.COLD: "T4c", Trip.SENSOR_JUMP: "T8",
    Trip.SENSOR_FROZEN: "T8", Trip.SENSOR_DISAGREE: "T8", Trip.RUNAWAY: "T9",
}  # fmt: skip


class History:
    """Keeps rows of time, temperature, and the integrals of temperature and |flux| so far, for looking back.

    The arithmetic is in ``history_kernels``.

    Parameters
    ----------
    windows
        How far to look back [s]; each window has a pointer of its own, so that looking back takes a step or two.
    """

    def __init__(self, windows: Sequence[float]) -> None:
        self._windows = tuple(windows)

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            Field("samples", "i8", low=0, unit="1", doc="readings taken since the device was away"),
            Field(
                "history",
                "f8",
                (READINGS, 4),
                unit="mixed",
                doc="time, temperature, and integrals of it and of the flux",
            ),  # fmt: skip
            Field("flux", unit="W/m^2", doc="the newest magnitude of the flux"),
            Field("tails", "i8", len(self._windows), low=0, unit="1", doc="where each window begins"),
        )

    def clear(self, state: Record) -> None:
        """Forget all readings."""
        state["samples"][...] = 0
        state["tails"][:] = 0

    def past(self, state: Record) -> history_kernels.ReadingRing:
        """Return the readings, for compiled code."""
        # here, so that the compiler is loaded only if a device runs
        from itouch.monitors.history_kernels import ReadingRing

        samples, flux = state["samples"].reshape(1), state["flux"].reshape(1)
        return ReadingRing(samples, state["history"], flux, state["tails"], np.array(self._windows))


class Heat(Monitor):
    """Watches one plate."""

    trips: ClassVar[Mapping[int, str]] = {int(trip): trip.label for trip in _TRIPS}

    def __init__(self, device: Watched, index: int = 0) -> None:
        super().__init__(device)
        alone = not separate(device)
        self.name = "heat" if index == 0 else f"heat{index + 1}"
        _, self.plate, self._component = plates(device)[index]
        listed = drives(device)
        self._drives = listed if alone else [listed[index]]
        wanted = index if separate(device) else None
        self._sinks = _of_plate(device.readings(Role.HEAT_SINK_TEMPERATURE), len(plates(device)), wanted)
        self._fluxes = _of_plate(device.readings(Role.HEAT_FLUX), len(plates(device)), wanted)
        self._switches = _of_plate(device.commands_with(Role.OUTPUT_SWITCH), len(plates(device)), wanted)
        limits = device.limits
        self._limits = limits.get("temperature") or default.PLATE_TEMPERATURE
        self._trip = limits.get("temperature_trip") or default.PLATE_TRIP
        self._rate = limits.get("plate_rate") or default.PLATE_RATE
        self._most_flux = limits.get("flux") or default.FLUX
        self._dose = limits.get("dose") or default.DOSE
        self._cold = limits.get("cold_time") or default.COLD_TIME
        self._ceilings = [_ceiling(channel, component, limits) for channel, component in self._drives]
        hardware = [_ceiling(channel, component, {}) for channel, component in self._drives]
        parts = [most / least for most, least in zip(self._ceilings, hardware, strict=True)]
        follows = all(channel.role is Role.DRIVE for channel, _ in self._drives)
        # a drive that states no ceiling counts as unlimited: its part is at most 1
        self._history, self._runaway = History(WINDOWS), Runaway(follows=follows, part=min([1.0, *parts]))

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Return one for each plate that has a sensor and a drive of its own, else one for all sensors, if any."""
        if not plates(device):
            return ()
        return tuple(cls(device, index) for index in range(len(plates(device)) if separate(device) else 1))

    time_fields: ClassVar[tuple[str, ...]] = ("since", "history", "frozen_at", "parts", "touched_at")

    @property
    def watches(self) -> tuple[str, ...]:
        """Names of the drives that heat or cool its plate."""
        return tuple(dict.fromkeys(channel.name for channel, _ in self._drives))

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (
            *self._history.fields(),
            Field("dose", low=0.0, unit="s", doc="thermal dose given so far, in seconds at 43 degC (T3)"),
            Field("cold_time", low=0.0, unit="s", doc="time in contact with a cold plate so far"),
            Field("since", unit="s", doc="when the contact that lasts began; NaN: none lasts"),
            *self._runaway.fields(),
            Field("figure", "f8", 3, unit="mixed", doc="the figures of the last trip"),
        )

    def clear_history(self, state: Record) -> None:
        """Forget what was measured, but not the dose."""
        self._history.clear(state)
        self._runaway.clear(state)
        state["since"][...] = math.nan

    def exhausted_budget(self, state: Record) -> str:
        """Return the words for a dose, or a time in the cold, that is used up; empty: neither is."""
        if state["dose"].item() > self._dose:
            return "has given the whole thermal dose of a session"
        if state["cold_time"].item() > self._cold:
            return "has been touched for as long as a cold plate may be in a session"
        return ""

    def shown(self, reading: Record) -> str:
        """Return the plate's temperature in words."""
        plate = self._temperature(reading)
        return f"at {plate - 273.15:.1f} degC" if math.isfinite(plate) else "not measured"

    def beyond(self, reading: Record) -> bool:
        """Tell whether the plate, by its sensor, has a temperature that it may never have."""
        plate = self._temperature(reading)
        return plate < default.PLATE_ABSOLUTE[0] or plate > default.PLATE_ABSOLUTE[1]

    def acts(self, reading: Record, sent: Record, *, withdrawn: bool = False) -> bool:
        """Tell whether its plate is driven, or held at a temperature; with ``withdrawn`` no target counts."""
        plate, drives = self._temperature(reading), zip(self._drives, self._ceilings, strict=True)
        return not self._off(sent) and any(_pulls(*one, sent, plate, withdrawn) for one in drives)

    def _off(self, sent: Record) -> bool:
        listed = [sent[channel.name].ravel()[component].item() for channel, component in self._switches]
        return bool(listed) and all(value < 0.5 for value in listed)

    def _temperature(self, reading: Record) -> float:
        return float(reading[self.plate].ravel()[self._component])

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check the newest readings; without a new one, budgets and clocks run on with the last one."""
        from itouch.monitors import heat_kernels, runaway_kernels  # here: the compiler is loaded only if a device runs

        look = runaway_kernels.Look(float(moment.now), float(moment.time), float(moment.seconds), bool(moment.touched))
        numbers, commands = self.numbers(reading), self.numbers(sent)
        fresh = bool(moment.fresh)
        return heat_kernels.check(
            self.stands, self.allowed, self.checks, self.memory(state), numbers, commands, look, fresh
        )

    @staticmethod
    def numbers(record: Record) -> NDArray[np.float64]:
        """Return all numbers of a reading or of commands, shape (n,)."""
        return record.numbers if record.nbytes else np.zeros(0)

    @cached_property
    def stands(self) -> heat_kernels.Plate:
        """The places of its numbers in readings and commands, for compiled code."""
        from itouch.monitors.heat_kernels import Plate

        reads, commands = _places(self.device.reads), _places(self.device.commands)
        listed = [(*one, most) for one, most in zip(self._drives, self._ceilings, strict=True)]
        return Plate(
            reads[self.plate] + self._component, _numbers(reads, self._fluxes), _numbers(reads, self._sinks),
            _numbers(commands, self._switches),
            np.array([commands[channel.name] + component for channel, component, _ in listed], np.int64),
            np.array([signed(channel, most) for channel, _, most in listed], np.float64),
            np.array([channel.role is Role.TEMPERATURE_TARGET for channel, _, _ in listed], np.int64),
        )  # fmt: skip

    @cached_property
    def allowed(self) -> heat_kernels.Allowed:
        """The limits that it holds the plate to, for compiled code."""
        from itouch.monitors.heat_kernels import Allowed

        (low, high), (least, most) = self._limits, self._trip
        temperature, rate, flux, dose, cold, jump = (int(trip) for trip in _TRIPS[:6])
        return Allowed(
            float(least), float(low), float(high), float(most), float(self._rate), float(self._most_flux),
            float(self._dose), float(self._cold), temperature, rate, flux, dose, cold, jump,
        )  # fmt: skip

    @property
    def checks(self) -> runaway_kernels.SensorChecks:
        """What is known of its drive, for compiled code."""
        return self._runaway.checks

    def memory(self, state: Record) -> heat_kernels.Memory:
        """Return what it remembers, for compiled code."""
        from itouch.monitors.heat_kernels import Memory

        dose, cold, since = (state[name].reshape(1) for name in ("dose", "cold_time", "since"))
        return Memory(self._history.past(state), dose, cold, since, state["figure"], self._runaway.memory(state))

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return which limit was passed, with the value that passed it."""
        a, b = state["figure"][:2].tolist()
        if code == Trip.PLATE_TEMPERATURE:
            return f"reads {self.plate} {a - 273.15:.1f} degC, on its way to {b - 273.15:.1f} degC, past its trip"
        if code == Trip.PLATE_RATE:
            return f"changes its plate by {a:.1f} K/s under the finger"
        if code == Trip.FLUX:
            return f"had a mean flux of {a / 1e3:.1f} kW/m^2 for a second"
        if code == Trip.DOSE:
            return f"has given a thermal dose of {state['dose'].item() / 60:.2f} CEM43, the most for a session"
        if code == Trip.COLD:
            return f"was touched while cold for {state['cold_time'].item():.1f} s, the most for a session"
        if code == Trip.SENSOR_JUMP:
            return f"reads a step of the plate of {a:+.1f} K, not believable"
        return self._runaway.sentence(code, state, self.plate)

    def rule(self, code: int, reading: Record) -> str:
        """Return the rule that a trip belongs to."""
        if code == Trip.PLATE_TEMPERATURE:
            return "T1" if self._temperature(reading) > 0.5 * sum(self._limits) else "T2"
        return _RULES[Trip(code)]

    def rules(self) -> tuple[Rule, ...]:
        """Return those of T1 to T9 that apply to this device."""
        by, (low, high), (least, most) = self.device.source, self._limits, self._trip
        what = self.plate.replace("_", " ")
        dose, told = f"{self._dose / 60:.3g} CEM43", f"told at {default.told_from(self._dose) / 60:.3g} CEM43"
        found = [
            Rule("T1", f"{what}, high", _c(high), _c(most), _c(default.PLATE_ABSOLUTE[1]), by("temperature")),
            Rule("T2", f"{what}, low", _c(low), _c(least), _c(default.PLATE_ABSOLUTE[0]), by("temperature")),
            Rule("T3", f"thermal dose of a session by {what}", told, dose, dose, by("dose")),
            Rule("T4c", f"time in contact below {_c(default.COLD_FROM)} in a session", "", f"{self._cold:g} s",
                 f"{default.COLD_TIME:g} s", by("cold_time")),
            Rule("T5", f"rate of {what} in contact, mean of 0.5 s", f"{self._rate:g} K/s", f"{2 * self._rate:g} K/s",
                 "", by("plate_rate")),
        ]  # fmt: skip
        if self._fluxes:
            found.append(Rule("T6", "heat flux, mean of 1 s", f"{self._most_flux / 1e3:g} kW/m²",
                              f"{self._most_flux / 750:.3g} kW/m²", "", by("flux")))  # fmt: skip
        if self._sinks:
            found.append(Rule("T7", "heat sink", _c(default.SINK), _c(default.SINK_TRIP), _c(default.SINK_ABSOLUTE)))
        return (*found, *self._runaway.rules(self._drives))


def _ceiling(channel: Channel, component: int, limits: Mapping[str, object]) -> float:
    """Return the greatest drive in force: the hardware's, or the scene's if that is lower; 1 if neither states one."""
    most = channel.high[component] if channel.high else math.inf
    limit = limits.get("current")
    if channel.role is Role.DRIVE and channel.unit == "A" and isinstance(limit, float):
        most = min(most, limit)
    return most if math.isfinite(most) and most > 0.0 else 1.0


def _pulls(drive: tuple[Channel, int], ceiling: float, sent: Record, plate: float, withdrawn: bool) -> bool:
    """Tell whether one drive acts; a temperature target acts while it is held, however near to it the plate is."""
    channel, component = drive
    value: float = sent[channel.name].ravel()[component].item()
    if channel.role is Role.TEMPERATURE_TARGET:
        return value >= COLDEST_TARGET and not withdrawn
    return abs(drive_of(channel, value, plate, ceiling)) > DRIVEN


def _places(channels: Iterable[Channel]) -> dict[str, int]:
    """Return the index of each channel's first number among the numbers of all."""
    found, at = {}, 0
    for channel in channels:
        found[channel.name] = at
        at += max(1, channel.size)
    return found


def _of_plate(channels: Iterable[Channel], plates: int, index: int | None) -> list[tuple[Channel, int]]:
    """Return the components that belong to a plate: its own if there is one for each plate; else all, as none is known.

    ``plates``: how many plates there are; ``index``: which plate it is; None: it is the only one.
    """
    listed = [(channel, component) for channel in channels for component in range(channel.size)]
    return [listed[index]] if index is not None and len(listed) == plates else listed


def _numbers(places: Mapping[str, int], listed: Iterable[tuple[Channel, int]]) -> NDArray[np.int64]:
    """Return the indices of components among the numbers of all channels, shape (n,)."""
    return np.array([places[channel.name] + component for channel, component in listed], np.int64)


def _c(kelvin: float) -> str:
    """Return a temperature as tables of limits show it; what a terminal says has degC, as scenes do."""
    return f"{kelvin - 273.15:.4g} °C"
