"""A LabJack T7 over Modbus-TCP: voltages at its inputs, through the registers of its published map.

An input that the T7 averages (its extended feature 3, with a burst at its own sampling clock) is requested at the start
of an exchange and fetched at its end, so that the controller's exchange takes place meanwhile.
"""

from __future__ import annotations

import math
import struct
import time
from collections import defaultdict
from typing import NamedTuple, Protocol

from itouch.plugin import DeviceError, Timestamps, Trace
from itouch_thermal.drivers.answer_times import AnswerTimes
from itouch_thermal.drivers.driver_params import SAMPLING, FluxSensor, Infrared
from itouch_thermal.drivers.modbus import PORT, ModbusLine, ModbusRefusal

__all__ = ["PORT", "LabJackDriver", "Sensors", "Wired"]

#: Registers: the product number; range, negative input and resolution of the first analogue input.
PRODUCT = 60000
RANGE, NEGATIVE, RESOLUTION = 40000, 41000, 41500
#: Extended features, two registers per channel: index (0: none, 3: average), result, number of samples, samples per
#: second.  And the resolution index of all burst sampling.
EF_INDEX, EF_RESULT, EF_SAMPLES, EF_RATE, AVERAGE = 9000, 7000, 9300, 10200, 3
STREAM_RESOLUTION = 4010
SINGLE_ENDED = 199
#: Span of the flux sensor's input [V].
SPAN = 0.01
#: The T7's reading for a voltage beyond its span; a mean that includes such a sample is beyond its span, too.
_OVERLOAD, _BEYOND = -9999.0, 2.0 * SPAN
#: After this many exchanges, or a lost connection, the T7's settings are checked.  A T7 that cannot average must
#: deliver at least one sample in this many sampling periods: the noise is then at most twice the stated one.
_LOOK, _FEW = 50, 4.0


class Wired(Protocol):
    """The parameters of a T7: its address, and the film and the thermometer at its inputs."""

    @property
    def host(self) -> str:
        """Address."""

    @property
    def resolution(self) -> int:
        """Resolution index of its inputs."""

    @property
    def averaging(self) -> float:
        """How long the film's input is averaged [s]; 0: single samples."""

    @property
    def flux_sensor(self) -> FluxSensor | None:
        """The flux film."""

    @property
    def infrared(self) -> Infrared | None:
        """The thermometer that looks at the finger."""


class Sensors(NamedTuple):
    """The readings of the sensors at the T7: flux [W/m2], skin temperature [K]; NaN if there is no sensor or finger."""

    flux: float
    skin: float


class _Age(NamedTuple):
    """Age [s] of the middle of a measurement, and the part of a delay that lies inside the T7."""

    ago: float = 0.0
    inside: float = 0.0


