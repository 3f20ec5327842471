"""One touch on the twins: run the scene of a condition, and keep what the twin's finger felt.

Each touch is a session of its own from the scene's start, so that it depends only on condition, finger and seed: a
study that was stopped goes on with the same touches, on any number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from itouch.loop import DeviceFaultError
from itouch.loop.contact_report import figures_of
from itouch.plugin import Measured, Role
from itouch.plugin.discovery import Catalog
from itouch.scene.edits import Edit
from itouch.scene.source import Attribute
from itouch.schema import ItouchError, Place
from itouch.session import Session
from itouch.world import Model, declared
from itouch.world.skin_source import sensed_skin
from itouch_tools.study.machine import Machine, Phase, Rules, Sensed
from itouch_tools.study.observers import DEPTH, Felt
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_elements import Study, Touching
from itouch_tools.study.touch_figures import BACK, DROP, FLUX, FORCE, OWN, SKIN

#: Thermal diffusivity of skin [m2/s]: the square of the conductivity, 0.37 W/mK, over the effusivity, 1167 W s^.5/m2K.
DIFFUSIVITY = 1.005e-7
#: Time [s] between two samples of what is felt.
SAMPLING = 0.01


#: The step [m] of a hand that waits.
STILL = (0.0, 0.0, 0.0)


class TouchError(ItouchError):
    """A scene in which nothing can be felt."""


@dataclass(frozen=True, slots=True)
class Presented:
    """A touch that was made: what was felt, its entry in the report, and why it does not count (empty: it does).

    ``kept`` are the keys of that entry which say how well it was rendered; ``told`` are its figures by role, where the
    true values are not known.  ``back``: whether the skin was back at its baseline before; None: unknown.
    """

    felt: Felt
    figures: Mapping[str, Any]
    void: str
    kept: tuple[str, ...] = (FORCE.key,)
    told: Mapping[Role, Any] = field(default_factory=dict)
    back: bool | None = None


def deep_temperature(skin: np.ndarray[Any, np.dtype[np.float64]], period: float, depth: float = DEPTH) -> Any:
    """Return the temperature [K] at a depth [m] below a surface with the temperatures ``skin`` [K], shape (samples,).

    The skin is a half-space, at first in equilibrium with the first sample: each step of the surface's temperature
    arrives as erfc(x / (2 sqrt(a t))).
    """
    steps = np.diff(skin, prepend=skin[:1])
    times = (np.arange(len(skin)) + 0.5) * period
    answer = np.array([math.erfc(depth / (2.0 * math.sqrt(DIFFUSIVITY * t))) for t in times])
    return skin[0] + np.convolve(steps, answer)[: len(skin)]


class TouchRunner:
    """Makes touches of a study's conditions; the model of each condition is compiled once."""

    def __init__(self, file: StudyFile, catalog: Catalog, *, skin_temperature: float | None = None) -> None:
        self._file, self._catalog = file, catalog
        self._own = [] if skin_temperature is None else [_skin(file, skin_temperature)]
        self._models: dict[tuple[tuple[str, str], ...], Model] = {}

    def model(self, condition: Mapping[str, str]) -> Model:
        """Return the compiled scene of a condition; it is kept for the next touch, unless a staircase sets a level."""
        key = tuple(sorted(condition.items()))
        model = self._models.get(key)
        if model is None:
            model = self._file.model(condition, self._catalog, self._own)
            if not any(one.name in condition for one in self._file.study.staircases):
                self._models[key] = model
        return model

    def touch(self, condition: Mapping[str, str], seed: int) -> Presented:
        """Run a trial up to the end of its touch, which the scene's scripted hand makes, and return the touch.

        As in a session with a person the hand waits for the signal: until the plate is ready, or until ``<blind>``'s
        time is over.

        Raises
        ------
        TouchError
            If no twin of the scene feels heat, a device is no twin, or nothing moves the finger.
        """
        model = self.model(condition)
        feeling = IntervalRecorder(model, self._file.study.contact, felt_by(model))
        session = Session(model, seed=seed, catalog=self._catalog)
        session.records = False
        if not session.scripted:
            raise TouchError(
                "nothing moves a finger in this scene: simulated observers need an <operator> with a <motion>"
            )
        feeling.listen(session)
        machine = Machine(rules_of(self._file.study, feeling.index, 1, None))

        def stepped(before: Phase) -> bool:
            return machine.step(feeling.sensed(session)) is not before

        fault = ""
        try:
            if not bool(session.state["ready"]):  # the rig finds its heights by touch
                session.run(until=lambda: bool(session.state["ready"]) or session.done)
                if not bool(session.state["ready"]):
                    machine.fail("the motion was over before the rig had found its heights")
            steer_hands(session, STILL)
            while machine.phase not in (Phase.JUDGE, Phase.PAUSE):
                session.run(until=partial(stepped, machine.phase))
                if machine.phase is Phase.GO:
                    steer_hands(session, None)
        except DeviceFaultError as error:
            fault = f"fault: {error}"
        made = feeling.presented(session, fault or machine.void)
        session.close()
        return made


