"""The contents of ``<touch-film:hardware>``: the sensors' calibrations, and the twin's sample and finger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from contact_heat.layers import Layer, check_layers
from contact_heat.resistance import DEFAULT_RESISTANCE
from itouch.plugin import schema
from itouch_thermal.drivers.driver_params import FluxSensor, Infrared
from itouch_thermal.laws import KINDS, ForceLaw, check_laws

#: The twin's default sample: the paper's wood.
WOOD = Layer(name="wood", thickness=0.02, conductivity=0.11, density=415.0, specific_heat=2720.0)


@dataclass(frozen=True, slots=True)
class ForceSensor:
    """A force sensor with a voltage output under the sample."""

    TAG: ClassVar[str] = "force-sensor"

    channel: int = schema.integer(low=0, high=13, default=3, doc="analog input, single-ended")
    slope: float = schema.quantity("N/V", low=1e-3, high=1e4, default=2.0, doc="newtons per volt")
    zero: float = schema.quantity("V", low=-10.0, high=10.0, default=0.0, doc="voltage without force")


@dataclass(frozen=True, slots=True)
class Thermometer:
    """A thermometer in the film with a voltage output."""

    TAG: ClassVar[str] = "thermometer"

    channel: int = schema.integer(low=0, high=13, default=4, doc="analog input, single-ended")
    slope: float = schema.quantity("K/V", low=0.1, high=1e5, default=20.0, doc="kelvin per volt")
    zero: float = schema.temperature(low=150.0, high=350.0, default=273.15, doc="temperature at 0 V")


@dataclass(frozen=True, slots=True)
class T7:
    """A LabJack T7 over Modbus-TCP, with the sensors at its inputs."""

    TAG: ClassVar[str] = "labjack"

    host: str = schema.text(doc="address of the T7, HOST or HOST:PORT")
    resolution: int = schema.integer(low=0, high=12, default=0, doc="resolution index of the inputs; 0: the T7 chooses")
    flux_sensor: FluxSensor | None = schema.child(FluxSensor, default=None, doc="the film")
    thermometer: Thermometer | None = schema.child(Thermometer, default=None, doc="the thermometer in the film")
    force_sensor: ForceSensor | None = schema.child(ForceSensor, default=None, doc="the sensor under the sample")
    infrared: Infrared | None = schema.child(Infrared, default=None, doc="the thermometer that looks at the finger")

    @property
    def averaging(self) -> float:
        """How long the film's input is averaged [s]: 0, since a touch is recorded sample by sample."""
        return 0.0


