"""The compiled calls of a tick, bound to the views of one State: the loop runs them in its plan, Python one by one."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from itouch.plugin import Bound, ContactArrays, ContactEvent, Record
from itouch_thermal.flux import actuation, contact_events, flux_tick, views
from itouch_thermal.flux.curve import Curve
from itouch_thermal.flux.flux_model import FluxModel
from itouch_thermal.flux.flux_tick import PRESS_FILTER
from itouch_thermal.flux.law import Bounds, ModelLaw
from itouch_thermal.flux.preview import Preview, first_steps
from itouch_thermal.heat import table_of

#: The calls that Python has run, by State and model.
_ticks: dict[tuple[int, int], Tick] = {}


def joins(model: FluxModel, state: Record) -> bool:
    """Tell whether a scene's ticks can join: those of `model` without a wire."""
    return model.law is not None and model.preview is not None and not model.wire


def leaves(model: FluxModel) -> bool:
    """Tell whether compiled ticks and events of a touch are left to Python, where all is well and nothing is late."""
    return model.hold > 1 or not model.skin_from or model.maybe_blind


class Tick:
    """What is compiled of a tick, on the views of one State."""

    def __init__(self, model: FluxModel, state: Record) -> None:
        self.model = model
        self._event: ContactArrays | None = None
        self.scene, self.own = _scene(model, state), _own(model, state)
        given, figures = _given(model), _figures(model)
        self._plain = self.scene, self.own, given, figures
        self._commands: dict[int, Bound] = {}
        #: Turns the current into a target, for a driver that holds a temperature.
        self.issued = actuation.bound(model, state, self.scene)
        if model.law is None or model.preview is None:
            self.attend = Bound(flux_tick.attend_and_judge, *self._plain)
            return
        law, course = model.law, _course(model, state)
        models = _models(model, law, model.preview)
        unclear, alone, passes, wait = np.zeros((4, 1), np.int64)
        hold = np.array([model.hold], np.int64)
        self.taken = views.LawInputs(np.ones(1), np.zeros(1), unclear, hold, wait, np.zeros(3), alone, passes)
        self._of_law = *self._plain, course, models
        self._state, self._law = weakref.ref(state), law
        memory = law.memory(state)
        self._hears = *self._of_law, memory, self.taken
        self.begin = Bound(flux_tick.begin, *self._of_law, memory)
        self.attend = Bound(flux_tick.attend, *self._plain)
        self.prepare = Bound(flux_tick.prepare, *self._hears)
        self.track = Bound(flux_tick.track, self.scene, course, models, memory, self.taken, law.coarse_ticks)
        self._commands[0] = Bound(flux_tick.command, *self._hears)
        self.feel_between = Bound(flux_tick.feel_between, self.scene, self.own, figures, models, self.taken)
        self.set_between = Bound(flux_tick.set_between, *self._hears)

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """The whole tick of `model` without a wire; the first call leaves unusual ticks to Python."""
        return (self.begin, self.attend, self.prepare, self.track, self._commands[0], *self.issued)

    def command(self, wait: int) -> Bound:
        """Return the call that commands the display, for a command that leaves in ``wait`` periods."""
        state = self._state()
        if wait not in self._commands and state is not None:
            self._commands[wait] = Bound(flux_tick.command, *self._of_law, self._law.memory(state, wait), self.taken)
        return self._commands[wait]

    def issue(self) -> None:
        """Command the current that stands in the scene's view."""
        for call in self.issued:
            call.run()

    def heard(self, event: ContactArrays) -> Bound:
        """Return the handling of an event as one call, which leaves unusual ones to Python."""
        if self.model.law is None:
            return Bound(contact_events.hear_without_law, event, *self._plain)
        return Bound(contact_events.hear, event, *self._hears)

    def hear(self, event: ContactEvent) -> Bound:
        """Return the same for an event that has happened."""
        return self._hear_numbers(ContactArrays.of(event, self.model.finger_number))

    def _hear_numbers(self, numbers: ContactArrays) -> Bound:
        if self._event is None:
            self._event = ContactArrays._make([np.array(number) for number in numbers])
            self._hear = self.heard(self._event)
        for view, number in zip(self._event, numbers, strict=True):
            view[...] = number
        return self._hear

    def join(self, event: ContactArrays) -> None:
        """Make all calls that Python may run ready now, which takes longer than a tick may.  ``event`` is any."""
        calls = [self.attend, *self.issued, self._hear_numbers(event)]
        if self.model.law is not None:
            calls += [self.begin, self.prepare]
            calls += [] if self.model.wire else [self.track]
            calls += [self.command(wait) for wait in range(1 + self.model.law.wait)]
            calls += [self.feel_between, self.set_between] if self.model.hold > 1 else []
        for call in calls:
            call.join()