def rules_of(study: Study, index: int, intervals: int, baseline: float | None) -> Rules:
    """Return the rules of a study's trials, for the object with this index and a skin with this baseline [K]."""
    contact, blind = study.contact, study.blind
    equal = blind is not None and blind.equalise
    return Rules(
        index, intervals, baseline, contact.skin_return, contact.skin_wait,
        blind.approach if blind is not None and equal else 0.0, equal, contact.ready_wait, contact.reach,
        pause=contact.pause,
    )  # fmt: skip


def steer_hands(session: Session, step: tuple[float, float, float] | None) -> None:
    """Lead all hands of twins by a step [m] (`STILL`: they wait on their paths); None lets them follow their paths."""
    for probe in session.steerable:
        session.steer(probe, step)


class IntervalRecorder:
    """Notes what is felt in one interval, and says what a trial's machine is told of it, tick by tick."""

    def __init__(self, model: Model, rules: Touching, truth: tuple[str, str] | None) -> None:
        self._rules, self._truth, self._model = rules, truth, model
        self.index = next(i for i, each in enumerate(model.scene.world.objects) if each.name == rules.object_)
        self._every = max(1, round(SAMPLING / model.period))
        self._samples: list[tuple[int, float, float]] = []
        self._skin = sensed_skin(model, model.probes[0]) if model.probes else None
        self._ready = ""

    @property
    def measures_skin(self) -> bool:
        """Whether anything measures the skin's temperature."""
        return self._skin is not None

    def listen(self, session: Session) -> None:
        """Note what the twin's finger feels from now on."""
        state, probe = session.state, session.model.probes[0].name
        self._current = state[f"{probe}.contact.object"]
        fields = declared(self._model).values()
        self._ready = next((field.name for field in fields if field.role is Role.READY), "")
        if self._truth is None:
            return
        flux, skin = (state[name] for name in self._truth)
        samples, every, current = self._samples, self._every, self._current

        def sample(tick: int) -> None:
            if tick % every == 0:
                samples.append((int(current), float(flux), float(skin)))

        session.taps.append(sample)

    def sensed(self, session: Session) -> Sensed:
        """Return what the machine is told of the last tick."""
        state, skin = session.state, None
        if self._skin is not None:
            valid = self._skin.valid
            skin = state[self._skin.field].item() if not valid or bool(state[valid].item()) else None
        ready = not self._ready or bool(state[self._ready])
        return Sensed(session.seconds, skin, ready, self._current.item(), session.done)

    def presented(self, session: Session, void: str) -> Presented:
        """Return the touch that has ended, and why it does not count."""
        report = session.report()
        period = self._every * session.model.period
        return _presented(
            self._samples, self.index, report, self._rules, figures_of(session.model, report["contacts"]), period, void
        )


