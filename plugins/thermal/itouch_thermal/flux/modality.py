"""The modality `flux-control`: desired flux and readings in, one current out.

Before a touch it brings the plate to the start temperature of the object that the finger approaches; in the touch it
makes the flux out of the finger follow the desired one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from itouch.plugin import Contact, ContactEvent, Field, Modality, Record, World, schema
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.flux import account
from itouch_thermal.flux.proportional import proportional_integral
from itouch_thermal.flux.start import equation_three, outer_effusivity
from itouch_thermal.heat import FINGER, HeatParams, ThermalMaterial

#: The plate is ready within this of its start temperature [K].
READY = 0.1
#: Time constant [s] of the approach to the start temperature of `paper` and `hold`.
APPROACH = 0.25
_READS = ("plate_temperature", "sink_temperature", "heat_flux")


@dataclass(frozen=True, slots=True)
class FluxControlParams:
    """What ``<thermal:flux-control>`` may hold."""

    display: str = schema.ref("device", reads=_READS, commands=("current",), doc="the thermal display")
    desired_from: str = schema.ref("modality", doc="what computes the desired flux")
    controller: str = schema.choice(
        "model", "paper", "hold", default="paper", doc="ours, the paper's, or its start temperature alone"
    )
    proportional: float = schema.quantity("", low=0.0, high=1e4, default=40.0, doc="gain of `paper`")
    integral: float = schema.quantity("Hz", low=0.0, high=1e5, default=100.0, doc="integral gain of `paper`")


@dataclass(frozen=True, slots=True)
class FluxModel:
    """What the modality knows of the scene; ``effusivities`` and ``temperatures`` are per object."""

    name: str
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
    truth: bool


class FluxControl(Modality):
    """Makes the plate draw the desired flux."""

    Params = FluxControlParams

    def compile(self, name: str, params: FluxControlParams, world: World) -> FluxModel:
        """Gather what is known of display, finger and objects."""
        device = world.devices[params.display]
        heat = world.modalities.get(params.desired_from)
        if not isinstance(heat, HeatParams):
            raise ValueError(f"desired_from = '{params.desired_from}' is no modality that computes a heat flux")
        display = device.params if isinstance(device.params, DisplayParams) else DisplayParams()
        band = device.limits.get("temperature", (288.15, 313.15))
        limit = device.limits.get("current", display.max_current)
        names = [channel.name for channel in device.reads]
        return FluxModel(
            name=name,
            params=params,
            display=display,
            probe=heat.probe,
            tissue=outer_effusivity(heat.layers or FINGER),
            effusivities=tuple(_effusivity(element.material) for element in world.objects),
            temperatures=tuple(element.temperature for element in world.objects),
            band=band if isinstance(band, tuple) else (288.15, 313.15),
            current=limit if isinstance(limit, float) else display.max_current,
            ambient=world.ambient,
            skin=world.skin_temperature,
            skin_from=f"{params.display}.skin_temperature" if "skin_temperature" in names else "",
            truth=device.twin,
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
            Field("plate_limited", "i8"),
        )
        return own + account.FIELDS

    def commands(self, model: FluxModel) -> tuple[str, ...]:
        """Return the display's current."""
        return (f"{model.params.display}.current",)

    def reset(self, model: FluxModel, state: Record) -> None:
        """Begin with no object approached and the plate at the room's temperature."""
        state[f"{model.name}.approached"] = -1
        state[f"{model.name}.start_temperature"] = min(model.band[1], max(model.band[0], model.ambient))

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
            state[f"{name}.integral"] = state[f"{name}.flux"].item()
        elif event.kind is Contact.END:
            state[f"{name}.touching"] = 0

    def _aim(self, model: FluxModel, state: Record, index: int) -> None:
        effusivity = model.effusivities[index]
        if effusivity is None:
            return
        name = model.name
        skin = state[model.skin_from].item() if model.skin_from else model.skin
        plate = model.display.plate[-1].effusivity
        wanted = equation_three(effusivity, plate, model.tissue, model.temperatures[index], skin)
        low, high = model.band
        state[f"{name}.approached"] = index
        state[f"{name}.start_temperature"] = min(high, max(low, wanted))
        state[f"{name}.plate_limited"] = int(not low <= wanted <= high)

    def update(self, model: FluxModel, state: Record, period: float) -> None:
        """Command the current."""
        name, display = model.name, model.params.display
        plate = state[f"{display}.plate_temperature"].item()
        sink = state[f"{display}.sink_temperature"].item()
        desired = state[f"{model.params.desired_from}.desired"].item()
        touching = bool(state[f"{name}.touching"].item())
        if touching:
            flux = self._touch(model, state, desired, period)
            self._note(model, state, desired, period)
        else:
            near = state[f"{model.probe}.near_object"].item()
            if near >= 0 and near != state[f"{name}.approached"].item():
                self._aim(model, state, near)
            flux = self._approach(model, state, plate)
        state[f"{name}.flux"] = flux
        state[f"{display}.command.current"] = self._current(model, flux, plate, sink)

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


def _effusivity(material: Any) -> float | None:
    return material.effusivity if isinstance(material, ThermalMaterial) else None
