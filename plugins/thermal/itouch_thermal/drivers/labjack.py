"""A LabJack T7 over Modbus-TCP: voltages of its inputs, by the registers of its published map.

An input that the T7 averages (its extended feature 3, by a burst of its own sampling clock) is asked for at the
beginning of an exchange and fetched at the end, so that a controller's exchange goes on meanwhile.
"""

from __future__ import annotations

import math
import struct
import time
from typing import NamedTuple, Protocol

from itouch.plugin import DeviceError, Stamps, Trace
from itouch_thermal.drivers.driver_params import SAMPLING, FluxSensor, Infrared
from itouch_thermal.drivers.modbus import PORT, ModbusLine, ModbusRefusal

__all__ = ["PORT", "LabJackDriver", "Sensors", "Wired"]

#: Registers: the number of the product; range, negative input and resolution of the first analogue input.
PRODUCT = 60000
RANGE, NEGATIVE, RESOLUTION = 40000, 41000, 41500
#: Of an extended feature, two registers a channel: which, its result, number of samples, samples a second; 0 is none,
#: 3 the average.  Resolution index of all that is sampled by the burst.
EF_INDEX, EF_RESULT, EF_SAMPLES, EF_RATE, AVERAGE = 9000, 7000, 9300, 10200, 3
STREAM_RESOLUTION = 4010
SINGLE_ENDED = 199
#: Span of the flux sensor's input [V].
SPAN = 0.01
#: A voltage beyond its span reads as this; a mean with one such sample is beyond its span, too.
_OVERLOAD, _BEYOND = -9999.0, 2.0 * SPAN
#: After so many exchanges, and where the line was lost, it is asked whether it still measures as it was told to.  A T7
#: that does not average by itself must give one sample in this many: the noise is then at most twice what is written.
_LOOK, _FEW = 50, 4.0


class Wired(Protocol):
    """What is said of a T7: where it is, and the film and the thermometer at its inputs."""

    @property
    def host(self) -> str:
        """Address."""

    @property
    def resolution(self) -> int:
        """Resolution index of its inputs."""

    @property
    def averaging(self) -> float:
        """How long the film's input is averaged [s]; 0: not at all."""

    @property
    def flux_sensor(self) -> FluxSensor | None:
        """The film."""

    @property
    def infrared(self) -> Infrared | None:
        """The thermometer that looks at the finger."""


class Sensors(NamedTuple):
    """What the sensors at the T7 say: flux [W/m2], skin temperature [K]; NaN where there is none."""

    flux: float
    skin: float


class _Age(NamedTuple):
    """How long ago [s] the middle of a measurement was, and the part of it that the T7 has it for by itself."""

    ago: float = 0.0
    inside: float = 0.0