def figures(touch: Presented) -> dict[str, Any]:
    """Return the figures that are kept of a touch: what was felt, and how well it was rendered."""
    felt, entry = touch.felt, touch.figures
    known = len(felt.flux) > 0 or not entry
    kept = {
        FLUX.key: round(felt.mean_flux(), 6) if known else touch.told.get(Role.HEAT_FLUX),
        SKIN.key: round(float(felt.skin[0]) - 273.15, 6) if len(felt.skin) else None,
        BACK.key: touch.back,
        DROP.key: (
            round(float(felt.skin[0] - felt.skin[-1]), 6) if len(felt.skin) else touch.told.get(Role.SKIN_TEMPERATURE)
        ),
    }
    for name in touch.kept:
        if name in entry:
            kept[name] = entry[name]
    return kept


def _skin(file: StudyFile, temperature: float) -> Edit:
    """Return the edit that gives the operator twin a person's skin temperature [K]."""
    return Edit("operator.skin-temperature", Attribute(f"{temperature:.3f} K", Place(file.path, 1, 1)))


def felt_by(model: Model) -> tuple[str, str]:
    """Return the names of the fields of State with the true flux out of the finger and its skin's true temperature.

    Raises
    ------
    TouchError
        If a device is no twin, or no twin declares them.
    """
    found: dict[Role, str] = {}
    for name, device in model.devices.items():
        if not device.twin:
            raise TouchError(f"'{name}' is not a twin; simulated observers feel what twins' fingers feel")
        for one in device.make_twin().fields():
            if one.role in (Role.HEAT_FLUX, Role.SKIN_TEMPERATURE):
                found.setdefault(one.role, f"{name}.twin.{one.name}")
    if len(found) < 2:
        raise TouchError("no twin of this scene says what a finger feels: none declares a true flux and a true skin")
    return found[Role.HEAT_FLUX], found[Role.SKIN_TEMPERATURE]


def _presented(
    samples: list[tuple[int, float, float]], index: int, report: dict[str, Any], rules: Touching,
    measured: Sequence[Measured], period: float, fault: str,
) -> Presented:  # fmt: skip
    touched = [k for k, (current, _, _) in enumerate(samples) if current == index]
    entries = [entry for entry in report["contacts"] if entry["object"] == rules.object_]
    nothing = Felt(np.zeros(0), np.zeros(0), np.zeros(0), period)
    if not entries or (samples and not touched):
        return Presented(nothing, {}, fault or "nothing was touched")
    own = {one.key for one in OWN}
    kept = (FORCE.key, *(one.key for one in measured if one.key not in own and _tells(one)))
    if not samples:  # what was truly felt is not known: the report's figures are taken for it
        told = {one.role: entries[0].get(one.key) for one in reversed(measured)}
        return Presented(nothing, entries[0], fault or _broken(entries[0], rules, measured), kept, told)
    first, last = touched[0], touched[-1]
    flux = np.array([s[1] for s in samples[first : last + 1]])
    skin = np.array([s[2] for s in samples[max(0, first - 1) : last + 1]])[: len(flux)]
    entry = entries[0]
    felt = Felt(flux, skin, deep_temperature(skin, period), period)
    return Presented(felt, entry, fault or _broken(entry, rules, measured), kept)


def _broken(entry: Mapping[str, Any], rules: Touching, measured: Sequence[Measured]) -> str:
    """Return a sentence on the rule that a touch broke; empty: none."""
    end = entry["end_s"]
    if end is None or end - entry["begin_s"] < rules.duration:
        return "released early"
    if rules.force is not None and abs(entry["peak_force_N"] - rules.force) > rules.tolerance:
        return f"force {entry['peak_force_N']:.2f} N was out of the window"
    for one in measured:
        if one.violated_by(entry.get(one.key)):
            return one.failure_reason
    for one in measured:
        error = entry.get(one.key) if one.relative_error else None
        if error is not None and error > rules.flux_error:
            return f"{one.title or one.key} {100.0 * error:.0f} %"
    return ""


def _tells(one: Measured) -> bool:
    """Tell whether a figure is kept for each touch: those shown of a contact, and those that decide if it counts."""
    return not one.show or one.percent or one.relative_error or one.required_value is not None
