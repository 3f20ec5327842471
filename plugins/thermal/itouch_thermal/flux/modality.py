"""The modality `flux-control`: desired flux and readings in, the one command that the display obeys out.

Before a touch it brings the plate to the start temperature of the object that the finger approaches; in the touch it
makes the flux out of the finger follow the desired one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from itouch.plugin import Bound, Contact, ContactEvent, Field, HeardContact, Modality, Record, Role, World
from itouch_thermal.flux import account, actuation, approach, condensation, joined, predictive, published, telling
from itouch_thermal.flux.flux_control_params import FluxControlParams
from itouch_thermal.flux.masking import masked
from itouch_thermal.flux.setting import FluxModel, setting
from itouch_thermal.flux.start import within

#: State fields of flux, approach and calibration.
_APPROACH = (
    Field("readiness", unit="1", doc="1 when the plate is at the start temperature within 0.1 K, falls to 0 at 0.2 K"),
    Field("plate_ready", "i8", unit="1", doc="1 when `readiness` is", role=Role.READY),
    Field(
        "start_temperature", unit="K", doc="where the plate goes before the touch of the near object", show="no",
    ),
    Field(
        "desired", unit="W/m^2", doc="desired flux: of `desired-from`, or of a recorded curve",
        show="wish: heat flux out of the finger",
    ),
    Field(
        "obtained", unit="W/m^2", show="no",
        doc="flux out of the finger: the twin's true one, on hardware the sensor's, corrected",
    ),
    Field("flux", unit="W/m^2", doc="flux at the plate's face that the controller assumes", show="no"),
    Field("approached", "i8", unit="1", doc="number of the object that is near, -1: none"),
    Field("calm", unit="K", doc="mean of the skin's readings while the rig is calibrated, 0: none", show="no"),
    Field("looked", unit="s", doc="over how long that mean is", show="no"),
)  # fmt: skip
#: State fields of when the approach began, and whether a contact is open and rendered.
_BEGIN = (
    Field("preset_begun", "i8", unit="tick", doc="when the approach to the start temperature began"),
    Field("open", "i8", unit="1", doc="1 in contact with an object"),
    Field("touching", "i8", unit="1", doc="1 while the plate renders a contact with an object that has a flux"),
)
#: State fields of the touch, and of condensation.
_TOUCH = (
    Field("begun", "i8", unit="tick", doc="when the contact began"),
    Field("fresh", "i8", unit="1", doc="1 in the first update in which the plate renders"),
    Field("pressing", "i8", unit="1", doc="1 while the finger presses on the plate"),
    Field("integral", unit="W/m^2", doc="integral part of the flux of the controller `paper`", show="no"),
    Field("on_plate", "i8", unit="1", doc="1 while the finger is felt on the plate"),
    Field(
        "plate_limited", "i8", unit="1",
        doc="1 if the start temperature lies outside the plate's band and was clipped",
    ),
    Field("unready", "i8", unit="1", doc="touches that began before the plate was ready"),
    Field(
        "condensation_time", unit="s", doc="how long the plate has been below the room's dew point", show="no",
    ),
)  # fmt: skip


class FluxControl(Modality):
    """Makes the plate draw the desired flux."""

    Params = FluxControlParams
    hears = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})
    #: What has been learnt of the plant, and what is on its way to it: without these a new scene's first touches would
    #: be 15 to 25 % off.
    goes_on = (
        "calm", "looked", "tracked", "x", "theta", "queue", "line", "slots", "departed", "gain", "memory", "cover",
        "single", "condensation_time", "sent_log", "before", "waited", "interval",
    )  # fmt: skip
    measured = account.MEASURED

    def compile(self, name: str, params: FluxControlParams, world: World) -> FluxModel:
        """Gather what is known of display, finger and objects."""
        return setting(name, params, world)

    def notices(self, model: FluxModel) -> tuple[str, ...]:
        """Warn of water on the plate."""
        found = condensation.warning(model.band, model.dew, model.ambient, model.display.humidity)
        return (found,) if found else ()

    def fields(self, model: FluxModel) -> tuple[Field, ...]:
        """Return the controller's memory and the account of the contact."""
        modes = model.finger.tissue.shape[1]
        covered = Field(
            "covered", "f8", modes, unit="K", doc="modes of what touches in the calibration have done to the skin"
        )
        what = "number of the object that is touched, -1: none"
        touched = Field("object", "i8", low=-1, high=len(model.curves) - 1, unit="1", doc=what)
        own = (*_APPROACH, covered, *_BEGIN, touched, *_TOUCH)
        memory = predictive.memory(model) if model.law is not None else published.memory(model)
        return own + account.FIELDS + actuation.fields(model) + memory

    def commands(self, model: FluxModel) -> tuple[str, ...]:
        """Return the display's channels that it commands: a current, or a temperature and whether the output is on."""
        return actuation.channels(model)

    def attends(self, model: FluxModel) -> bool:
        """Tell whether every tick counts: behind a wire the newest command leaves, and readings come, at any time."""
        return model.wire and model.law is not None

    def between(self, model: FluxModel, state: Record) -> None:
        """Do the same as in an update."""
        self.update(model, state, model.period)

    def reset(self, model: FluxModel, state: Record) -> None:
        """Begin with no object approached and the plate at the room's temperature."""
        state[model.names.approached] = state[model.names.object] = -1
        state[model.names.start_temperature] = within(model.band, model.ambient)
        if model.law is not None:
            model.law.reset(state)
        actuation.reset(model, state)
        if model.law is not None:
            state[model.names.departed] = -1

    def on_contact(self, event: ContactEvent, model: FluxModel, state: Record) -> None:
        """Aim for the object that comes near; begin and end the touch."""
        if event.probe != model.probe:
            return
        names = model.names
        if event.kind is Contact.NEAR and not state[names.touching].item():
            approach.aim(model, state, approach.coming(model, state), event.tick)
        elif event.kind is Contact.BEGIN:
            account.begin(state, model.name)
            state[names.object] = event.object_index
            state[names.begun] = event.tick
            state[names.open] = 1
            self._meet(model, state, event.tick)
            if state[names.touching].item() and model.hold > 1:
                predictive.set_down(model, state, event.tick)
        elif event.kind is Contact.END:
            state[names.open] = 0
            self._part(model, state, event.tick)

    def _meet(self, model: FluxModel, state: Record, tick: int) -> None:
        """Render the heat of the open contact as long as the plate is what touches the finger, and only then."""
        names, index = model.names, state[model.names.object].item()
        if model.starts[index] is None or state[names.met].item() < 0:  # a finger lifts for a moment: no change
            return
        there, touching = bool(state[names.plate].item()), bool(state[names.touching].item())
        if touching and not there:
            self._part(model, state, tick)
        elif there and not touching:
            aimed = state[names.approached].item() == index
            ready, limited = (aimed and bool(state[one].item()) for one in (names.plate_ready, names.plate_limited))
            again = account.render(state, model.name, ready, limited, self._obtained(model, state)[1])
            state[names.touching] = state[names.fresh] = 1
            state[names.pressing] = 0
            state[f"{model.name}.integral"] = state[names.flux].item()
            if not ready and not again:
                state[names.unready] += 1

    def _part(self, model: FluxModel, state: Record, tick: int) -> None:
        """End the touch of a finger that the plate no longer touches, and aim for the next object.

        The finger may be on that already, so readiness is judged at once, by how near its start temperature is.
        """
        names, touched = model.names, bool(state[model.names.touching].item())
        predictive.take_off(model, state, tick)
        state[names.touching] = 0
        approach.aim(model, state, approach.coming(model, state), tick)
        if touched:
            error = state[names.plate_temperature].item() - state[names.start_temperature].item()
            approach.judge(model, state, error, tick)

    def update(self, model: FluxModel, state: Record, period: float) -> None:
        """Command the display."""
        names, period = model.names, model.period if model.wire else period
        tick = state["tick"].item()
        if state[names.open].item():
            self._meet(model, state, tick)
        touching = bool(state[names.touching].item())
        if touching:
            self._note(model, state, period, model.in_contact(state))  # not while the contact is about to end
            self._desire(model, state, tick)
        else:
            self._look(model, state, tick, period)
        if model.law is not None and model.preview is not None:
            current, flux = predictive.control(model, model.law, model.preview, state, touching, tick)
        else:
            current, flux = published.control(model, state, touching, period, tick)
        state[names.fresh] = 0
        state[names.flux] = flux
        if model.law is not None and model.estimates:
            state[names.obtained] = model.law.estimate(state)[0]
        if not touching:
            current = masked(current, model.preset_noise, model.current, tick)
        actuation.issue(model, state, current, model.hold)

    def left_out(self, model: FluxModel, state: Record, seconds: float) -> None:
        """Let the law go on under the current that left last; the touch is older by the time left out."""
        if model.truth:  # a simulated display, and the finger on it, have stood still
            return
        names, periods = model.names, round(seconds / model.period)
        if model.law is not None:
            predictive.leave_out(model, state, periods)
        for moment in (names.begun, names.preset_begun):
            state[moment] -= periods

    def bound_update(self, model: FluxModel, state: Record, period: float) -> tuple[Bound, ...]:
        """Return the update of these views as compiled calls, which leave unusual ticks to Python; empty: none can."""
        if model.law is None or model.preview is None or not joined.joins(model, state):
            return ()
        return joined.bounds(model, model.law, model.preview, state)

    def bound_contact(self, model: FluxModel, state: Record, event: HeardContact) -> Bound | None:
        """Return the handling of an event as one compiled call, which leaves unusual ones to Python; None: all are."""
        if model.law is None or model.preview is None or not joined.joins(model, state):
            return None
        return joined.heard(model, model.law, model.preview, state, event)

    def _look(self, model: FluxModel, state: Record, tick: int, period: float) -> None:
        """Aim, between touches, for the object that is near, and count the time in which water may condense."""
        names = model.names
        near = approach.coming(model, state)
        if not state["ready"].item():
            approach.equal(model, state, period)
        elif near >= 0 and near != state[names.approached].item():
            approach.aim(model, state, near, tick)
        elif near >= 0:
            approach.follow(model, state, tick)
        if state[names.desired].item():
            state[names.desired] = 0.0
        if state[names.plate_temperature].item() < model.dew:
            state[names.condensation_time] += period

    def _desire(self, model: FluxModel, state: Record, tick: int) -> None:
        """Write the flux that is desired in this tick."""
        names = model.names
        curve = model.curves[state[names.object].item()]
        if curve is not None:
            state[names.desired] = curve.at((tick - state[names.begun].item() + 1) * model.period)
        else:
            state[names.desired] = state[names.heat_desired]

    def _note(self, model: FluxModel, state: Record, period: float, pressing: bool) -> None:
        """Enter the last update into the account, but not one in which the finger lifts: it is no part of the touch."""
        names = model.names
        flux, skin = self._obtained(model, state)
        if pressing and state[names.pressing].item():
            desired = state[names.desired].item()
            if model.estimates and account.scored(state, model.name, period):
                deviation = model.law.estimate(state)[1] if model.law is not None else 0.0
                account.compare(state, model.name, state[names.heat_flux].item(), deviation, desired)
            account.add(state, model.name, state[names.obtained].item(), desired, skin, period)
        state[names.obtained] = flux
        state[names.pressing] = int(pressing)

    def _obtained(self, model: FluxModel, state: Record) -> tuple[float, float]:
        """Return the flux out of the finger [W/m2] as best known, and its skin temperature [K]; NaN: unknown."""
        names = model.names
        if model.estimates:
            return state[names.obtained].item(), math.nan
        if model.truth and names.true_flux in state:
            return state[names.true_flux].item(), state[names.true_skin].item() if names.true_skin else math.nan
        force = abs(state[model.force_from][2].item()) if model.force_from else state[names.normal_force].item()
        part = model.display.seen(force) if force > 0.0 else 1.0
        return state[names.heat_flux].item() / part, math.nan

    def witness(self, model: FluxModel, state: Record, twins: Mapping[str, Record]) -> None:
        """Take in the true flux, which the twin behind the display's emulator knows."""
        names, twin = model.names, twins.get(model.params.display)
        if twin is None or names.truth not in twin or not state[names.touching].item():
            return
        truth = twin[names.truth].item()
        if not truth or not model.in_contact(state) or not account.scored(state, model.name, model.period * model.hold):
            return
        curve, tick = model.curves[state[names.object].item()], state["tick"].item() - 1
        if curve is None:
            desired = state[names.heat_desired].item()
        else:
            desired = curve.at((tick - state[names.begun].item() + 1) * model.period)
        estimate = math.nan if tick % model.hold else state[names.obtained].item()
        account.witness(state, model.name, truth, estimate, desired)

    def measures(
        self, model: FluxModel, state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return the figures of the contact that has just ended, or is open."""
        if probe != model.probe:
            return {}
        truth = model.truth and model.names.true_flux in state
        source = "estimate" if model.estimates else "twin" if truth else "sensor"
        return account.measures(state, model.name, source)

    def ended(self, model: FluxModel, entry: Mapping[str, Any]) -> str:
        """Return a few words on the contact: its mean flux."""
        return account.ended(entry) if entry["probe"] == model.probe else ""

    def remarks(self, model: FluxModel, entry: Mapping[str, Any]) -> tuple[str, ...]:
        """Return remarks on a plate that was not ready, or limited, and on how good an estimated flux is."""
        return account.remarks(entry) if entry["probe"] == model.probe else ()

    def status(self, model: FluxModel, state: Record) -> str:
        """Return the plate's temperature, with its readiness or, in a touch, the desired flux."""
        return telling.status(model, state)

    def report(self, model: FluxModel, state: Record) -> dict[str, Any]:
        """Return the modality's part of the report: settings, switching times, readiness and condensation."""
        return telling.report(model, state)
