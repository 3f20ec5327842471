"""An instrumented sample as a device plugin: it has readings, and no commands."""

from __future__ import annotations

import math
import time
from typing import Any, ClassVar

from itouch.plugin import (
    Channel,
    Device,
    DeviceError,
    Opening,
    Record,
    Role,
    Timing,
    heat_flux,
    measured_wrench,
    skin_temperature,
    temperature,
)
from itouch_thermal.drivers.labjack import LabJackDriver
from itouch_thermal.film.film_params import FilmParams
from itouch_thermal.film.twin import FilmTwin

#: The skin's reading until a thermometer has seen the skin [K]; it is marked as not valid.
_UNSEEN = 306.15


class TouchFilm(Device):
    """A sample under a flux film, on a force sensor, with which real touches are measured."""

    Params = FilmParams
    Twin: ClassVar[type[FilmTwin]] = FilmTwin
    timing = Timing(blocking=True, exchange_time=2e-3)
    opening = Opening(second_opener=True)
    reads = (
        heat_flux(full_scale=20e3),
        temperature("film_temperature", Role.OTHER_TEMPERATURE, low=223.15, high=373.15),
        measured_wrench(force=100.0, locked=(0, 1, 3, 4, 5)),
        skin_temperature(),
        Channel(
            "skin_valid", 1, "1", (0.0,), (1.0,), role=Role.SKIN_VALID, doc="1 while the infrared sensor sees the skin"
        ),
    )

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._driver: LabJackDriver | None = None
        self._skin = _UNSEEN

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels, with the film's full scale; the film's temperature only if it has a thermometer."""
        others = cls.reads[1:] if params.has_thermometer else cls.reads[2:]
        return (heat_flux(full_scale=params.full_scale), *others), ()

    @classmethod
    def motion_duration(cls, bound: Any) -> float:
        """Return the duration of the twin's touches [s]."""
        return float(bound.duration)

    def open(self) -> None:
        """Connect to the instrument.

        Raises
        ------
        DeviceError
            If no instrument or sensor is named, or it does not answer.
        """
        given = self.params.labjack
        if given is None or given.flux_sensor is None or given.force_sensor is None:
            raise DeviceError(
                "no instrument reads the film: write <touch-film:labjack> with <touch-film:flux-sensor> and "
                "<touch-film:force-sensor> inside <touch-film:hardware>"
            )
        self._driver = driver = LabJackDriver(given, self.trace, patience=self.timeout_factor)
        try:
            for sensor in (given.force_sensor, given.thermometer):
                if sensor is not None:
                    driver.listen(sensor.channel)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection."""
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    def read(self, reading: Record) -> bool | None:
        """Read all sensors.

        Raises
        ------
        DeviceError
            If the instrument fails.
        """
        if self._driver is None:
            raise DeviceError("the film is not open")
        given, driver = self.params.labjack, self._driver
        # Without a thermometer, the film's sensitivity at its calibration temperature is used.
        film = given.flux_sensor.reference
        if given.thermometer is not None:
            film = given.thermometer.zero + given.thermometer.slope * driver.volts(given.thermometer.channel)
            self._stamp("film_temperature")
        found = driver.exchange(film)
        if self.timestamps is not None:
            driver.stamp(self.timestamps)
        force = driver.volts(given.force_sensor.channel) - given.force_sensor.zero
        self._stamp("wrench")
        seen = math.isfinite(found.skin)
        if seen:
            self._skin = found.skin
        reading["heat_flux"] = found.flux
        if given.thermometer is not None:
            reading["film_temperature"] = film
        reading["wrench"][:] = 0.0
        reading["wrench"][2] = -given.force_sensor.slope * force
        reading["skin_temperature"], reading["skin_valid"] = self._skin, float(seen)
        return True

    def _stamp(self, channel: str) -> None:
        """Stamp a channel with the time of the newest sample."""
        if self.timestamps is not None and self._driver is not None:
            self.timestamps.measured(channel, ago=time.monotonic() - self._driver.sampled)
