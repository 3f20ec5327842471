"""Heat: the limits of a plate that a finger touches (T1 to T7), and whether its sensor and drive can be right (T8, T9).

Checked every 10 ms.  Between a limit and its trip the drive is cut down in proportion; past the trip the device stops.
"""

from __future__ import annotations

import math
from typing import NoReturn

from itouch.plugin import Record
from itouch.safety.trips import Trip, TripError
from itouch.world import limits as default
from itouch.world.rig import DeviceModel
from itouch.world.supervision import FLUX_WINDOW, RATE_WINDOW

#: How far ahead [s] a plate's temperature is extrapolated, and over what time [s] its rate is taken for that.
AHEAD, RATE_TIME = 0.1, 0.05
#: T5, T6: the times [s] over which the rate in contact and the flux are averaged.
CONTACT_RATE_TIME, FLUX_TIME = 0.5, 1.0
#: T3: temperature [K] from which dose counts, and that at which a second is a second (Sapareto and Dewey 1984).
DOSE_FROM, DOSE_UNIT = 312.15, 316.15
#: T8: a step between two means of 50 ms [K] that no plate can do.
STEP = 5.0
#: T8: how long [s] a driven plate may read exactly the same, what part of the drive's ceiling counts as driven, and
#: how many seconds of full drive are enough by themselves.
FROZEN, DRIVEN, FROZEN_DRIVE = 1.0, 0.02, 0.15
#: T9: part of the ceiling, for how long [s], and what change of temperature [K] that must have, or must not; the time
#: [s] that drive and sensor may lag.
RUNAWAY_DRIVE, RUNAWAY_TIME, RUNAWAY_STILL, RUNAWAY_WRONG, LAG = 0.5, 2.0, 0.1, 2.0, 0.15


