"""The modality `flux-control`: desired flux and readings in, the one command that the display obeys out.

Before a touch it brings the plate to the start temperature of the object that the finger approaches; in the touch it
makes the flux out of the finger follow the desired one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from itouch.plugin import Bound, Contact, ContactArrays, ContactEvent, Field, Modality, Record, Role, World
from itouch_thermal.flux import actuation, condensation, flux_error, flux_report, joined, predictive, published
from itouch_thermal.flux.flux_control_params import FluxControlParams
from itouch_thermal.flux.flux_model import FluxModel, flux_model
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
    Field("last_end", "i8", unit="tick", doc="when the last one ended"),
    Field("slid", "i8", low=0, unit="tick", doc="for how long the finger had touched others when it slid to this one"),
    Field("fresh", "i8", unit="1", doc="1 in the first update in which the plate renders"),
    Field(
        "pressing", "i8", unit="1",
        doc="1 while the finger presses; more by the updates since the plate let go of it; -1 if that is long ago",
    ),
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
    subscribes_to = frozenset({Contact.NEAR, Contact.BEGIN, Contact.END})
    #: What has been learnt of the plant, and what is on its way to it: without these a new scene's first touches would
    #: be 15 to 25 % off.
    persistent_fields = (
        "calm", "looked", "tracked", "x", "theta", "queue", "line", "slots", "departed", "gain", "memory", "cover",
        "single", "condensation_time", "sent_log", "before", "waited", "interval",
    )  # fmt: skip
    extended_fields = frozenset({"preview_object"})
    measured = flux_error.MEASURED

    def compile(self, name: str, params: FluxControlParams, world: World) -> FluxModel:
        """Gather what is known of display, finger and objects."""
        return flux_model(name, params, world)

    def notices(self, model: FluxModel) -> tuple[str, ...]:
        """Warn of water on the plate, and of a display that another finger touches than the one that is followed."""
        found = [condensation.warning(model.band, model.dew, model.ambient, model.display.humidity)]
        if model.astray:
            found.append(
                f"'{model.params.display}' is at another finger than that of probe '{model.probe}', whose heat it "
                "shows: flux and skin in the report are not those of this probe's finger"
            )
        return tuple(sentence for sentence in found if sentence)

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
        return own + flux_error.FIELDS + actuation.fields(model) + memory

    def commands(self, model: FluxModel) -> tuple[str, ...]:
        """Return the display's channels that it commands: a current, or a temperature and whether the output is on."""
        return actuation.channels(model)

    def uses_intermediate_ticks(self, model: FluxModel) -> bool:
        """Tell whether every tick counts: behind a wire the newest command leaves, and readings come, at any time."""
        return model.wire and model.law is not None

    def on_intermediate_tick(self, model: FluxModel, state: Record) -> None:
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
        tick = joined.tick_of(model, state)
        if model.law is not None and model.preview is not None:
            predictive.hear(model, model.law, model.preview, tick, state, event)
        else:
            tick.hear(event).run()

    def update(self, model: FluxModel, state: Record, period: float) -> None:
        """Command the display."""
        tick = joined.tick_of(model, state)
        if model.law is not None and model.preview is not None:
            predictive.control(model, model.law, model.preview, tick, state)
        else:
            tick.attend.run()
            published.control(model, tick, state, period)

    def on_skipped_time(self, model: FluxModel, state: Record, seconds: float) -> None:
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
        return joined.Tick(model, state).bounds if joined.joins(model, state) else ()

    def bound_contact(self, model: FluxModel, state: Record, event: ContactArrays) -> Bound | None:
        """Return the handling of an event as one compiled call, which leaves unusual ones to Python; None: all are."""
        joins = joined.joins(model, state)
        if not joins or joined.leaves(model):
            joined.tick_of(model, state).join(event)
        return joined.Tick(model, state).heard(event) if joins else None

    def on_ground_truth(self, model: FluxModel, state: Record, twins: Mapping[str, Record]) -> None:
        """Take in the true flux, which the twin behind the display's emulator knows."""
        names, twin = model.names, twins.get(model.params.display)
        if twin is None or names.truth not in twin or not state[names.touching].item():
            return
        truth = twin[names.truth].item()
        if (
            not truth
            or not model.in_contact(state)
            or not flux_error.scored(state[f"{model.name}.account"], model.period * model.hold)
        ):
            return
        curve, tick = model.curves[state[names.object].item()], state["tick"].item() - 1
        if curve is None:
            desired = state[names.heat_desired].item()
        else:
            desired = curve.at((tick - state[names.begun].item() + 1) * model.period)
        estimate = math.nan if tick % model.hold else state[names.obtained].item()
        flux_error.note_ground_truth(state, model.name, truth, estimate, desired)

    def measures(
        self, model: FluxModel, state: Record, probe: str, object_index: int
    ) -> dict[str, float | str | bool | None]:
        """Return the figures of the contact that has just ended, or is open."""
        if probe != model.probe:
            return {}
        truth = model.truth and model.names.true_flux in state
        source = "estimate" if model.estimates else "twin" if truth else "sensor"
        return flux_error.measures(state, model.name, source)

    def contact_summary(self, model: FluxModel, entry: Mapping[str, Any]) -> str:
        """Return a few words on the contact: its mean flux."""
        return flux_error.contact_summary(entry) if entry["probe"] == model.probe else ""

    def contact_warnings(self, model: FluxModel, entry: Mapping[str, Any]) -> tuple[str, ...]:
        """Return remarks on a plate that was not ready, or limited, and on how good an estimated flux is."""
        return flux_error.contact_warnings(entry) if entry["probe"] == model.probe else ()

    def status(self, model: FluxModel, state: Record) -> str:
        """Return the plate's temperature, with its readiness or, in a touch, the desired flux."""
        return flux_report.status(model, state)

    def report(self, model: FluxModel, state: Record) -> dict[str, Any]:
        """Return the modality's part of the report: settings, switching times, readiness and condensation."""
        return flux_report.report(model, state)
