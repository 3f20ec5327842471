"""The elements of real hardware inside ``<thermal:hardware>``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.plugin import schema
from itouch_thermal.drivers.modbus import PORT

#: Plausible temperatures [degC] of a plate or a sink: beyond them, its sensor is open or short.
BELIEVED = (-20.0, 90.0)
#: Allowed baud rates of a rig that speaks the line protocol.
LINE_BAUD = (9600, 2_000_000)
#: Lowest baud rate of a serial port.
SLOWEST = 9600
#: Sampling rate of an averaged input [1/s].
SAMPLING = 1000.0
#: Greatest resolution index of an averaged input: the converter of higher ones cannot sample bursts.
_FINEST_BURST = 8


@dataclass(frozen=True, slots=True)
class Mecom:
    """A Meerstetter TEC controller, which drives the module and reads plate and sink."""

    TAG: ClassVar[str] = "mecom"

    port: str = schema.text(doc="serial port, or socket://HOST:PORT")
    baud: int = schema.integer(low=SLOWEST, high=1_000_000, default=57600, doc="speed of the serial port")
    session_baud: int = schema.integer(
        low=0, high=1_000_000, default=0, doc="speed of the port for the session, if the controller can; 0: as it is"
    )
    address: int = schema.integer(low=0, high=254, default=2, doc="address of the controller on its line; 0: any")
    instance: int = schema.integer(low=1, high=4, default=1, doc="channel of the controller")
    watchdog: bool = schema.flag(
        default=True,
        doc="whether it must end the current by itself when the host is silent; no: an old one that cannot, with "
        "guardian and hold-to-run only",
    )

    def __post_init__(self) -> None:
        schema.validate(self)
        if 0 < self.session_baud < SLOWEST:
            raise ValueError(f"session_baud = {self.session_baud} must be at least {SLOWEST}, or 0: the speed as it is")

    @property
    def raises(self) -> bool:
        """Whether the line's speed is raised for the session: behind a socket the port is not ours to change."""
        return bool(self.session_baud) and "://" not in self.port


@dataclass(frozen=True, slots=True)
class FluxSensor:
    """A heat-flux sensor's calibration sheet: its voltage to W/m2."""

    TAG: ClassVar[str] = "flux-sensor"

    channel: int = schema.integer(low=0, high=12, default=0, doc="analog input; its negative side is the next one")
    sensitivity: float = schema.quantity(
        "V*m^2/W",
        low=1e-9,
        high=1.0,
        doc="voltage at 1 W/m2 out of the finger, at the reference temperature",
    )
    reference: float = schema.temperature(low=250.0, high=350.0, default=296.15, doc="temperature of the calibration")
    correction: float = schema.quantity(
        "1/K", low=-0.05, high=0.05, default=0.0, doc="relative change of the sensitivity per kelvin"
    )
    offset: float = schema.quantity("V", low=-1.0, high=1.0, default=0.0, doc="voltage without flux")
    sign: float = schema.quantity("", low=-1, high=1, default=1.0, doc="-1 for a sensor that is mounted upside down")

    def __post_init__(self) -> None:
        schema.validate(self)
        if abs(self.sign) != 1.0:
            raise ValueError(f"sign = {self.sign!r} must be 1 or -1")

    def flux(self, voltage: float, temperature: float) -> float:
        """Return the flux out of the finger [W/m2] for a voltage [V] and a temperature of the sensor [K]."""
        return self.sign * (voltage - self.offset) / self._slope(temperature)

    def voltage(self, flux: float, temperature: float) -> float:
        """Return the voltage [V] for a flux [W/m2] and a temperature of the sensor [K]."""
        return self.sign * flux * self._slope(temperature) + self.offset

    def _slope(self, temperature: float) -> float:
        return self.sensitivity * (1.0 + self.correction * (temperature - self.reference))


@dataclass(frozen=True, slots=True)
class Infrared:
    """An infrared thermometer with a voltage output that looks at the finger; beyond `range` it sees none."""

    TAG: ClassVar[str] = "infrared"

    channel: int = schema.integer(low=0, high=13, default=2, doc="analog input, single-ended")
    slope: float = schema.quantity("K/V", low=0.1, high=1e4, default=20.0, doc="kelvin per volt")
    zero: float = schema.temperature(low=150.0, high=350.0, default=273.15, doc="temperature at 0 V")
    range: tuple[float, float] = schema.temperature(
        size=2, low=250.0, high=350.0, default=(288.15, 318.15), doc="readings that count as a finger"
    )


@dataclass(frozen=True, slots=True)
class LabJack:
    """A LabJack T7 over Modbus-TCP, with the sensors at its inputs."""

    TAG: ClassVar[str] = "labjack"

    host: str = schema.text(doc="address of the T7, HOST or HOST:PORT")
    resolution: int = schema.integer(low=0, high=12, default=0, doc="resolution index of the inputs; 0: the T7 chooses")
    averaging: float = schema.quantity(
        "s",
        low=0.0,
        high=0.18,
        default=0.0,
        doc="for how long the T7 averages the flux sensor's input, one sample per millisecond; 0: single samples",
    )
    flux_sensor: FluxSensor | None = schema.child(FluxSensor, default=None, doc="the sensor under the finger")
    infrared: Infrared | None = schema.child(Infrared, default=None, doc="the thermometer that looks at the finger")

    def __post_init__(self) -> None:
        schema.validate(self)
        try:
            schema.host_port(self.host, port=PORT)
        except ValueError as error:
            raise ValueError(f"host = {error}") from error
        if self.averaging and self.resolution > _FINEST_BURST:
            raise ValueError(f"resolution = {self.resolution} must be at most {_FINEST_BURST} with averaging")
        if self.averaging and round(self.averaging * SAMPLING) < 2:
            given = f"averaging = {1e3 * self.averaging:g} ms"
            raise ValueError(f"{given} is a single sample, one a millisecond: write 2 ms or more, or 0")

    @property
    def samples(self) -> int:
        """Number of samples of the flux sensor's input in one reading."""
        return max(1, round(self.averaging * SAMPLING)) if self.flux_sensor is not None else 1


@dataclass(frozen=True, slots=True)
class LinePort:
    """A rig of your own that speaks the line protocol; the reference documents it, with a program for an Arduino."""

    TAG: ClassVar[str] = "line"

    port: str = schema.text(doc="serial port, or socket://HOST:PORT")
    baud: int = schema.integer(low=LINE_BAUD[0], high=LINE_BAUD[1], default=115200, doc="speed of the serial port")
    age: float = schema.quantity(
        "s",
        low=0.0,
        high=0.2,
        default=0.0,
        doc="how old its readings are when it sends them; a mean is half as old as its time is long",
    )
    firmware: str = schema.choice(
        "own",
        "reference",
        default="own",
        doc="its program: your own, or the reference firmware, which a virtual rig runs in a simulated chip",
    )
