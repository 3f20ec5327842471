"""The contents of ``<thermal:hardware>``: the display as in its data sheets, and how its twin differs from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from contact_heat.layers import Layer, check_layers
from contact_heat.resistance import AREA_AT_1N, AREA_EXPONENT, DEFAULT_RESISTANCE, SPREAD, contact_area
from itouch.plugin import schema
from itouch_thermal.display.peltier import Module
from itouch_thermal.drivers.driver_params import LabJack, LinePort, Mecom
from itouch_thermal.laws import KINDS, ForceLaw, PressureLaw, check_laws

#: Copper-clad film sensor of the paper: thickness from 15e-6 K m2/W and k = 2.5 W/mK.
FILM = Layer(name="flux sensor", thickness=37.5e-6, conductivity=2.5, density=8933.0, specific_heat=385.0)
#: Area of the film [m2]: a separate sensor, as large as a fingertip's contact under 0.1 N.  One as large as the finger
#: would read too little if the finger's true area is smaller than assumed.
SENSOR_AREA = 5e-5
ALUMINA = Layer(name="alumina", thickness=0.8e-3, conductivity=27.0, density=3800.0, specific_heat=880.0)

#: Temperatures [K] of a module's hot side, for which a data sheet may give its figures.
HOT_SIDE = (200.0, 500.0)
#: Seebeck coefficient [V/K], resistance [ohm] and conductance [W/K] of a 40 mm module with 127 couples.
_MODULE = {"seebeck": 0.051, "resistance": 1.86, "conductance": 0.56}


@dataclass(frozen=True, slots=True)
class Mismatch:
    """How the twin's plant differs from what is written: relative differences (0.1 or 10 %), and an offset in K."""

    TAG: ClassVar[str] = "mismatch"

    contact_resistance: float = schema.quantity("", low=-0.9, high=9.0, default=0.0, doc="contact resistance")
    contact_area: float = schema.quantity("", low=-0.9, high=9.0, default=0.0, doc="contact area of the finger")
    seebeck: float = schema.quantity("", low=-0.5, high=1.0, default=0.0, doc="Seebeck coefficient")
    conductance: float = schema.quantity("", low=-0.9, high=2.0, default=0.0, doc="conductance of the legs")
    resistance: float = schema.quantity("", low=-0.9, high=2.0, default=0.0, doc="electrical resistance")
    plate_effusivity: float = schema.quantity("", low=-0.5, high=1.0, default=0.0, doc="effusivity of film and plate")
    finger_effusivity: float = schema.quantity("", low=-0.5, high=1.0, default=0.0, doc="effusivity of the finger")
    sensor_lag: float = schema.quantity("", low=-0.9, high=4.0, default=0.0, doc="time constants of both sensors")
    flux_gain: float = schema.quantity("", low=-0.5, high=1.0, default=0.0, doc="gain of the flux sensor")
    delay: float = schema.quantity("s", low=-0.2, high=0.2, default=0.0, doc="how much longer a command takes to act")
    slew: float = schema.quantity("", low=-0.9, high=99.0, default=0.0, doc="how fast the driver changes its current")
    plate_offset: float = schema.quantity("K", low=-2.0, high=2.0, default=0.0, doc="offset of the plate's sensor")

    def __post_init__(self) -> None:
        schema.validate(self)


@dataclass(frozen=True, slots=True)
class Datasheet:
    """What a module's data sheet says, in place of Seebeck coefficient, resistance and conductance."""

    TAG: ClassVar[str] = "datasheet"

    voltage: float = schema.quantity("V", low=1e-3, high=1e3, doc="U_max")
    current: float = schema.quantity("A", low=1e-3, high=1e3, doc="I_max")
    difference: float = schema.quantity("K", low=0.1, high=200.0, doc="dT_max, without heat pumped")
    hot: float = schema.temperature(
        low=HOT_SIDE[0], high=HOT_SIDE[1], default=300.15, doc="T_h, the hot side's temperature"
    )

    def __post_init__(self) -> None:
        schema.validate(self)
        self.module()

    def module(self) -> Module:
        """Return the module with the data sheet's Seebeck coefficient, resistance and conductance.

        Raises
        ------
        ValueError
            If no module can have these values.
        """
        return Module.from_datasheet(
            voltage=self.voltage, current=self.current, difference=self.difference, hot=self.hot
        )


