"""A LabJack T7 over Modbus-TCP: voltages of its inputs, by the registers of its published map."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from itouch.plugin import DeviceError, Trace
from itouch_thermal.drivers.driver_params import FluxSensor, Infrared

PRODUCT, PORT = 60000, 502
RANGE, NEGATIVE, RESOLUTION = 40000, 41000, 41500
SINGLE_ENDED = 199
#: Span of the flux sensor's input [V]; how long [s] an answer may take.
SPAN, PATIENCE = 0.01, 0.2
#: A voltage beyond its span reads as this.
_OVERLOAD = -9999.0
#: Modbus exceptions that pass (5 acknowledge, 6 busy), and how often a request is made then.
_BUSY, _TRIES = (5, 6), 3


class Wired(Protocol):
    """What is said of a T7: where it is, and the film and the thermometer at its inputs."""

    @property
    def host(self) -> str:
        """Address."""

    @property
    def resolution(self) -> int:
        """Resolution index of its inputs."""

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


class LabJackDriver:
    """An open T7.

    Raises
    ------
    DeviceError
        If it does not answer or is another product.
    """

    def __init__(self, params: Wired, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        try:
            from pymodbus.client import ModbusTcpClient
            from pymodbus.exceptions import ModbusException
        except ImportError as error:
            raise DeviceError("a LabJack needs a package more: pip install 'itouch-py[thermal-hardware]'") from error
        host, _, port = params.host.partition(":")
        if port and not port.isdigit():
            raise DeviceError(f"host = '{params.host}' must be HOST or HOST:PORT")
        self._params, self._trace, self._failure = params, trace, ModbusException
        #: Half of the time [s] that the last exchange took: so long ago it was measured.
        self.half = 0.0
        client: Any = ModbusTcpClient
        self._client: Any = client(host, port=int(port or PORT), timeout=PATIENCE * patience, retries=1)
        if not self._client.connect():
            self._client.close()
            raise DeviceError(f"no LabJack answers at {params.host}: check its address and power")
        try:
            self._start()
        except BaseException:
            self._client.close()
            raise

    def _start(self) -> None:
        product = self._floats(PRODUCT)[0]
        if product != 7.0:
            raise DeviceError(f"at {self._params.host} is product {product:g}, not a LabJack T7")
        flux, infrared = self._params.flux_sensor, self._params.infrared
        if flux is not None:
            self._configure(flux.channel, SPAN, flux.channel + 1)
        if infrared is not None:
            self._configure(infrared.channel, 10.0, SINGLE_ENDED)

    def _configure(self, channel: int, span: float, negative: int) -> None:
        self._write(RANGE + 2 * channel, struct.pack(">f", span))
        self._write(NEGATIVE + channel, struct.pack(">H", negative))
        self._write(RESOLUTION + channel, struct.pack(">H", self._params.resolution))

    def exchange(self, plate: float) -> Sensors:
        """Measure; the flux sensor is at the plate's temperature [K].

        Raises
        ------
        DeviceError
            If the T7 does not answer, or an input is overloaded.
        """
        flux, infrared = self._params.flux_sensor, self._params.infrared
        channels = [sensor.channel for sensor in (flux, infrared) if sensor is not None]
        if not channels:
            return Sensors(math.nan, math.nan)
        first, last = min(channels), max(channels)
        begin = time.monotonic()
        volts = self._floats(2 * first, last - first + 1)
        self.half = 0.5 * (time.monotonic() - begin)
        found = math.nan
        if flux is not None:
            voltage = volts[flux.channel - first]
            if voltage <= _OVERLOAD or not math.isfinite(voltage):
                raise DeviceError(f"the flux sensor's input AIN{flux.channel} is overloaded or open")
            found = flux.flux(voltage, plate)
        skin = math.nan
        if infrared is not None:
            seen = infrared.zero + infrared.slope * volts[infrared.channel - first]
            skin = seen if infrared.range[0] <= seen <= infrared.range[1] else math.nan
        return Sensors(found, skin)

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
        found = self._floats(2 * channel)[0]
        if found <= _OVERLOAD or not math.isfinite(found):
            raise DeviceError(f"the input AIN{channel} is overloaded or open")
        return found

    def close(self) -> None:
        """Hang up."""
        self._client.close()

    def _floats(self, address: int, count: int = 1) -> list[float]:
        answer = self._asked(address, lambda: self._client.read_holding_registers(address, count=2 * count))
        if len(answer.registers) != 2 * count:
            raise DeviceError(
                f"the LabJack at {self._params.host} answers register {address} with too little: {answer}"
            )
        raw = struct.pack(f">{2 * count}H", *answer.registers)
        if self._trace:
            self._trace.sent(b"read %d x %d" % (address, count))
            self._trace.received(raw)
        return list(struct.unpack(f">{count}f", raw))

    def _write(self, address: int, data: bytes) -> None:
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        if self._trace:
            self._trace.sent(b"write %d " % address + data.hex().encode())
        self._asked(address, lambda: self._client.write_registers(address, words))

    def _asked(self, address: int, ask: Callable[[], Any]) -> Any:
        """Return the answer to a request; a T7 that says that it is busy is asked again."""
        for _ in range(_TRIES):
            try:
                answer = ask()
            except (self._failure, OSError) as error:
                raise DeviceError(f"the LabJack at {self._params.host} does not answer: {error}") from error
            if not answer.isError():
                return answer
            if getattr(answer, "exception_code", 0) not in _BUSY:
                break
        raise DeviceError(f"the LabJack at {self._params.host} refuses register {address}: {answer}")
