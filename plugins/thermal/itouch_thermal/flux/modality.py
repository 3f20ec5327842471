"""The modality `flux-control`: desired flux and readings in, one current out.

Before a touch it brings the plate to the start temperature of the object that the finger approaches; in the touch it
makes the flux out of the finger follow the desired one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from itouch.plugin import Contact, ContactEvent, Field, Modality, Record, World, schema
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux import account
from itouch_thermal.flux.law import ModelLaw
from itouch_thermal.flux.preview import Preview, look_ahead, preview, run_ahead
from itouch_thermal.flux.proportional import proportional_integral
from itouch_thermal.flux.start import equation_three, outer_effusivity, within
from itouch_thermal.heat import FINGER, HeatParams, ThermalMaterial
from itouch_thermal.solver.live import state_size

#: The plate is ready within this of its start temperature [K].
READY = 0.1
#: Time constant [s] of the approach to the start temperature of `paper` and `hold`.
APPROACH = 0.25
#: Force [N] on the plate that means a finger.
TOUCHED = 0.03
_BAND = (288.15, 313.15)
_READS = ("plate_temperature", "sink_temperature", "heat_flux")


@dataclass(frozen=True, slots=True)
class FluxControlParams:
    """What ``<thermal:flux-control>`` may hold."""

    display: str = schema.ref("device", reads=_READS, commands=("current",), doc="the thermal display")
    desired_from: str = schema.ref("modality", doc="what computes the desired flux")
    controller: str = schema.choice(
        "model", "paper", "hold", default="model", doc="ours, the paper's, or its start temperature alone"
    )
    force_from: str = schema.ref(
        "device", reads=("wrench",), default="", doc="what measures the force on the plate; default: who can"
    )
    proportional: float = schema.quantity("", low=0.0, high=1e4, default=40.0, doc="gain of `paper`")
    integral: float = schema.quantity("Hz", low=0.0, high=1e5, default=100.0, doc="integral gain of `paper`")


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
    law: ModelLaw | None
    preview: Preview | None


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

    @classmethod
    def of(cls, name: str, heat: str, display: str, probe: str) -> Names:
        """Return the names for a modality, the one that it follows, its display and its probe."""
        own = [f"{name}.{field}" for field in cls._fields[:12]]
        there = ("sink_temperature", "sent.current", "age", "command.current", "heat_flux", "plate_temperature")
        others = [f"{heat}.desired", f"{heat}.resistance", *(f"{display}.{field}" for field in there)]
        return cls._make([*own, *others, f"{probe}.near_object"])


class FluxControl(Modality):
    """Makes the plate draw the desired flux."""

    Params = FluxControlParams
    hears = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})

    def compile(self, name: str, params: FluxControlParams, world: World) -> FluxModel:
        """Gather what is known of display, finger and objects."""
        device = world.devices[params.display]
        heat = world.modalities.get(params.desired_from)
        if not isinstance(heat, HeatParams):
            raise ValueError(f"desired_from = '{params.desired_from}' is no modality that computes a heat flux")
        display = device.params if isinstance(device.params, DisplayParams) else DisplayParams()
        band = device.limits.get("temperature", _BAND)
        limit = device.limits.get("current", display.max_current)
        names = [channel.name for channel in device.reads]
        ceiling = limit if isinstance(limit, float) else display.max_current
        law, course = None, None
        if params.controller == "model":
            law, course = _model(name, display, heat, world, band if isinstance(band, tuple) else _BAND, ceiling)
        return FluxModel(
            name=name,
            names=Names.of(name, params.desired_from, params.display, heat.probe),
            params=params,
            display=display,
            probe=heat.probe,
            tissue=outer_effusivity(heat.layers or FINGER),
            effusivities=tuple(_effusivity(element.material) for element in world.objects),
            temperatures=tuple(element.temperature for element in world.objects),
            band=band if isinstance(band, tuple) else _BAND,
            current=ceiling,
            ambient=world.ambient,
            skin=world.skin_temperature,
            skin_from=f"{params.display}.skin_temperature" if "skin_temperature" in names else "",
            force_from=_force(params, world),
            truth=device.twin,
            period=world.servo_period,
            law=law,
            preview=course,
        )

    def fields(self, model: FluxModel) -> tuple[Field, ...]:
        """Return the controller's memory and the account of the contact."""
        own = (
            Field("readiness"),
            Field("start_temperature"),
            Field("approached", "i8"),
            Field("touching", "i8"),
            Field("flux"),
            Field("integral"),
            Field("ticks", "i8"),
            Field("on_plate", "i8"),
            Field("plate_limited", "i8"),
        )
        return own + account.FIELDS + _memory(model)

    def commands(self, model: FluxModel) -> tuple[str, ...]:
        """Return the display's current."""
        return (f"{model.params.display}.current",)

    def reset(self, model: FluxModel, state: Record) -> None:
        """Begin with no object approached and the plate at the room's temperature."""
        state[f"{model.name}.approached"] = -1
        state[f"{model.name}.start_temperature"] = within(model.band, model.ambient)
        if model.law is not None:
            model.law.reset(state)

    def on_contact(self, event: ContactEvent, model: FluxModel, state: Record) -> None:
        """Aim for the object that comes near; begin and end the touch."""
        if event.probe != model.probe:
            return
        name = model.name
        if event.kind is Contact.NEAR:
            self._aim(model, state, event.object_index)
        elif event.kind is Contact.BEGIN:
            rendered = bool(state[f"{model.probe}.plate"].item())
            account.begin(state, name, rendered, state[f"{name}.readiness"].item() >= 1.0)
            state[f"{name}.touching"] = int(rendered)
            state[f"{name}.ticks"] = 0
            state[f"{name}.integral"] = state[f"{name}.flux"].item()
        elif event.kind is Contact.END:
            if model.law is not None and state[f"{name}.on_plate"].item():
                model.law.end(state)
                state[f"{name}.on_plate"] = 0
            state[f"{name}.touching"] = 0

    def _aim(self, model: FluxModel, state: Record, index: int) -> None:
        effusivity = model.effusivities[index]
        if effusivity is None:
            return
        name = model.name
        skin = state[model.skin_from].item() if model.skin_from else model.skin
        plate = model.display.plate[-1].effusivity
        wanted = equation_three(effusivity, plate, model.tissue, model.temperatures[index], skin)
        if model.preview is not None:
            wanted = model.preview.start(index, skin) or wanted
        low, high = model.band
        state[f"{name}.approached"] = index
        state[f"{name}.start_temperature"] = within(model.band, wanted)
        state[f"{name}.plate_limited"] = int(not low <= wanted <= high)

    def update(self, model: FluxModel, state: Record, period: float) -> None:
        """Command the current."""
        touching = bool(state[model.names.touching].item())
        if touching:
            if math.isfinite(state[model.names.resistance].item()):  # not while the contact is about to end
                self._note(model, state, state[model.names.desired].item(), period)
        else:
            near = state[model.names.near_object].item()
            if near >= 0 and near != state[model.names.approached].item():
                self._aim(model, state, near)
        if model.law is not None and model.preview is not None:
            current, flux = self._predictive(model, model.law, model.preview, state, touching, period)
        else:
            current, flux = self._published(model, state, touching, period)
        state[model.names.flux] = flux
        state[model.names.command] = current

    def _published(self, model: FluxModel, state: Record, touching: bool, period: float) -> tuple[float, float]:
        """Return current and flux of `paper` and `hold`."""
        display = model.params.display
        plate = state[f"{display}.plate_temperature"].item()
        sink = state[model.names.sink].item()
        if touching:
            flux = self._touch(model, state, state[model.names.desired].item(), period)
        else:
            flux = self._approach(model, state, plate)
        return self._current(model, flux, plate, sink), flux

    def _predictive(
        self, model: FluxModel, law: ModelLaw, course: Preview, state: Record, touching: bool, period: float
    ) -> tuple[float, float]:
        """Return current and flux of `model`; slower than the servo, the periods between are caught up with."""
        hold = max(1, round(period / model.period))
        readings = (state[model.names.heat_flux].item(), state[model.names.plate_temperature].item())
        sink, sent = state[model.names.sink].item(), state[model.names.sent].item()
        for _ in range(hold - 1):
            law.track(state, sent, math.nan, math.nan, math.nan)
        pressed = self._pressed(model, state)
        if state[model.names.age].item() or (touching and not pressed):
            law.track(state, sent, math.nan, math.nan, math.nan)
        else:
            law.track(state, sent, readings[0], readings[1], sink)
        if pressed and not state[model.names.on_plate].item():
            law.disturb(state)
        if touching:
            ticks = state[model.names.ticks].item()
            if ticks == 0:
                self._begin(model, law, course, state)
            else:
                self._continue(model, law, course, state, ticks, hold)
            state[model.names.ticks] = ticks + hold
            if pressed and not state[model.names.on_plate].item():
                law.begin(state, state[model.names.flux].item())
                state[model.names.on_plate] = 1
            if state[model.names.on_plate].item():
                self._want(model, law, state, ticks)
                return law.follow(state, 1.0, hold)
        current, flux, error = law.approach(state, state[model.names.start_temperature].item(), hold)
        state[model.names.readiness] = max(0.0, min(1.0, 2.0 - abs(error) / READY))
        return current, flux

    def _pressed(self, model: FluxModel, state: Record) -> bool:
        """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
        if model.force_from:
            return bool(abs(state[model.force_from][2].item()) > TOUCHED)
        return math.isfinite(state[model.names.resistance].item())

    def _begin(self, model: FluxModel, law: ModelLaw, course: Preview, state: Record) -> None:
        """Copy the model finger and object as they are after their first step, and run them ahead."""
        heat = model.params.desired_from
        index = state[f"{heat}.object"].item()
        body = course.bodies[index]
        if body is None:
            return
        finger = state[f"{heat}.finger"]
        above, below = state[model.names.preview_finger], state[model.names.preview_object]
        above[:] = finger
        below[:] = state[f"{heat}.objects"][index][: len(below)]
        state[model.names.preview_index] = index
        future = state[model.names.future]
        future[0] = state[model.names.desired].item()
        run_ahead(course.finger, above, body, below, course.resistance, future, 1, law.ahead)
        law.place(state, course.into @ finger[: course.into.shape[1]])

    def _continue(self, model: FluxModel, law: ModelLaw, course: Preview, state: Record, ticks: int, hold: int) -> None:
        body = course.bodies[state[model.names.preview_index].item()]
        if body is not None:
            above, below = state[model.names.preview_finger], state[model.names.preview_object]
            first = ticks - hold + law.ahead + 1
            run_ahead(course.finger, above, body, below, course.resistance, state[model.names.future], first, hold)

    def _want(self, model: FluxModel, law: ModelLaw, state: Record, ticks: int) -> None:
        """Fill the plan's desired flux."""
        desired = state[model.names.desired].item()
        look_ahead(state[model.names.future], ticks, law.offsets, desired, state[model.names.wanted])

    def _approach(self, model: FluxModel, state: Record, plate: float) -> float:
        """Return the flux that brings the plate to its start temperature."""
        error: float = plate - state[f"{model.name}.start_temperature"].item()
        state[f"{model.name}.readiness"] = max(0.0, min(1.0, 2.0 - abs(error) / READY))
        capacity = sum((layer.thickness or 0.0) * layer.heat_capacity for layer in model.display.plate)
        limit = model.display.flux_limit
        return min(limit, max(-limit, capacity * error / APPROACH))

    def _touch(self, model: FluxModel, state: Record, desired: float, period: float) -> float:
        if model.params.controller == "hold":
            return self._approach(model, state, state[f"{model.params.display}.plate_temperature"].item())
        error = desired - state[f"{model.params.display}.heat_flux"].item()
        gains = (model.params.proportional, model.params.integral)
        return proportional_integral(state, model.name, error, gains, model.display.flux_limit, period)

    def _current(self, model: FluxModel, flux: float, plate: float, sink: float) -> float:
        from itouch_thermal.display.peltier import current_for

        p = model.display
        current = current_for(p.seebeck, p.resistance, p.conductance, flux * p.area, plate, sink)
        return float(min(model.current, max(-model.current, current)))

    def _note(self, model: FluxModel, state: Record, desired: float, period: float) -> None:
        display = model.params.display
        if model.truth and f"{display}.twin.true_flux" in state:
            flux, skin = state[f"{display}.twin.true_flux"].item(), state[f"{display}.twin.true_skin"].item()
        else:
            flux, skin = state[f"{display}.heat_flux"].item(), math.nan
        account.add(state, model.name, flux, desired, skin, period)

    def measures(
        self, model: FluxModel, state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return the flux obtained in the contact that has just ended, or is open."""
        if probe != model.probe:
            return {}
        truth = model.truth and f"{model.params.display}.twin.true_flux" in state
        return account.measures(state, model.name, "twin" if truth else "sensor")


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
        display, heat.layers or FINGER, heat.arterial, world.skin_temperature, heat.contact_resistance, world.ambient,
        world.servo_period, band=band, ceiling=ceiling, prefix=f"{name}.",
    )  # fmt: skip
    return law, preview(heat, world, law.trial, law.coarse_ticks)


def _memory(model: FluxModel) -> tuple[Field, ...]:
    """Return the State of `model`: its law and the contact that runs ahead; names without the modality's own."""
    if model.law is None or model.preview is None:
        return ()
    cut = len(model.name) + 1
    own = tuple(Field(field.name[cut:], field.dtype, field.size) for field in model.law.fields())
    size = state_size(model.preview.finger)
    return (
        *own,
        Field("preview_finger", "f8", size),
        Field("preview_object", "f8", model.preview.widest),
        Field("preview_index", "i8"),
    )


def _effusivity(material: Any) -> float | None:
    return material.effusivity if isinstance(material, ThermalMaterial) else None
