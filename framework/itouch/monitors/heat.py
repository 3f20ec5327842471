"""Heat: the limits of a plate that a finger touches (T1 to T7), and whether its sensor and drive can be right (T8, T9).

All is over time: windows, rates, doses and means use the time at which readings were measured, and the time that has
passed between two checks, whatever the rhythm of the device.  Between a limit and its trip the drive is cut down in
proportion; past the trip the device stops.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import ClassVar

from itouch.monitors import limits as default
from itouch.monitors.history import SLOTS, History
from itouch.monitors.readings import drives, plates, separate
from itouch.monitors.runaway import COLDEST_TARGET, DRIVEN, FROZEN_DRIVE, Runaway, drive_of
from itouch.monitors.trips import Trip
from itouch.plugin import Channel, Field, Moment, Monitor, Record, Role, Rule, Watched

#: How far ahead [s] a plate's temperature is extrapolated, and over what time [s] its rate is taken for that.
AHEAD, RATE_TIME = 0.1, 0.05
#: T5, T6: the times [s] over which the rate in contact and the flux are averaged.
CONTACT_RATE_TIME, FLUX_TIME = 0.5, 1.0
#: T3: temperature [K] from which dose counts, and that at which a second is a second (Sapareto and Dewey 1984).
DOSE_FROM, DOSE_UNIT = 312.15, 316.15
#: T8: a step between two means of 50 ms [K] that no plate can do.
STEP = 5.0
_COUNTS = (RATE_TIME, 2 * RATE_TIME, CONTACT_RATE_TIME, FLUX_TIME)
_SHORT, _DOUBLE, _LONG, _MEAN = range(4)
_TRIPS = (
    Trip.PLATE_TEMPERATURE, Trip.PLATE_RATE, Trip.FLUX, Trip.DOSE, Trip.COLD, Trip.SENSOR_JUMP, Trip.SENSOR_FROZEN,
    Trip.SENSOR_DISAGREE, Trip.RUNAWAY,
)  # fmt: skip
_RULES = {
    Trip.PLATE_RATE: "T5", Trip.FLUX: "T6", Trip.DOSE: "T3", Trip.COLD: "T4c", Trip.SENSOR_JUMP: "T8",
    Trip.SENSOR_FROZEN: "T8", Trip.SENSOR_DISAGREE: "T8", Trip.RUNAWAY: "T9",
}  # fmt: skip


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
        sink, flux = device.reading(Role.HEAT_SINK_TEMPERATURE), device.reading(Role.HEAT_FLUX)
        self._sink, self._flux = (channel.name if channel is not None else "" for channel in (sink, flux))
        self._switch = device.command(Role.OUTPUT_SWITCH)
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
        # of a drive that states no ceiling a limit leaves at most the whole
        self._history, self._runaway = History(_COUNTS), Runaway(follows=follows, part=min([1.0, *parts]))

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Return one for each plate whose temperature is read: it has a sensor of what the skin touches."""
        if not plates(device):
            return ()
        return tuple(cls(device, index) for index in range(len(plates(device)) if separate(device) else 1))

    moments: ClassVar[tuple[str, ...]] = ("since", "history", "frozen_at", "parts", "touched_at")

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

    def forget(self, state: Record) -> None:
        """Forget what was measured, not the dose."""
        self._history.forget(state)
        self._runaway.forget(state)
        state["since"][...] = math.nan

    def spent(self, state: Record) -> str:
        """Say that the dose, or the time in the cold, is used up."""
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
        """Tell whether the plate is where it may never be, by its sensor."""
        plate = self._temperature(reading)
        return plate < default.PLATE_ABSOLUTE[0] or plate > default.PLATE_ABSOLUTE[1]

    def acts(self, reading: Record, sent: Record, *, withdrawn: bool = False) -> bool:
        """Tell whether its plate is driven, or held at a temperature; not by a target that safety has withdrawn."""
        plate, drives = self._temperature(reading), zip(self._drives, self._ceilings, strict=True)
        return not self._off(sent) and any(_pulls(*one, sent, plate, withdrawn) for one in drives)

    def _off(self, sent: Record) -> bool:
        return self._switch is not None and bool(sent[self._switch.name].item() < 0.5)

    def _temperature(self, reading: Record) -> float:
        return float(reading[self.plate].ravel()[self._component])

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Check the newest readings; budgets and clocks run on without news, with what was read last."""
        temperature = self._temperature(reading)
        flux = abs(reading[self._flux].item()) if self._flux else 0.0
        news = moment.fresh and self._history.add(state, moment.time, temperature, flux)
        share = min(
            self._near_temperature(state, temperature), self._near_rate(state, temperature, moment),
            self._near_flux(state) if self._flux else 1.0, self._near_sink(reading),
        )  # fmt: skip
        if share < 0.0:
            return share
        spent = self._count(state, temperature, moment)
        if spent or (spent := self._step(state) if news else 0.0):
            return spent
        sink = reading[self._sink].item() if self._sink else math.nan
        drive = self._driven(sent, temperature)
        return self._runaway.check(state, temperature, sink, drive, moment, news) or share

    def _driven(self, sent: Record, temperature: float) -> float:
        """Return how strongly the plate is driven: -1 (heats) to 1 (cools), as a part of the limit in force."""
        if self._off(sent):
            return 0.0
        found = 0.0
        for (channel, component), ceiling in zip(self._drives, self._ceilings, strict=True):
            drive = drive_of(channel, sent[channel.name].ravel()[component].item(), temperature, ceiling)
            found = drive if abs(drive) > abs(found) else found
        return found

    def _near_temperature(self, state: Record, temperature: float) -> float:
        """Return the share of the drive that the plate's temperature, a little ahead, leaves (T1, T2)."""
        (low, high), (least, most) = self._limits, self._trip
        ahead, before = temperature, self._history.before(state, _SHORT)
        if before is not None:
            ahead += (temperature - before) / RATE_TIME * AHEAD
        if not least <= ahead <= most:
            state["figure"][:] = (temperature, ahead, 0.0)
            return -float(Trip.PLATE_TEMPERATURE)
        return min(_left(low - ahead, low - least), _left(ahead - high, most - high))

    def _near_rate(self, state: Record, temperature: float, moment: Moment) -> float:
        """Return the share that the plate's rate in contact, a mean over half a second, leaves (T5)."""
        if not moment.touched:
            state["since"][...] = math.nan
            return 1.0
        since = state["since"].item()
        if math.isnan(since):
            since = self._history.newest(state)
            state["since"][...] = since
        before = self._history.value(state, max(since, self._history.newest(state) - CONTACT_RATE_TIME), _LONG)
        rate = abs(temperature - before) / CONTACT_RATE_TIME
        if rate > 2.0 * self._rate:
            state["figure"][0] = rate
            return -float(Trip.PLATE_RATE)
        return _left(rate - self._rate, self._rate)

    def _near_flux(self, state: Record) -> float:
        """Return the share that the mean of |flux| over a second leaves (T6)."""
        mean = self._history.mean_flux(state, _MEAN, FLUX_TIME)
        limit = self._most_flux
        if mean * 3.0 > limit * 3.99:  # 4/3, or a sensor that has been at the end of its scale all the time
            state["figure"][0] = mean
            return -float(Trip.FLUX)
        return _left(mean - limit, limit / 3.0)

    def _near_sink(self, reading: Record) -> float:
        """Return the share that the heat sink leaves (T7)."""
        if not self._sink:
            return 1.0
        return _left(reading[self._sink].item() - default.SINK, default.SINK_TRIP - default.SINK)

    def _count(self, state: Record, temperature: float, moment: Moment) -> float:
        """Add to the thermal dose, in seconds at 43 degC (T3), and to the time in the cold; return a trip or 0."""
        if not moment.touched:
            return 0.0
        if temperature >= DOSE_FROM:
            base = 0.5 if temperature >= DOSE_UNIT else 0.25
            state["dose"][...] = dose = state["dose"].item() + moment.seconds * base ** (DOSE_UNIT - temperature)
            if dose > self._dose:
                return -float(Trip.DOSE)
        elif temperature < default.COLD_FROM:
            state["cold_time"][...] = cold = state["cold_time"].item() + moment.seconds
            if cold > self._cold:
                return -float(Trip.COLD)
        return 0.0

    def _step(self, state: Record) -> float:
        """Trip on a step of the plate's sensor that no plate can do (T8)."""
        step = self._history.step(state, _SHORT, _DOUBLE, RATE_TIME)
        if abs(step) <= STEP:
            return 0.0
        state["figure"][0] = step
        return -float(Trip.SENSOR_JUMP)

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Say which limit was passed, by how much."""
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
        """Return T1 to T9 as far as this device has what they are about."""
        by, (low, high), (least, most) = self.device.source, self._limits, self._trip
        what = self.plate.replace("_", " ")
        dose = f"{self._dose / 60:.3g} CEM43"
        found = [
            Rule("T1", f"{what}, high", _c(high), _c(most), _c(default.PLATE_ABSOLUTE[1]), by("temperature")),
            Rule("T2", f"{what}, low", _c(low), _c(least), _c(default.PLATE_ABSOLUTE[0]), by("temperature")),
            Rule("T3", f"thermal dose of a session by {what}", f"told at {default.DOSE_WARNING / 60:g} CEM43", dose,
                 dose, by("dose")),
            Rule("T4c", f"time in contact below {_c(default.COLD_FROM)} in a session", "", f"{self._cold:g} s",
                 f"{default.COLD_TIME:g} s", by("cold_time")),
            Rule("T5", f"rate of {what} in contact, mean of 0.5 s", f"{self._rate:g} K/s", f"{2 * self._rate:g} K/s",
                 "", by("plate_rate")),
        ]  # fmt: skip
        if self._flux:
            found.append(Rule("T6", "heat flux, mean of 1 s", f"{self._most_flux / 1e3:g} kW/m²",
                              f"{self._most_flux / 750:.3g} kW/m²", "", by("flux")))  # fmt: skip
        if self._sink:
            found.append(Rule("T7", "heat sink", _c(default.SINK), _c(default.SINK_TRIP), _c(default.SINK_ABSOLUTE)))
        return (*found, *self._runaway.rules(self._drives))


def _ceiling(channel: Channel, component: int, limits: Mapping[str, object]) -> float:
    """Return the greatest drive in force: the hardware's, or the scene's if that is lower."""
    most = channel.high[component] if channel.high else math.inf
    limit = limits.get("current")
    if channel.role is Role.DRIVE and channel.unit == "A" and isinstance(limit, float):
        most = min(most, limit)
    return most if math.isfinite(most) and most > 0.0 else 1.0


def _pulls(drive: tuple[Channel, int], ceiling: float, sent: Record, plate: float, withdrawn: bool) -> bool:
    """Tell whether one drive acts; a target acts while it is held, however near to it the plate is."""
    channel, component = drive
    value: float = sent[channel.name].ravel()[component].item()
    if channel.role is Role.TEMPERATURE_TARGET:
        return value >= COLDEST_TARGET and not withdrawn
    return abs(drive_of(channel, value, plate, ceiling)) > DRIVEN


def _left(beyond: float, room: float) -> float:
    """Return what is left of the drive so far beyond a limit, with so much room to the trip."""
    return 1.0 if beyond <= 0.0 else max(0.0, 1.0 - beyond / room)


def _c(kelvin: float) -> str:
    return f"{kelvin - 273.15:.4g} °C"


__all__ = ["FROZEN_DRIVE", "SLOTS", "Heat"]
