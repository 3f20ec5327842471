"""What `flux-control` knows of the scene it works in: display, finger, objects, limits, and the names of State."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from contact_heat.resistance import ConstantResistance, ResistanceLaw
from itouch.plugin import ParameterError, Record, Role, World, WorldDevice
from itouch_thermal.display.column import REACH, Array, Column, column
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux.condensation import dew_of, driest
from itouch_thermal.flux.curve import Curve
from itouch_thermal.flux.curve_start import start_for_curve
from itouch_thermal.flux.field_names import Names, driven
from itouch_thermal.flux.flux_control_params import FluxControlParams
from itouch_thermal.flux.law import DEADBEAT, ModelLaw
from itouch_thermal.flux.limits import BAND
from itouch_thermal.flux.object_curves import curves_of
from itouch_thermal.flux.onset import SKIN_STEP
from itouch_thermal.flux.preview import Preview, preview
from itouch_thermal.flux.start import equation_three, outer_effusivity, within
from itouch_thermal.heat import FINGER, HeatParams, ThermalMaterial
from itouch_thermal.laws import law_of

#: Least contact resistance [K m2/W] that is expected between finger and plate.
LEAST = 1e-5
#: Time constant [s] with which `paper` and `hold` approach the start temperature.
APPROACH = 0.25
#: How often the start temperature is found anew [s].
AGAIN = 0.25
#: Longest time that a reading may be on its way over a wire [s].
LONGEST = 0.25
#: Longest time that a command may wait until it leaves [s].
WAIT = 0.05

Starts = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class PlateContact:
    """How finger and plate are expected to meet, which is a matter of these two, not of the virtual object.

    ``law`` gives the contact resistance [K m2/W] by the force, below ``full`` [N] it grows as the force falls besides,
    and it falls with the time constant ``press`` [s] when the finger is set down.  At the force of a usual touch it is
    ``expected``; the controller begins at ``at``, which is the same unless the scene says otherwise.
    """

    law: ResistanceLaw
    expected: float
    at: float
    full: float
    press: float

    @property
    def steady(self) -> bool:
        """Whether it is the same at any force and time."""
        return self.press == 0.0 and self.full == 0.0 and isinstance(self.law, ConstantResistance)


@dataclass(frozen=True, slots=True)
class FluxModel:
    """What the modality knows of the scene.

    ``heat`` is the modality `heat`, which computes the desired flux and knows how it will go on; it is empty where
    recorded curves give all of that flux, or another modality computes it.  Per object there are ``starts`` (start
    temperatures [K] at three skin temperatures), ``temperatures`` [K] before anything was touched, ``curves``, and the
    names ``objects`` and ``materials``.  ``dew`` [K] is the room's dew point.  ``steady`` says that the contact
    resistance of the virtual objects, ``resistance``, is the same at any force and time; ``contact`` is that of the
    plate.  ``preset_time`` [s] is how long ``equalise`` makes every approach take, 0 without it; ``preset_noise`` [A]
    is the noise on the current before a touch.  ``wire`` says that readings and currents are late, ``at`` which of the
    display's readings are those of flux and plate.  ``finger`` is the column of the finger at rest, in steps of an
    update; ``finger_number`` is the probe's number, ``astray`` says that the display is at the finger of another probe.
    ``lead`` [s] is how long the plate takes to reach its target.  ``hold`` is how many servo periods an update stands
    for, ``again`` after how many of them the start temperature is found anew.
    """

    name: str
    names: Names
    params: FluxControlParams
    display: DisplayParams
    probe: str
    finger_number: int
    heat: str
    objects: tuple[str, ...]
    materials: tuple[str, ...]
    starts: tuple[Starts | None, ...]
    temperatures: tuple[float, ...]
    curves: tuple[Curve | None, ...]
    band: tuple[float, float]
    dew: float
    current: float
    ambient: float
    skin: float
    skin_from: str
    skin_valid: str
    force_from: str
    force_at: tuple[str, int]
    astray: bool
    truth: bool
    wire: bool
    at: tuple[int, int]
    period: float
    hold: int
    resistance: ResistanceLaw
    press: float
    steady: bool
    contact: PlateContact
    preset_time: float
    preset_noise: float
    again: int
    finger: Column
    lead: float
    law: ModelLaw | None
    preview: Preview | None

    @property
    def maybe_blind(self) -> bool:
        """Whether only the readings tell if a sensor sees the skin, as on a rig of one's own."""
        line = self.display.line
        return not self.truth and line is not None and line.firmware == "own" and bool(self.skin_valid)

    @property
    def numbers(self) -> Array:
        """The law from force to contact resistance, as compiled code takes it."""
        return np.array(self.resistance.numbers)

    @property
    def estimates(self) -> bool:
        """Whether the obtained flux is the law's own estimate, as no twin knows the true one."""
        return self.law is not None and not self.truth

    def in_contact(self, state: Record) -> bool:
        """Tell whether the finger presses on a virtual object now."""
        if self.heat:
            return math.isfinite(state[self.names.resistance].item())
        return bool(state[self.names.normal_force].item() > 0.0)


