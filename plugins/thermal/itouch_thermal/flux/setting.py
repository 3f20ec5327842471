"""What `flux-control` knows of the scene it works in: display, finger, objects, limits, and the names of State."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from itouch.plugin import World, WorldDevice
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.params import FluxControlParams
from itouch_thermal.flux.preview import Preview, preview
from itouch_thermal.flux.start import outer_effusivity
from itouch_thermal.heat import FINGER, HeatParams, ThermalMaterial
from itouch_thermal.solver.resistance import ConstantResistance, ResistanceLaw

#: Least contact resistance [K m2/W] that the finger on the plate is thought to have.
LEAST = 1e-5
#: Plate temperatures [K] where no limits are known.
BAND = (288.15, 313.15)


class Names(NamedTuple):
    """Names of the fields that a tick touches; put together once."""

    touching: str
    approached: str
    on_plate: str
    ticks: str
    flux: str
    start_temperature: str
    readiness: str
    preview_finger: str
    preview_object: str
    preview_index: str
    reached: str
    future: str
    wanted: str
    desired: str
    resistance: str
    sink: str
    sent: str
    age: str
    command: str
    heat_flux: str
    plate_temperature: str
    near_object: str
    normal_force: str

    @classmethod
    def of(cls, name: str, heat: str, display: str, probe: str) -> Names:
        """Return the names for a modality, the one that it follows, its display and its probe."""
        own = [f"{name}.{field}" for field in cls._fields[:13]]
        there = ("sink_temperature", "sent.current", "age", "command.current", "heat_flux", "plate_temperature")
        others = [f"{heat}.desired", f"{heat}.resistance", *(f"{display}.{field}" for field in there)]
        return cls._make([*own, *others, f"{probe}.near_object", f"{probe}.normal_force"])


@dataclass(frozen=True, slots=True)
class FluxModel:
    """What the modality knows of the scene; ``effusivities`` and ``temperatures`` are per object."""

    name: str
    names: Names
    params: FluxControlParams
    display: DisplayParams
    probe: str
    tissue: float
    effusivities: tuple[float | None, ...]
    temperatures: tuple[float, ...]
    band: tuple[float, float]
    current: float
    ambient: float
    skin: float
    skin_from: str
    force_from: str
    truth: bool
    period: float
    resistance: ResistanceLaw
    expected: float
    press: float
    law: ModelLaw | None
    preview: Preview | None

    @property
    def steady(self) -> bool:
        """Whether the contact resistance is the same at any force and time."""
        return isinstance(self.resistance, ConstantResistance) and self.press == 0.0


def setting(name: str, params: FluxControlParams, world: World) -> FluxModel:
    """Gather what is known of display, finger and objects.

    Raises
    ------
    ValueError
        If what ``desired_from`` names computes no heat flux.
    """
    device = world.devices[params.display]
    heat = world.modalities.get(params.desired_from)
    if not isinstance(heat, HeatParams):
        raise ValueError(f"desired_from = '{params.desired_from}' is no modality that computes a heat flux")
    display = device.params if isinstance(device.params, DisplayParams) else DisplayParams()
    band, ceiling = _limits(device, display)
    law, course = None, None
    if params.controller == "model":
        law, course = _model(name, display, heat, world, band, ceiling)
    names = [channel.name for channel in device.reads]
    return FluxModel(
        name=name,
        names=Names.of(name, params.desired_from, params.display, heat.probe),
        params=params,
        display=display,
        probe=heat.probe,
        tissue=outer_effusivity(heat.layers or FINGER),
        effusivities=tuple(_effusivity(element.material) for element in world.objects),
        temperatures=tuple(element.temperature for element in world.objects),
        band=band,
        current=ceiling,
        ambient=world.ambient,
        skin=world.skin_temperature,
        skin_from=f"{params.display}.skin_temperature" if "skin_temperature" in names else "",
        force_from=_force(params, world),
        truth=device.twin,
        period=world.servo_period,
        resistance=heat.law(),
        expected=max(heat.expected_resistance, LEAST),
        press=heat.press,
        law=law,
        preview=course,
    )


def _limits(device: WorldDevice, display: DisplayParams) -> tuple[tuple[float, float], float]:
    """Return the plate's band [K] and the greatest current [A]."""
    band = device.limits.get("temperature", BAND)
    limit = device.limits.get("current", display.max_current)
    return band if isinstance(band, tuple) else BAND, limit if isinstance(limit, float) else display.max_current


def _force(params: FluxControlParams, world: World) -> str:
    """Return the State field of the measured force on the plate, empty if nothing measures it."""
    for device in world.devices.values():
        if params.force_from in ("", device.name) and any(channel.name == "wrench" for channel in device.reads):
            return f"{device.name}.wrench"
    return ""


def _model(
    name: str, display: DisplayParams, heat: HeatParams, world: World, band: tuple[float, float], ceiling: float
) -> tuple[ModelLaw, Preview]:
    """Build the constants of `model`; what is on its way is always known from what was sent."""
    law = ModelLaw(
        display, heat.layers or FINGER, heat.arterial, world.skin_temperature, max(heat.expected_resistance, LEAST),
        world.ambient, world.servo_period, band=band, ceiling=ceiling, prefix=f"{name}.",
    )  # fmt: skip
    return law, preview(heat, world, law)


def _effusivity(material: Any) -> float | None:
    return material.effusivity if isinstance(material, ThermalMaterial) else None