class LabJackDriver:
    """An open T7.

    Raises
    ------
    DeviceError
        If it does not answer or is another product.
    """

    def __init__(self, params: Wired, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        self._params, self._patience = params, patience
        self._samples = round(params.averaging * SAMPLING) if params.flux_sensor is not None else 0
        #: Whether it averages by itself; how long its answers are on their way [s]; when and what was asked for.
        self._averages, self._way, self._asked, self._count = False, 0.0, -1.0, 0
        self._skin_volts, self._flux_age, self._skin_age, self._looked = math.nan, _Age(), _Age(), 0.0
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
        """Let the T7 average an input; one that cannot is asked for single samples, as fast as it answers."""
        line, at = self._line, 2 * channel
        try:
            line.write(EF_INDEX + at, struct.pack(">I", 0))
            line.write(EF_INDEX + at, struct.pack(">I", AVERAGE))
            line.write(EF_SAMPLES + at, struct.pack(">I", self._samples))
            line.write(EF_RATE + at, struct.pack(">f", SAMPLING))
            line.write(STREAM_RESOLUTION, struct.pack(">I", self._params.resolution))
            begin = time.monotonic()
            self._averages = line.whole(EF_INDEX + at) == AVERAGE
            self._way = 0.5 * (time.monotonic() - begin)
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
        """Begin to measure what takes its time; the next `exchange` ends it.

        Raises
        ------
        DeviceError
            If the T7 does not answer, or has started anew.
        """
        flux, infrared = self._params.flux_sensor, self._params.infrared
        if flux is None or not self._averages:
            return
        at = 2 * flux.channel
        if self._count % _LOOK == 0 and self._line.whole(EF_INDEX + at) != AVERAGE:
            raise DeviceError(
                f"the LabJack at {self._params.host} has started anew: it no longer averages its input AIN"
                f"{flux.channel}; check its supply, then connect it again"
            )
        self._count += 1
        if infrared is not None:
            begin = time.monotonic()
            self._skin_volts = self._line.floats(2 * infrared.channel)[0]
            self._looked = 0.5 * (begin + time.monotonic())
        self._line.ask(EF_RESULT + at)
        self._asked = time.monotonic()

    def exchange(self, plate: float) -> Sensors:
        """Measure; the flux sensor is at the plate's temperature [K].

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

    def stamp(self, stamps: Stamps) -> None:
        """Say when the readings of the last exchange were measured: a mean in the middle of its samples."""
        stamps.measured("heat_flux", ago=self._flux_age.ago, inside=self._flux_age.inside)
        stamps.measured("skin_temperature", "skin_valid", ago=self._skin_age.ago)

    def _singles(self) -> tuple[float, float]:
        """Return single samples of the film's input and of the thermometer's [V], in one request."""
        flux, infrared = self._params.flux_sensor, self._params.infrared
        channels = [sensor.channel for sensor in (flux, infrared) if sensor is not None]
        if not channels:
            return math.nan, math.nan
        first, last = min(channels), max(channels)
        begin = time.monotonic()
        volts = self._line.floats(2 * first, last - first + 1)
        middle = 0.5 * (begin + time.monotonic())
        self._watch()
        self._flux_age = self._skin_age = _Age(time.monotonic() - middle)
        return (
            math.nan if flux is None else volts[flux.channel - first],
            math.nan if infrared is None else volts[infrared.channel - first],
        )

    def _watch(self) -> None:
        """See that the film's input has the range that it was given: a T7 that has started anew measures otherwise.

        Raises
        ------
        DeviceError
            If it has not: against ground, and in steps of the wrong range, a film's voltage says nothing.
        """
        flux, self._count = self._params.flux_sensor, self._count + 1
        if flux is None or (self._count % _LOOK and self._lines == self._line.connections):
            return
        self._lines = self._line.connections
        if abs(self._line.floats(RANGE + 2 * flux.channel)[0] - SPAN) > 0.1 * SPAN:
            raise DeviceError(
                f"the LabJack at {self._params.host} has started anew, or another program has set it: its input AIN"
                f"{flux.channel} has another range; check its supply, then connect it again"
            )

    def _mean(self, flux: FluxSensor) -> tuple[float, float]:
        """Return the mean that the T7 has taken since `begin` [V], and what the thermometer said before."""
        if self._asked < 0.0:
            self.begin()
        voltage, first = self._line.answer()
        now, window = time.monotonic(), self._params.averaging
        # It has sampled since the request came to it; a second request ended just now.
        since = now - self._asked - self._way if first else window + self._way
        self._flux_age = _Age(max(0.0, since - window), 0.5 * (self._samples - 1) / SAMPLING)
        self._skin_age, self._asked = _Age(now - self._looked), -1.0
        return voltage, self._skin_volts

    def _mean_of_singles(self, flux: FluxSensor) -> tuple[float, float]:
        """Return the mean of single samples over the same time [V], as many as the T7 answers in it."""
        line, infrared = self._line, self._params.infrared
        skin = line.floats(2 * infrared.channel)[0] if infrared is not None else math.nan
        self._looked = begin = time.monotonic()
        total, count = 0.0, 0
        while count < self._samples and (count == 0 or time.monotonic() - begin < self._params.averaging):
            time.sleep(max(0.0, begin + count / SAMPLING - time.monotonic()))
            total += line.floats(2 * flux.channel)[0]
            count += 1
        now = time.monotonic()
        self._flux_age, self._skin_age = _Age(0.5 * (now - begin)), _Age(now - self._looked)
        return total / count, skin

    def listen(self, channel: int) -> None:
        """Make an input ready for a voltage up to 10 V against ground."""
        self._configure(channel, 10.0, SINGLE_ENDED)

    def volts(self, channel: int) -> float:
        """Return the voltage of one input [V].

        Raises
        ------
        DeviceError
            If the T7 does not answer, or the input is overloaded.
        """
        found = self._line.floats(2 * channel)[0]
        if found <= _OVERLOAD or not math.isfinite(found):
            raise DeviceError(f"the input AIN{channel} is overloaded or open")
        return found

    def close(self) -> None:
        """Hang up."""
        self._line.close()