class LabJackDriver:
    """An open T7.

    Raises
    ------
    DeviceError
        If it does not answer, or is another product.
    """

    def __init__(self, params: Wired, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        self._params, self._patience = params, patience
        self._samples = round(params.averaging * SAMPLING) if params.flux_sensor is not None else 0
        #: Whether it averages by itself, and a mean is requested; number of exchanges.
        self._averages, self._asked, self._count = False, False, 0
        self._skin_volts, self._flux_age, self._skin_age, self._looked = math.nan, _Age(), _Age(), 0.0
        #: When the newest single samples were taken [s], and which answers are prompt, by their number of samples.
        self.sampled, self._times = 0.0, defaultdict[int, AnswerTimes](AnswerTimes)
        self._line = ModbusLine("LabJack", params.host, trace, patience=patience)
        self._lines = 1
        try:
            self._start()
        except BaseException:
            self._line.close()
            raise

    def _start(self) -> None:
        product = self._line.floats(PRODUCT)[0]
        if product != 7.0:
            raise DeviceError(f"at {self._params.host} is product {product:g}, not a LabJack T7")
        flux, infrared = self._params.flux_sensor, self._params.infrared
        if flux is not None:
            self._configure(flux.channel, SPAN, flux.channel + 1)
        if infrared is not None:
            self._configure(infrared.channel, 10.0, SINGLE_ENDED)
        if flux is not None and self._samples > 1:
            self._average(flux.channel)

    def _configure(self, channel: int, span: float, negative: int) -> None:
        self._line.write(RANGE + 2 * channel, struct.pack(">f", span))
        self._line.write(NEGATIVE + channel, struct.pack(">H", negative))
        self._line.write(RESOLUTION + channel, struct.pack(">H", self._params.resolution))

    def _average(self, channel: int) -> None:
        """Let the T7 average an input; if it cannot, check that it answers single samples fast enough."""
        line, at = self._line, 2 * channel
        try:
            line.write(EF_INDEX + at, struct.pack(">I", 0))
            line.write(EF_INDEX + at, struct.pack(">I", AVERAGE))
            line.write(EF_SAMPLES + at, struct.pack(">I", self._samples))
            line.write(EF_RATE + at, struct.pack(">f", SAMPLING))
            line.write(STREAM_RESOLUTION, struct.pack(">I", self._params.resolution))
            self._averages = line.whole(EF_INDEX + at) == AVERAGE
        except ModbusRefusal:
            self._averages = False
        if self._averages:
            return
        begin = time.monotonic()
        line.floats(at)
        single = time.monotonic() - begin
        if single > _FEW * self._patience / SAMPLING:
            raise DeviceError(
                f"the LabJack at {self._params.host} cannot average AIN{channel} by itself, and a sample takes "
                f"{1e3 * single:.1f} ms: give it newer firmware, or remove averaging"
            )

    def begin(self) -> None:
        """Start the measurements that take time; the next `exchange` completes them.

        Raises
        ------
        DeviceError
            If the T7 does not answer, or has restarted.
        """
        flux, infrared = self._params.flux_sensor, self._params.infrared
        if flux is None or not self._averages:
            return
        at = 2 * flux.channel
        if self._count % _LOOK == 0 and self._line.whole(EF_INDEX + at) != AVERAGE:
            raise DeviceError(
                f"the LabJack at {self._params.host} has restarted: it no longer averages its input AIN"
                f"{flux.channel}; check its supply, then connect it again"
            )
        self._count += 1
        if infrared is not None:
            self._skin_volts = self._samples_of(infrared.channel)[0]
            self._looked = self.sampled
        self._line.ask(EF_RESULT + at)
        self._asked = True

    def exchange(self, plate: float) -> Sensors:
        """Measure; ``plate`` is the flux sensor's temperature [K].

        Raises
        ------
        DeviceError
            If the T7 does not answer, or an input is overloaded.
        """
        flux, infrared = self._params.flux_sensor, self._params.infrared
        if flux is not None and self._averages:
            voltage, skin = self._mean(flux)
        elif flux is not None and self._samples > 1:
            voltage, skin = self._mean_of_singles(flux)
        else:
            voltage, skin = self._singles()
        found = math.nan
        if flux is not None:
            if voltage <= _OVERLOAD or not math.isfinite(voltage) or (self._samples > 1 and abs(voltage) > _BEYOND):
                raise DeviceError(f"the flux sensor's input AIN{flux.channel} is overloaded or open")
            found = flux.flux(voltage, plate)
        seen = math.nan
        if infrared is not None:
            seen = infrared.zero + infrared.slope * skin
            seen = seen if infrared.range[0] <= seen <= infrared.range[1] else math.nan
        return Sensors(found, seen)

    def stamp(self, stamps: Timestamps, *, skin: bool = True) -> None:
        """Stamp the readings of the last exchange with their times: for a mean, the middle of its samples.

        ``skin``: whether the skin's reading is one of this instrument.
        """
        if self._params.flux_sensor is not None:
            stamps.measured("heat_flux", ago=self._flux_age.ago, inside=self._flux_age.inside)
        if self._params.infrared is not None and skin:
            stamps.measured("skin_temperature", "skin_valid", ago=self._skin_age.ago)

    def _samples_of(self, first: int, count: int = 1) -> list[float]:
        """Return single samples of an input and the following ones [V]; a late answer counts from its request."""
        line = self._line
        found = line.floats(2 * first, count)
        prompt = self._times[count].prompt(line.arrived - line.sent)
        self.sampled = 0.5 * (line.sent + line.arrived) if prompt else line.sent
        return found

    def _singles(self) -> tuple[float, float]:
        """Return single samples of the film's and the thermometer's inputs [V], read in one request."""
        flux, infrared = self._params.flux_sensor, self._params.infrared
        channels = [sensor.channel for sensor in (flux, infrared) if sensor is not None]
        if not channels:
            return math.nan, math.nan
        first, last = min(channels), max(channels)
        volts = self._samples_of(first, last - first + 1)
        self._watch()
        self._flux_age = self._skin_age = _Age(time.monotonic() - self.sampled)
        return (
            math.nan if flux is None else volts[flux.channel - first],
            math.nan if infrared is None else volts[infrared.channel - first],
        )

    def _watch(self) -> None:
        """Check that the film's input still has its range: a T7 that has restarted measures differently.

        Raises
        ------
        DeviceError
            If it has not: measured against ground, or in steps of the wrong range, the film's voltage is meaningless.
        """
        flux, self._count = self._params.flux_sensor, self._count + 1
        if flux is None or (self._count % _LOOK and self._lines == self._line.connections):
            return
        self._lines = self._line.connections
        if abs(self._line.floats(RANGE + 2 * flux.channel)[0] - SPAN) > 0.1 * SPAN:
            raise DeviceError(
                f"the LabJack at {self._params.host} has restarted, or another program has set it: its input AIN"
                f"{flux.channel} has another range; check its supply, then connect it again"
            )

    def _mean(self, flux: FluxSensor) -> tuple[float, float]:
        """Return the mean that the T7 has taken since `begin` [V], and the thermometer's voltage read before it [V]."""
        if not self._asked:
            self.begin()
        voltage, _ = self._line.answer()
        now, window = time.monotonic(), self._params.averaging
        # The T7 has sampled since the request reached it; how long its answer was on its way does not matter.
        since = now - self._line.sent - 0.5 * self._line.quickest
        self._flux_age = _Age(max(0.0, since - window), 0.5 * (self._samples - 1) / SAMPLING)
        self._skin_age, self._asked = _Age(now - self._looked), False
        return voltage, self._skin_volts

    def _mean_of_singles(self, flux: FluxSensor) -> tuple[float, float]:
        """Return the mean of as many single samples as the T7 delivers in that time [V], and the thermometer's [V]."""
        infrared = self._params.infrared
        skin = self._samples_of(infrared.channel)[0] if infrared is not None else math.nan
        self._looked, begin = self.sampled, time.monotonic()
        total, when, count = 0.0, 0.0, 0
        while count < self._samples and (count == 0 or time.monotonic() - begin < self._params.averaging):
            time.sleep(max(0.0, begin + count / SAMPLING - time.monotonic()))
            total += self._samples_of(flux.channel)[0]
            when += self.sampled
            count += 1
        now = time.monotonic()
        self._flux_age, self._skin_age = _Age(now - when / count), _Age(now - self._looked)
        return total / count, skin

    def listen(self, channel: int) -> None:
        """Configure an input for voltages up to 10 V against ground."""
        self._configure(channel, 10.0, SINGLE_ENDED)

    def volts(self, channel: int) -> float:
        """Return the voltage at an input [V]; `sampled` is its time.

        Raises
        ------
        DeviceError
            If the T7 does not answer, or the input is overloaded.
        """
        found = self._samples_of(channel)[0]
        if found <= _OVERLOAD or not math.isfinite(found):
            raise DeviceError(f"the input AIN{channel} is overloaded or open")
        return found

    def close(self) -> None:
        """Close the connection."""
        self._line.close()