def flux_model(name: str, params: FluxControlParams, world: World) -> FluxModel:
    """Gather what is known of display, finger and objects.

    Raises
    ------
    ValueError
        If the display obeys no command that is known, nothing computes the desired flux, or a curve can't be read.
    """
    device = world.devices[params.display]
    display = _display(device)
    heat, known = _heat(params, world)
    dew = dew_of(display, world.ambient)
    band, ceiling = _limits(device, display)
    if params.condensation == "avoid":
        band = driest(band, dew)
    curves, contact = curves_of(params, world), _contact(params, heat, device)
    law, course = None, None
    if params.controller == "model":
        # A twin without its wire reads single samples.
        read = replace(display, labjack=None) if device.twin and display.flux_samples > 1 else display
        law, course = _model(name, read, heat, world, band, ceiling, _wire(device, display), contact)
    starts = _starts(heat, display, world, curves, law, course, contact.press)
    if params.desired_from and not known:  # another modality's flux: the plate renders it on objects of any material
        starts = tuple(_skins(heat, world) if start is None else start for start in starts)
    reads, force = [channel.role for channel in device.reads], _force(params, heat.probe, world)
    wire = law is not None and _wire(device, display)
    hold = 1 if wire else max(1, round(world.period / world.servo_period))
    return FluxModel(
        name=name,
        names=Names.of(
            name, heat.probe, device, world.field_of(params.desired_from, Role.HEAT_FLUX),
            params.desired_from if known else "",
        ),
        params=params,
        display=display,
        probe=heat.probe,
        finger_number=list(world.probes).index(heat.probe),
        heat=params.desired_from if known else "",
        objects=tuple(element.name for element in world.objects),
        materials=tuple(element.material_name for element in world.objects),
        starts=starts,
        temperatures=tuple(element.temperature for element in world.objects),
        curves=curves,
        band=band,
        dew=dew,
        current=ceiling,
        ambient=world.ambient,
        skin=world.skin_of(heat.probe),
        skin_from=_skin_from(device, display),
        skin_valid=device.read_field(Role.SKIN_VALID),
        force_from=force[0],
        force_at=force[1:],
        astray=device not in world.devices_at(heat.probe),
        truth=device.twin,
        wire=wire,
        at=(reads.index(Role.HEAT_FLUX), reads.index(Role.SKIN_CONTACT_TEMPERATURE)) if wire else (0, 0),
        period=world.servo_period,
        hold=hold,
        resistance=heat.law(),
        contact=contact,
        press=heat.press,
        steady=heat.press == 0.0 and isinstance(heat.law(), ConstantResistance),
        preset_time=_preset_time(params, display, ceiling, starts, band),
        preset_noise=params.preset_noise if display.command == "current" else 0.0,
        again=max(1, round(AGAIN / (world.servo_period * hold))) * hold,
        finger=column(
            heat.layers or FINGER, heat.arterial, world.skin_of(heat.probe), display.plate, world.servo_period * hold,
            REACH / 1e-3,
        ),
        lead=display.delay + (max(DEADBEAT, 1.5 * world.servo_period * hold) if law is not None else APPROACH),
        law=law,
        preview=course,
    )  # fmt: skip