@dataclass(frozen=True, slots=True)
class FilmParams:
    """A sample under a flux film, on a force sensor; its twin has a finger that touches it by itself."""

    film_capacity: float = schema.quantity(
        "J/(m^2*K)", low=0.0, high=1e4, default=129.0, doc="heat capacity of the film over its area"
    )
    film_resistance: float = schema.quantity(
        "m^2*K/W", low=1e-7, high=1e-2, default=1.5e-5, doc="thermal resistance of the film, from face to face"
    )
    full_scale: float = schema.quantity("W/m^2", low=100.0, high=1e6, default=20e3, doc="full scale of the flux film")
    flux_lag: float = schema.quantity("s", low=0.0, high=2.0, default=0.05, doc="time constant of the flux film")
    film_lag: float = schema.quantity("s", low=0.0, high=2.0, default=5e-3, doc="time constant of its thermometer")
    flux_noise: float = schema.quantity("W/m^2", low=0.0, high=5e3, default=20.0, doc="of the twin: rms of one sample")
    flux_bias: float = schema.quantity(
        "W/m^2", low=-1e3, high=1e3, default=15.0, doc="of the twin: offset of the flux film at rest"
    )
    flux_drift: float = schema.quantity(
        "W/(m^2*s)", low=-10.0, high=10.0, default=0.05, doc="of the twin: drift of the flux film"
    )
    film_noise: float = schema.quantity("K", low=0.0, high=1.0, default=0.01, doc="of the twin: rms of one sample")
    skin_noise: float = schema.quantity("K", low=0.0, high=1.0, default=0.05, doc="of the twin: rms of one sample")
    force_noise: float = schema.quantity("N", low=0.0, high=1.0, default=0.01, doc="of the twin: rms of one sample")
    force: float = schema.quantity("N", low=0.05, high=20.0, default=1.0, doc="of the twin: force of a touch")
    force_spread: float = schema.quantity(
        "", low=0.0, high=1.0, default=0.03, doc="of the twin: relative spread of the force from touch to touch"
    )
    hold: float = schema.quantity("s", low=0.1, high=600.0, default=10.0, doc="of the twin: length of a touch")
    pause: float = schema.quantity("s", low=0.5, high=3600.0, default=3.0, doc="of the twin: time between two touches")
    recovers: bool = schema.flag(
        default=True,
        doc="of the twin: finger and sample have recovered before each touch, without the minutes that this takes",
    )
    touches: int = schema.integer(low=1, high=10000, default=8, doc="of the twin: how often it touches")
    press: float = schema.quantity(
        "s", low=0.0, high=10.0, default=0.05, doc="of the twin: time constant with which its skin flattens"
    )
    contact_resistance: float = schema.quantity(
        "m^2*K/W",
        low=1e-5,
        high=1.0,
        default=DEFAULT_RESISTANCE,
        doc="of the twin: contact resistance between skin and film",
    )
    recovery: float = schema.quantity(
        "W/(m^2*K)",
        low=1.0,
        high=1e4,
        default=200.0,
        doc="of the twin: heat transfer from the film to air that is blown at it between touches",
    )
    skin_temperature: float = schema.temperature(
        low=273.15, high=318.15, default=306.15, doc="of the twin: skin temperature of the finger before a touch"
    )
    core: float = schema.temperature(
        low=283.15, high=315.15, default=310.15, doc="of the twin: temperature of the finger's core and its blood"
    )
    laws: tuple[ForceLaw, ...] = schema.children(KINDS, doc="of the twin: resistance as a function of the force")
    tissue: tuple[Layer, ...] = schema.children(Layer, tag="tissue", doc="of the twin's finger, from the skin inwards")
    sample: tuple[Layer, ...] = schema.children(
        Layer, tag="sample", doc="of the twin, from the film down; default: wood"
    )
    labjack: T7 | None = schema.child(T7, default=None, doc="the instrument that reads the sensors")

    def __post_init__(self) -> None:
        schema.validate(self)
        check_laws(self.laws, self.contact_resistance)
        check_layers(self.tissue, "tissue")
        check_layers(self.sample, "sample", finger=False)

    @property
    def calibration(self) -> str:
        """The instrument's calibration sheets in words; empty without an instrument."""
        given = self.labjack
        if given is None:
            return ""
        sheets = []
        if given.flux_sensor is not None:
            flux = given.flux_sensor
            sheets.append(
                f"flux film {flux.sign * flux.sensitivity:g} V m2/W at {flux.reference - 273.15:g} degC, "
                f"{flux.correction:g} of it a kelvin, {flux.offset:g} V without flux"
            )
        if given.thermometer is not None:
            film = given.thermometer
            sheets.append(f"thermometer {film.slope:g} K/V, {film.zero - 273.15:g} degC at 0 V")
        if given.force_sensor is not None:
            sheets.append(f"force {given.force_sensor.slope:g} N/V, {given.force_sensor.zero:g} V without force")
        if given.infrared is not None:
            sheets.append(f"infrared {given.infrared.slope:g} K/V, {given.infrared.zero - 273.15:g} degC at 0 V")
        return "; ".join(sheets)

    @property
    def has_thermometer(self) -> bool:
        """Whether the film has a thermometer: the instrument names one, or there is only the twin, which has one."""
        return self.labjack is None or self.labjack.thermometer is not None

    @property
    def film(self) -> Layer:
        """The film as a layer of nominal thickness with this heat capacity and resistance."""
        thick = 37.5e-6
        return Layer(
            name="flux sensor", thickness=thick, conductivity=thick / self.film_resistance, density=1000.0,
            specific_heat=max(1.0, self.film_capacity / thick / 1000.0),
        )  # fmt: skip

    @property
    def duration(self) -> float:
        """Duration of the twin's motion [s]."""
        return self.touches * (self.hold + self.pause)