class Heat:
    """Watches one plate; everything that it remembers is State."""

    def __init__(self, model: DeviceModel, state: Record, reading: Record, sent: Record, seconds: float) -> None:
        self._seconds, self._limits = seconds, model.limits
        self._short = max(1, round(RATE_TIME / seconds))
        self._long = max(1, min(RATE_WINDOW, round(CONTACT_RATE_TIME / seconds)))
        self._mean = max(1, min(FLUX_WINDOW, round(FLUX_TIME / seconds)))
        self._plate = reading["plate_temperature"]
        self._sink = reading.get("sink_temperature")
        self._flux = reading.get("heat_flux")
        self._sent, self._ceiling = sent.get("current"), 1.0
        channel = model.command("current")
        if channel is not None and channel.high and math.isfinite(channel.high[0]):
            self._ceiling = channel.high[0]
        name = model.name
        self.touched, self.dose, self.share = (
            state[f"{name}.touched"], state[f"{name}.heat.dose"], state[f"{name}.heat.share"],
        )  # fmt: skip
        self._samples, self._since = state[f"{name}.heat.samples"], state[f"{name}.heat.touched"]
        self._frozen, self._frozen_for = state[f"{name}.heat.frozen"], state[f"{name}.heat.frozen_for"]
        self._frozen_drive, self._frozen_from = state[f"{name}.heat.frozen_drive"], state[f"{name}.heat.frozen_from"]
        self._driven_for, self._driven_from = state[f"{name}.heat.driven_for"], state[f"{name}.heat.driven_from"]
        self._temperatures, self._fluxes = state[f"{name}.heat.temperatures"], state[f"{name}.heat.fluxes"]

    def reset(self) -> None:
        """Begin with nothing remembered and the whole drive let through; without a rig a touch must be assumed."""
        self.share[...] = 1.0
        self.touched[...] = 1
        self.forget()

    def forget(self) -> None:
        """Forget what was measured, not the dose."""
        self._samples[...] = 0
        self._since[...] = 0
        self._frozen[...] = math.nan
        self._driven_for[...] = 0.0

    @property
    def shown(self) -> str:
        """The plate's temperature in words."""
        plate = self._plate.item()
        return f"at {plate - 273.15:.1f} degC" if math.isfinite(plate) else "not measured"

    def beyond(self) -> bool:
        """Tell whether the plate is where it may never be, by its sensor."""
        plate = self._plate.item()
        return bool(plate < default.PLATE_ABSOLUTE[0] or plate > default.PLATE_ABSOLUTE[1])

    def check(self) -> None:
        """Check the newest readings.

        Raises
        ------
        TripError
            Naming the limit and the value.
        """
        temperature = self._plate.item()
        samples: int = self._samples.item()
        self._temperatures[samples % (RATE_WINDOW + 1)] = temperature
        self._samples[...] = samples + 1
        share = self._near_temperature(temperature, samples)
        share = min(share, self._near_rate(temperature, samples), self._near_flux(samples), self._near_sink())
        self.share[...] = share
        self._count_dose(temperature)
        self._step(samples)
        drive = self._sent.item() / self._ceiling if self._sent is not None else 0.0
        self._still(temperature, drive)
        self._runaway(temperature, drive)

    def _before(self, samples: int, count: int) -> float:
        """Return the temperature so many checks ago."""
        return float(self._temperatures[(samples - count) % (RATE_WINDOW + 1)])

    def _near_temperature(self, temperature: float, samples: int) -> float:
        """Return the share of the drive that the plate's temperature, a little ahead, leaves (T1, T2)."""
        low, high = self._limits.temperature or default.PLATE_TEMPERATURE
        least, most = self._limits.temperature_trip
        ahead = temperature
        if samples >= self._short:
            change = temperature - self._before(samples, self._short)
            ahead += change / (self._short * self._seconds) * AHEAD
        if not least <= ahead <= most:
            shown = f"{temperature - 273.15:.1f} degC, on its way to {ahead - 273.15:.1f} degC"
            raise TripError(Trip.PLATE_TEMPERATURE, f"reads plate_temperature {shown}, past its trip")
        return min(_left(low - ahead, low - least), _left(ahead - high, most - high))

    def _near_rate(self, temperature: float, samples: int) -> float:
        """Return the share that the plate's rate in contact, a mean over half a second, leaves (T5)."""
        if not self.touched.item():
            self._since[...] = 0
            return 1.0
        since = min(self._since.item() + 1, self._long + 1)
        self._since[...] = since
        rate = abs(temperature - self._before(samples, since - 1)) / (self._long * self._seconds)
        limit = self._limits.plate_rate or default.PLATE_RATE
        if rate > 2.0 * limit:
            raise TripError(Trip.PLATE_RATE, f"changes its plate by {rate:.1f} K/s under the finger")
        return _left(rate - limit, limit)

    def _near_flux(self, samples: int) -> float:
        """Return the share that the mean of |flux| over a second leaves (T6)."""
        if self._flux is None:
            return 1.0
        count = self._mean
        self._fluxes[samples % count] = abs(self._flux.item())
        mean = float(self._fluxes[:count].sum()) / count if samples >= count else 0.0
        limit = self._limits.flux or default.FLUX
        if mean * 3.0 > limit * 3.99:  # 4/3, or a sensor that has been at the end of its scale all the time
            raise TripError(Trip.FLUX, f"had a mean flux of {mean / 1e3:.1f} kW/m^2 for a second")
        return _left(mean - limit, limit / 3.0)

    def _near_sink(self) -> float:
        """Return the share that the heat sink leaves (T7)."""
        if self._sink is None:
            return 1.0
        return _left(self._sink.item() - default.SINK, default.SINK_TRIP - default.SINK)

    def _count_dose(self, temperature: float) -> None:
        """Add to the thermal dose, in seconds at 43 degC (T3)."""
        if temperature < DOSE_FROM or not self.touched.item():
            return
        base = 0.5 if temperature >= DOSE_UNIT else 0.25
        dose = self.dose.item() + self._seconds * base ** (DOSE_UNIT - temperature)
        self.dose[...] = dose
        limit = self._limits.dose or default.DOSE
        if dose > limit:
            raise TripError(Trip.DOSE, f"has given a thermal dose of {dose / 60:.2f} CEM43, the most for a session")

    def _step(self, samples: int) -> None:
        """Trip on a step of the plate's sensor that no plate can do (T8)."""
        count = self._short
        if samples < 2 * count:
            return
        new = sum(self._before(samples, back) for back in range(count)) / count
        old = sum(self._before(samples, back + count) for back in range(count)) / count
        if abs(new - old) > STEP:
            raise TripError(Trip.SENSOR_JUMP, f"reads a step of the plate of {new - old:+.1f} K, not believable")

    def _still(self, temperature: float, drive: float) -> None:
        """Trip on a sensor that reads exactly the same while the drive changes (T8)."""
        if temperature != self._frozen.item():
            self._frozen[...] = temperature
            self._frozen_for[...] = self._frozen_drive[...] = 0.0
            self._frozen_from[...] = drive
            return
        change = abs(drive - self._frozen_from.item())
        passed, driven = self._frozen_for.item() + self._seconds, self._frozen_drive.item() + change * self._seconds
        self._frozen_for[...] = passed
        self._frozen_drive[...] = driven
        if driven > FROZEN_DRIVE or (passed > FROZEN and driven > DRIVEN * passed):
            raise TripError(Trip.SENSOR_FROZEN, f"reads the same plate_temperature for {passed:.2f} s while driven")

    def _runaway(self, temperature: float, drive: float) -> None:
        """Trip if the plate does not follow a strong drive, or goes the wrong way; a current > 0 cools (T9)."""
        passed = self._driven_for.item()
        if abs(drive) <= RUNAWAY_DRIVE or drive * passed < 0.0:
            self._driven_for[...] = 0.0
            return
        if abs(passed) <= LAG:
            self._driven_from[...] = temperature
        passed += math.copysign(self._seconds, drive)
        self._driven_for[...] = passed
        cooled = math.copysign(1.0, drive) * (self._driven_from.item() - temperature)
        if cooled < -RUNAWAY_WRONG:
            self._ran_away(f"went {-cooled:.1f} K against its drive")
        if abs(passed) >= RUNAWAY_TIME:
            if abs(cooled) < RUNAWAY_STILL and not self.touched.item():
                self._ran_away(f"did not follow its drive for {abs(passed):.1f} s")
            self._driven_for[...] = 0.0

    @staticmethod
    def _ran_away(what: str) -> NoReturn:
        raise TripError(Trip.RUNAWAY, f"{what}: drive or sensor must be wrong")


def _left(beyond: float, room: float) -> float:
    """Return what is left of the drive so far beyond a limit, with so much room to the trip."""
    return 1.0 if beyond <= 0.0 else max(0.0, 1.0 - beyond / room)
