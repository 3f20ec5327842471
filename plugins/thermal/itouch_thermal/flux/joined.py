"""The arguments of the compiled tick of the controller `model`: scene, State, limits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from itouch.plugin import Bound, HeardContact, Record
from itouch_thermal.flux import contact_events, usual, views, wires
from itouch_thermal.flux.law import DEADBEAT, ModelLaw
from itouch_thermal.flux.predictive import part
from itouch_thermal.flux.preview import Preview, first_steps
from itouch_thermal.flux.setting import FluxModel
from itouch_thermal.heat import table_of


def joins(model: FluxModel, state: Record) -> bool:
    """Tell whether a scene's ticks can join: `model` commands a current without a wire, and a twin knows the truth."""
    known = model.law is not None and model.preview is not None and bool(model.heat)
    plain = not model.wire and model.display.command == "current"
    names = model.names
    return known and plain and model.truth and names.true_flux in state and names.true_skin in state


def bounds(model: FluxModel, law: ModelLaw, course: Preview, state: Record) -> tuple[Bound, ...]:
    """Return the update on these views of State as compiled calls; the first one leaves unusual ticks to Python."""
    scene, own, memory = _scene(model, state), _own(model, state), law.memory(state)
    given, figures = _given(model, law, course), _figures(model, law, course)
    taken = views.Taken(np.ones(1), np.zeros(1), np.ones(1), np.zeros(1, np.int64))
    return (
        Bound(usual.prepare, scene, own, given, figures, memory, taken),
        Bound(usual.track, scene, given, memory, taken, law.coarse_ticks, min(wires.MISSED, model.hold - 1)),
        Bound(usual.command, scene, own, given, figures, memory, taken, model.at_once),
    )


def heard(model: FluxModel, law: ModelLaw, course: Preview, state: Record, event: HeardContact) -> Bound:
    """Return the handling of an event on these views as a compiled call, which leaves unusual ones to Python."""
    given, figures = _given(model, law, course), _figures(model, law, course)
    return Bound(
        contact_events.hear, event, _scene(model, state), _own(model, state), given, figures, law.memory(state)
    )


def _scene(model: FluxModel, state: Record) -> views.Scene:
    names, nothing = model.names, np.zeros(0)
    fields: dict[str, Any] = {
        "tick": state["tick"], "ready": state["ready"],
        "load": state[model.force_from] if model.force_from else nothing,
        "skin": state[model.skin_from] if model.skin_from else nothing,
        "skin_valid": state[model.skin_valid] if model.skin_valid else nothing,
    }  # fmt: skip
    return views.Scene(*(fields[n] if n in fields else state[getattr(names, n)] for n in views.Scene._fields))


def _own(model: FluxModel, state: Record) -> views.Own:
    return views.Own(*(state[f"{model.name}.{name}"] for name in views.Own._fields))


def _given(model: FluxModel, law: ModelLaw, course: Preview) -> views.Given:
    known = np.array([body is not None for body in course.bodies], np.int64)
    starts = np.array([start is not None for start in model.starts], np.int64)
    played = np.array([curve is not None for curve in model.curves], np.int64)
    start = np.array(
        [
            (*(found or (math.nan,) * 3), temperature)
            for found, temperature in zip(model.starts, model.temperatures, strict=True)
        ]
    )
    return views.Given(
        law.fixed, course.finger, table_of(course.bodies), known, starts, played, model.numbers, model.finger.tissue,
        course.into, start.reshape(-1, 4),
    )  # fmt: skip


def _figures(model: FluxModel, law: ModelLaw, course: Preview) -> views.Figures:
    low, high = model.band
    return views.Figures(
        law.bounds, law.delay, law.ahead, model.again, model.steady, bool(model.heat), float(model.expected),
        float(course.resistance), float(model.press), float(model.period), float(model.dew), float(model.skin),
        float(model.preset_time), float(low), float(high),
        max(DEADBEAT, 1.5 * model.hold * model.period), float(part(model)), float(model.finger.resting_flux),
        float(model.lead), float(model.preset_noise), float(model.current), model.hold,
        float(model.period * model.hold), model.finger_number, first_steps(law.ahead, model.period),
        bool(model.skin_from),
    )  # fmt: skip
