"""The modality `flux-control`: desired flux and readings in, one current out.

Before a touch it brings the plate to the start temperature of the object that the finger approaches; in the touch it
makes the flux out of the finger follow the desired one.
"""

from __future__ import annotations

import math

from itouch.plugin import Contact, ContactEvent, Field, Modality, Record, World
from itouch_thermal.flux import account, predictive, published
from itouch_thermal.flux.params import FluxControlParams
from itouch_thermal.flux.setting import FluxModel, setting
from itouch_thermal.flux.start import equation_three, within


class FluxControl(Modality):
    """Makes the plate draw the desired flux."""

    Params = FluxControlParams
    hears = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})

    def compile(self, name: str, params: FluxControlParams, world: World) -> FluxModel:
        """Gather what is known of display, finger and objects."""
        return setting(name, params, world)

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
        return own + account.FIELDS + predictive.memory(model)

    def commands(self, model: FluxModel) -> tuple[str, ...]:
        """Return the display's current."""
        return (f"{model.params.display}.current",)

    def reset(self, model: FluxModel, state: Record) -> None:
        """Begin with no object approached and the plate at the room's temperature."""
        state[model.names.approached] = -1
        state[model.names.start_temperature] = within(model.band, model.ambient)
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
            current, flux = predictive.control(model, model.law, model.preview, state, touching, period)
        else:
            current, flux = published.control(model, state, touching, period)
        state[model.names.flux] = flux
        state[model.names.command] = current

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