def _wire(device: WorldDevice, display: DisplayParams) -> bool:
    """Tell whether readings of the display come late, and commands leave late, over a wire that tells the times."""
    return device.wire and display.command == "current"


def _skin_from(device: WorldDevice, display: DisplayParams) -> str:
    """Return the State field of the skin's temperature; empty: no sensor sees the skin, whatever is read.

    The reference firmware has no thermometer for it; with a TEC controller, the only one can be at a LabJack.
    """
    eyes = display.labjack is not None and display.labjack.infrared is not None
    ours = display.line is not None and display.line.firmware == "reference"
    blind = not device.twin and not eyes and (display.mecom is not None or ours)
    return "" if blind else device.read_field(Role.SKIN_TEMPERATURE)


def _display(device: WorldDevice) -> DisplayParams:
    """Return the parameters of the display, with ``command`` (current or temperature) by the commands that it obeys.

    Raises
    ------
    ParameterError
        If it obeys neither.
    """
    display = device.params if isinstance(device.params, DisplayParams) else DisplayParams()
    if driven(device):
        return display if display.command == "current" else replace(display, command="current")
    if device.command(Role.TEMPERATURE_TARGET) is not None:
        return display if display.command == "temperature" else replace(display, command="temperature")
    listed = ", ".join(f"'{channel.name}'" for channel in device.commands) or "nothing"
    sentence = f"display = '{device.name}' obeys no current (a drive in A) and no temperature target; it obeys {listed}"
    raise ParameterError("display", sentence, "name a thermal display")


def _heat(params: FluxControlParams, world: World) -> tuple[HeatParams, bool]:
    """Return the parameters of the modality `heat`, and whether it is what computes the desired flux.

    Where curves give all of that flux, or another modality computes it, they are the usual ones.

    Raises
    ------
    ValueError
        If nothing says which finger it is, or ``desired_from`` computes no heat flux.
    """
    wanted = params.desired_from
    heat = world.modalities.get(wanted)
    if isinstance(heat, HeatParams):
        return heat, True
    if wanted and not world.field_of(wanted, Role.HEAT_FLUX):
        sentence = f"desired-from = '{wanted}' is not a modality that computes a heat flux"
        advice = "name a <thermal:heat> of the scene, or a modality with a field of State of the role HEAT_FLUX"
        raise ParameterError("desired_from", sentence, advice)
    probes = world.fingers.get(wanted, ()) or tuple(world.probes)
    if len(probes) != 1:
        raise ValueError(f"desired-from must say which of {len(probes)} fingers touches the display")
    return HeatParams(probe=probes[0]), False


def _limits(device: WorldDevice, display: DisplayParams) -> tuple[tuple[float, float], float]:
    """Return the plate's band [K] and the greatest current [A]."""
    band = device.limits.get("temperature", BAND)
    limit = device.limits.get("current", display.max_current)
    return band if isinstance(band, tuple) else BAND, limit if isinstance(limit, float) else display.max_current


def _force(params: FluxControlParams, probe: str, world: World) -> tuple[str, str, int]:
    """Return the State field of the measured force on the plate, and field and index of when it was measured.

    Both fields are empty if nothing at this probe's finger measures the force, unless ``force_from`` says what does.
    """
    named = world.devices.get(params.force_from)
    for device in world.devices_at(probe) if named is None else [named]:
        if channel := device.reading(Role.CONTACT_FORCE):
            return f"{device.name}.{channel.name}", f"{device.name}.measured", device.reads.index(channel)
    return "", "", 0