def tick_of(model: FluxModel, state: Record) -> Tick:
    """Return the calls on the views of a State, which are made when they are first asked for."""
    key = id(state), id(model)
    found = _ticks.get(key)
    if found is None:
        found = _ticks[key] = Tick(model, state)
        weakref.finalize(state, _ticks.pop, key, None).atexit = False
    return found


def _scene(model: FluxModel, state: Record) -> views.Scene:
    names, current = model.names, model.display.command == "current"
    true_flux = names.true_flux if model.truth else ""
    known = true_flux in state
    named = {
        "load": model.force_from, "skin": model.skin_from, "skin_valid": model.skin_valid, "true_flux": true_flux,
        "true_skin": names.true_skin if known else "", "actual": "" if current else names.actual,
    }  # fmt: skip
    missing: dict[str, Any] = {"heat_desired": np.zeros(1), "bodies": np.zeros((1, 1))}
    given: dict[str, Any] = {"tick": state["tick"], "ready": state["ready"]}
    given["guess"] = np.full(1, math.nan if model.heat and model.law is not None else model.skin)
    given["command"] = state[names.command] if current else np.zeros(1)
    found: list[Any] = []
    for name in views.Scene._fields:
        field = named.get(name, getattr(names, name, ""))
        view = given[name] if name in given else state[field] if field in state else missing.get(name, np.zeros(0))
        if name not in ("command", "guess"):  # as views of foreign State: whatever a rig has, one form is compiled
            view = view.view()
            view.flags.writeable = False
        found.append(view)
    return views.Scene(*found)


def _own(model: FluxModel, state: Record) -> views.OwnFields:
    return views.OwnFields(*(state[f"{model.name}.{name}"] for name in views.OwnFields._fields))


def _course(model: FluxModel, state: Record) -> views.Course:
    return views.Course(*(state[f"{model.name}.{name}"] for name in views.Course._fields))


def _given(model: FluxModel) -> views.Given:
    bodies = model.preview.bodies if model.preview is not None and model.heat else (None,) * len(model.starts)
    known = np.array([body is not None for body in bodies], np.int64)
    starts = np.array([start is not None for start in model.starts], np.int64)
    played = np.array([curve is not None for curve in model.curves], np.int64)
    start = np.array(
        [
            (*(found or (math.nan,) * 3), temperature)
            for found, temperature in zip(model.starts, model.temperatures, strict=True)
        ]
    )
    display = model.display
    pad = np.array((*display.pad, display.area, display.sensor_area))
    return views.Given(
        table_of(bodies), known, starts, played, start.reshape(-1, 4), *_curves(model.curves), model.finger.tissue, pad
    )


def _curves(curves: Sequence[Curve | None]) -> tuple[Any, Any, Any]:
    """Return times and fluxes of all curves, one after the other, and in which rows those of each object are."""
    several = {id(curve): curve for curve in curves if curve is not None}
    lengths = [len(curve.times) for curve in several.values()]
    ends = dict(zip(several, np.cumsum(lengths).tolist(), strict=True))
    rows = [(0, 0) if c is None else (ends[id(c)] - len(c.times), ends[id(c)]) for c in curves]
    times, fluxes = (
        np.concatenate([np.zeros(0), *(getattr(curve, name) for curve in several.values())])
        for name in ("times", "fluxes")
    )
    return times, fluxes, np.array(rows, np.int64).reshape(-1, 2)


def _models(model: FluxModel, law: ModelLaw, course: Preview) -> views.Models:
    return views.Models(
        law.fixed, course.finger, model.numbers, np.array(model.contact.law.numbers), course.into, law.fine.rise
    )


def _figures(model: FluxModel) -> views.Figures:
    (low, high), law, course = model.band, model.law, model.preview
    nothing, contact = Bounds(1, 0.0, 0.0, 0.0), model.contact
    update = model.hold * model.period
    return views.Figures(
        law.bounds if law else nothing, law.delay if law else 0, law.ahead if law else 0, model.again, model.steady,
        bool(model.heat), float(contact.expected), float(contact.at), float(contact.full), float(contact.press),
        contact.steady, float(course.resistance) if course else 0.0, float(model.press), float(model.period),
        float(model.dew), float(model.skin), float(model.preset_time), float(low), float(high),
        float(update / (PRESS_FILTER + update)), float(model.finger.resting_flux), float(model.lead),
        float(model.preset_noise), float(model.current), model.hold, float(model.period * model.hold),
        model.finger_number, first_steps(law.ahead, model.period) if law else 0, model.maybe_blind, model.estimates,
        model.wire, bool(law.believes) if law else False,
    )  # fmt: skip