@dataclass(frozen=True, slots=True)
class DisplayParams:
    """A Peltier module under an alumina plate with a flux film on top, on a heat sink.

    The finger covers ``contact_area`` of the plate's ``area`` at 1 N, and more or less with the force; the film
    measures over ``sensor_area`` in the middle of it.  Flux through the contact beside the film enters the plate, too.
    """

    seebeck: float = schema.quantity(
        "V/K", low=1e-4, high=1.0, default=_MODULE["seebeck"], doc="Seebeck coefficient of the module"
    )
    resistance: float = schema.quantity(
        "ohm", low=1e-3, high=100.0, default=_MODULE["resistance"], doc="electrical resistance"
    )
    conductance: float = schema.quantity(
        "W/K", low=1e-3, high=50.0, default=_MODULE["conductance"], doc="heat conductance of the legs"
    )
    max_current: float = schema.quantity("A", low=0.01, high=50.0, default=6.4, doc="greatest current of the driver")
    current_bits: int = schema.integer(low=6, high=32, default=16, doc="resolution of the driver over both signs")
    area: float = schema.quantity("m^2", low=1e-5, high=0.1, default=16e-4, doc="area of the plate")
    contact_area: float = schema.quantity(
        "m^2", low=1e-6, high=0.1, default=AREA_AT_1N, doc="area that the finger touches at 1 N"
    )
    area_exponent: float = schema.quantity(
        "",
        low=0.0,
        high=1.0,
        default=AREA_EXPONENT,
        doc="exponent of the force in that area; Hertz: a third; 0: always the same",
    )
    sensor_area: float = schema.quantity(
        "m^2", low=1e-6, high=0.1, default=SENSOR_AREA, doc="area of the flux film, in the middle under the finger"
    )
    sink_capacity: float = schema.quantity(
        "J/K", low=1.0, high=1e5, default=150.0, doc="heat capacity of hot plate and heat sink"
    )
    sink_resistance: float = schema.quantity(
        "K/W", low=1e-3, high=20.0, default=0.5, doc="thermal resistance from heat sink to room"
    )
    film_coefficient: float = schema.quantity(
        "W/(m^2*K)", low=0.0, high=100.0, default=10.0, doc="heat transfer from the plate to the air"
    )
    delay: float = schema.quantity("s", low=0.0, high=0.2, default=0.02, doc="time from command to current")
    slew: float = schema.quantity(
        "A/s", low=0.0, high=1e6, default=0.0, doc="how fast the driver changes its current; 0: at once"
    )
    command: str = schema.choice(
        "current",
        "temperature",
        default="current",
        doc="what the driver is commanded: a current, or a temperature to hold",
    )
    target_gain: float = schema.quantity(
        "A/K", low=0.01, high=100.0, default=2.0, doc="of a driver that holds a temperature: its proportional gain"
    )
    target_integral: float = schema.quantity(
        "A/(K*s)", low=0.0, high=100.0, default=2.0, doc="of a driver that holds a temperature: its integral gain"
    )
    flux_limit: float = schema.quantity(
        "W/m^2", low=100.0, high=1e6, default=35e3, doc="greatest flux that a controller demands of the module"
    )

    full_scale: float = schema.quantity("W/m^2", low=100.0, high=1e6, default=20e3, doc="full scale of the flux sensor")
    flux_lag: float = schema.quantity("s", low=0.0, high=2.0, default=0.05, doc="time constant of the flux sensor")
    flux_noise: float = schema.quantity("W/m^2", low=0.0, high=5e3, default=20.0, doc="rms of one sample")
    flux_bias: float = schema.quantity(
        "W/m^2", low=-1e3, high=1e3, default=0.0, doc="offset that is left after zeroing"
    )
    flux_resolution: float = schema.quantity("W/m^2", low=0.0, high=100.0, default=0.6, doc="one count; 0: none")
    plate_lag: float = schema.quantity("s", low=0.0, high=2.0, default=0.05, doc="time constant of the plate's sensor")
    plate_noise: float = schema.quantity("K", low=0.0, high=1.0, default=0.01, doc="rms of one sample")
    plate_resolution: float = schema.quantity("K", low=0.0, high=1.0, default=1e-3, doc="one count; 0: none")
    sink_lag: float = schema.quantity("s", low=0.0, high=10.0, default=0.5, doc="time constant of the sink's sensor")
    sink_noise: float = schema.quantity("K", low=0.0, high=1.0, default=0.02, doc="rms of one sample")
    sink_resolution: float = schema.quantity("K", low=0.0, high=1.0, default=1e-2, doc="one count; 0: none")
    skin_noise: float = schema.quantity("K", low=0.0, high=2.0, default=0.05, doc="rms of one infrared sample")
    skin_resolution: float = schema.quantity("K", low=0.0, high=1.0, default=1e-2, doc="one count; 0: none")
    skin_clear: float = schema.quantity(
        "m", low=0.0, high=0.1, default=2e-3, doc="gap above which the infrared thermometer sees the skin"
    )

    contact_resistance: float = schema.quantity(
        "m^2*K/W",
        low=1e-5,
        high=1.0,
        default=DEFAULT_RESISTANCE,
        doc="contact resistance between skin and film at full force",
    )
    full_force: float = schema.quantity(
        "N",
        low=0.0,
        high=20.0,
        default=0.0,
        doc="force below which 1/R falls with the force; 0: R is constant",
    )
    press: float = schema.quantity(
        "s", low=0.0, high=10.0, default=0.0, doc="time constant with which the skin flattens on the film; 0: at once"
    )
    core: float = schema.temperature(
        low=283.15, high=315.15, default=310.15, doc="of the twin: temperature of the finger's core and its blood"
    )
    skin_temperature: float = schema.temperature(
        low=273.15, high=318.15, default=306.15, doc="of the twin: skin temperature of the finger at rest in air"
    )
    humidity: float = schema.quantity("", low=0.0, high=1.0, default=0.5, doc="relative humidity of the room")
    laws: tuple[ForceLaw, ...] = schema.children(
        KINDS, doc="resistance between skin and film as a function of the force"
    )
    tissue: tuple[Layer, ...] = schema.children(Layer, tag="tissue", doc="the twin's finger from the skin inwards")
    mismatch: Mismatch = schema.child(Mismatch, default=Mismatch())
    datasheet: Datasheet | None = schema.child(Datasheet, default=None, doc="of the module")
    mecom: Mecom | None = schema.child(Mecom, default=None, doc="the TEC controller that drives it")
    line: LinePort | None = schema.child(LinePort, default=None, doc="the self-built rig that drives and reads it")
    labjack: LabJack | None = schema.child(LabJack, default=None, doc="the instrument that reads its sensors")

    def __post_init__(self) -> None:
        if self.datasheet is not None:
            self._take(self.datasheet.module())
        schema.validate(self)
        check_laws(self.laws, self.contact_resistance)
        check_layers(self.tissue, "tissue")
        if self.delay + self.mismatch.delay < -1e-12:
            raise ValueError(f"mismatch: delay = {self.mismatch.delay!r} s is more than the delay of {self.delay:g} s")
        if self.laws and self.full_force > 0.0:
            raise ValueError(f"full-force and <{self.laws[0].TAG}> say the same thing: remove one of them")
        for name, usual in (("contact_area", AREA_AT_1N), ("sensor_area", SENSOR_AREA)):
            if getattr(self, name) > self.area * (1.0 + 1e-9):
                if getattr(self, name) != usual:
                    raise ValueError(
                        f"{name} = {getattr(self, name)!r} m^2 is more than the plate's area of {self.area:g}"
                    )
                object.__setattr__(self, name, self.area)  # a plate smaller than the usual area is covered whole
        given = self.contact_area, self.area_exponent
        if self.laws and isinstance(self.laws[0], PressureLaw) and given != SPREAD and given != self.laws[0].spread:
            raise ValueError(f"contact-area and <{self.laws[0].TAG}> say the same thing: remove one of them")

    def _take(self, module: Module) -> None:
        """Set what the data sheet gives; a value that the scene gives besides must agree."""
        for name in ("seebeck", "resistance", "conductance"):
            value, given = getattr(module, name), getattr(self, name)
            if given != _MODULE[name] and abs(given - value) > 1e-9 * value:
                raise ValueError(f"{name} = {given:g} contradicts the data sheet, which gives {value:g}")
            object.__setattr__(self, name, value)

    @property
    def pad(self) -> tuple[float, float]:
        """Contact area of the finger at 1 N [m2], and exponent of the force in it; those of the law, if it has them."""
        if self.laws and isinstance(self.laws[0], PressureLaw):
            return self.laws[0].spread
        return self.contact_area, self.area_exponent

    @property
    def cover(self) -> float:
        """Share of the plate that a finger covers at 1 N."""
        return min(1.0, self.pad[0] / self.area)

    def seen(self, force: float) -> float:
        """Return the share of the flux out of the finger that the sensor reads at a force [N]."""
        return min(1.0, min(self.area, contact_area(force, *self.pad)) / self.sensor_area)

    @property
    def flux_samples(self) -> int:
        """Number of samples averaged in one reading of the flux over a wire."""
        return 1 if self.labjack is None else self.labjack.samples

    @property
    def plate(self) -> tuple[Layer, Layer]:
        """The layers from the finger to the module."""
        return FILM, ALUMINA