def _model(
    name: str, display: DisplayParams, heat: HeatParams, world: World, band: tuple[float, float], ceiling: float,
    wire: bool, contact: PlateContact,
) -> tuple[ModelLaw, Preview]:  # fmt: skip
    """Build law and preview of `model`; the currents on their way are always known from what was sent."""
    law = ModelLaw(
        display, heat.layers or FINGER, heat.arterial, world.skin_of(heat.probe), contact.at, world.ambient,
        world.servo_period, band=band, ceiling=ceiling, prefix=f"{name}.",
        longest=round(LONGEST / world.servo_period) if wire else 0,
        wait=round(WAIT / world.servo_period) if wire else 0,
    )  # fmt: skip
    return law, preview(heat, world, law, contact.press)


def _contact(params: FluxControlParams, heat: HeatParams, device: WorldDevice) -> PlateContact:
    """Return how finger and plate are expected to meet: as the display states it; of another device, as the objects."""
    display, force = device.params, heat.expected_force
    if isinstance(display, DisplayParams):
        law, full, press = law_of(display.laws, display.contact_resistance), display.full_force, display.press
    else:
        law, full, press = heat.law(), 0.0, heat.press
    expected = max(law.at(force) * max(1.0, full / force), LEAST)
    return PlateContact(
        law, expected, max(params.contact_resistance, LEAST) if params.contact_resistance else expected, full, press
    )


def _skins(heat: HeatParams, world: World) -> Starts:
    """Return the three skin temperatures [K] for which start temperatures are found."""
    skin = world.skin_of(heat.probe)
    return skin - SKIN_STEP, skin, skin + SKIN_STEP


def _starts(
    heat: HeatParams,
    display: DisplayParams,
    world: World,
    curves: tuple[Curve | None, ...],
    law: ModelLaw | None,
    course: Preview | None,
    press: float,
) -> tuple[Starts | None, ...]:
    """Return the start temperatures [K] per object: by the curve, by the model, or by equation 3; None: unknown."""
    skins = _skins(heat, world)
    found: list[Starts | None] = []
    for element, curve in zip(world.objects, curves, strict=True):
        start: Any = None
        if course is not None and law is not None:
            start = course.starts[element.index]
            if curve is not None:
                start = tuple(start_for_curve(law, press, curve, skin) for skin in skins)
        elif isinstance(element.material, ThermalMaterial):
            beta, tissue = element.material.effusivity, outer_effusivity(heat.layers or FINGER)
            plate = display.plate[-1].effusivity
            start = tuple(equation_three(beta, plate, tissue, element.temperature, skin) for skin in skins)
        found.append(start)
    return tuple(found)


def _preset_time(
    params: FluxControlParams,
    display: DisplayParams,
    ceiling: float,
    starts: tuple[Starts | None, ...],
    band: tuple[float, float],
) -> float:
    """Return the time [s] from approach to readiness that is the same for every object; 0: each as fast as it can."""
    if not params.equalise:
        return 0.0
    from itouch_thermal.display.switching import least_time, strongest

    middles = [within(band, start[1]) for start in starts if start is not None]
    needed = display.delay
    if len(middles) > 1:
        needed += least_time(display, min(middles), max(middles), limit=strongest(display, ceiling))
    longest = MARGIN * needed + SETTLED
    if params.preset_time == 0.0:
        return longest
    if params.preset_time < needed:
        sentence = f"preset-time = {params.preset_time:g} s is too short: the longest switch takes {needed:.2f} s"
        raise ParameterError("preset_time", sentence)
    return params.preset_time


#: Factor on the least time of a switch, for plants that differ from the model, and the time until sensors show it [s].
MARGIN, SETTLED = 1.25, 0.3
