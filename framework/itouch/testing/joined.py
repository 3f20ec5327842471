"""Checks that what a plugin offers compiled does the same to the byte as its Python, whatever it meets.

Both forms go through a run, and begin at States, commands, inputs and contact events that are drawn at random.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.joining import can_join, is_newest
from itouch.loop import Engine
from itouch.loop.write_access import view_for
from itouch.plugin import Bound, Contact, Field, Modality, Record
from itouch.testing.checks import NotApplicableError, check
from itouch.testing.draws import INPUTS, Happening, States, draw_inputs
from itouch.testing.harness import PERIOD, DeviceHarness, TwinBench
from itouch.testing.scenario import ModalityHarness
from itouch.testing.two_forms import ImplausibleError, Kinds, Sides, TwoForms, unequal
from itouch.world import Model
from itouch.world.modalities import ModalityModel
from itouch.world.state import layout

#: How many States are drawn, and the seed of the draws.
_DRAWS, _SEED = 800, 11
#: Most calls that follow one another from a State that was drawn.
_BURST = 4
#: From how many States of a modality's run others are drawn.
_KEPT = 200
#: Fields of State that are the session's own: its time and its seed are not drawn by themselves.
_SESSION = frozenset({"tick", "seed"})


def _need_joining() -> None:
    if not can_join():
        raise NotApplicableError("nothing can be joined here: compiling is switched off, or there is no clock for it")


def _need_both(forms: Iterable[TwoForms]) -> None:
    if not any(one.offered for one in forms):
        raise NotApplicableError("it is plain Python, or its Python is newer than what would join")


def _calls(bound: Bound | tuple[Bound, ...] | None) -> tuple[Bound, ...]:
    return (bound,) if isinstance(bound, Bound) else tuple(bound or ())


def _draw_all(forms: Sequence[TwoForms], burst: Callable[[str], None]) -> str:
    """Make all draws; return in words how many States there were, and which form was never used."""
    implausible = 0
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # also a division by zero may follow from what was drawn
        for draw in range(_DRAWS):
            try:
                burst(f"in draw {draw} of seed {_SEED}")
            except ImplausibleError:
                implausible += 1
    unused = [one.name for one in forms if one.offered and not one.compared]
    left = f", {' and '.join(unused)} always left to Python" if unused else ""
    return f"{_DRAWS - implausible} random States{left}"


@check("joined", "what is compiled does what it does in Python")
def twin(harness: DeviceHarness) -> str:
    """Let two twins step and read alike, one in Python and one compiled."""
    _need_joining()
    one, other = harness.bench(), harness.bench()
    one.drive()
    other.drive()  # a finger is attached
    sides = Sides(_given(one), _given(other))
    forms = (_step(one, other, sides), _read(one, other, sides))
    _need_both(forms)
    rng, ticks = np.random.default_rng(_SEED), 1500
    states = States(rng)
    for tick in range(ticks):
        one.tick = tick
        one.drive()
        if tick % 50 == 49:
            _shake(one.state, rng)
        sides.level()
        for form in forms:
            form.run(f"at tick {tick}")
        if tick % 10 == 0:
            states.keep(one.state)
    states.free(one.twin.fields(), set(one.state), one.state)

    def burst(draw: str) -> None:
        states.draw(one.state)
        draw_inputs(one, rng)
        one.reading.numbers[:] = rng.normal(size=one.reading.numbers.size)
        sides.level()
        for _ in range(rng.integers(1, _BURST + 1)):
            for form in forms:
                form.run(draw, drawn=True)

    return f"{ticks} ticks, shaken {ticks // 50} times; {_draw_all(forms, burst)}"


def _given(bench: TwinBench) -> Kinds:
    """Return all that a twin is given."""
    inputs = {name: getattr(bench.touch, name) for name in INPUTS}
    return (("field", bench.state), ("reading", bench.reading), ("command", bench.command), ("input", inputs))


def _step(one: TwinBench, other: TwinBench, sides: Sides) -> TwoForms:
    joins = is_newest(type(other.twin), "bound_step", "step")
    bound = other.twin.bound_step(other.state, other.command, other.touch, PERIOD) if joins else None
    return TwoForms("step", _calls(bound), lambda: one.twin.step(one.state, one.command, one.touch, PERIOD), sides)


def _read(one: TwinBench, other: TwinBench, sides: Sides) -> TwoForms:
    joins = is_newest(type(other.twin), "bound_read", "read")
    bound = other.twin.bound_read(other.state, other.reading) if joins else None
    return TwoForms("read", _calls(bound), lambda: one.twin.read(one.state, one.reading), sides)


def _shake(state: Record, rng: np.random.Generator) -> None:
    """Change all numbers of a State at random by a few per cent."""
    for view in state.values():
        if view.dtype == np.float64:
            view *= rng.uniform(0.97, 1.03, view.shape)


class _Pair:
    """A modality with two copies of State: in one it updates and hears in Python, in the other compiled."""

    def __init__(self, model: Model, state: Record, own: ModalityModel, rng: np.random.Generator) -> None:
        self._model, self._state, self._own, self._rng = model, state, own, rng
        self._python, self._compiled = state.copy(), state.copy()
        self._sides = Sides(self._sorted(self._python), self._sorted(self._compiled))
        #: As the loop gives them: also the types of what is compiled are the same then, and nothing is compiled anew.
        self._views = view_for(own, self._python), view_for(own, self._compiled)
        self._event = Happening(model, rng)
        self._update, self._hear = self._updating(), self._hearing()
        self.forms = [one for one in (self._update, self._hear) if one.offered]

    def _sorted(self, state: Record) -> Kinds:
        """Return a State, of which a finding names first what the modality writes."""
        own = {name: state[name] for name in self._fields() if name in state}
        return (("field", own), ("field", state))

    def _fields(self) -> list[str]:
        own = self._own
        commands = (".command.".join(name.split(".", 1)) for name in own.commands)
        return [*(f"{own.name}.{field}" for field in own.fields), *commands]

    def _updating(self) -> TwoForms:
        own, instance, period = self._own, self._own.instance, self._model.period * self._own.every
        bound = None
        if (own.every == 1 or not own.uses_intermediate_ticks) and _joins(instance, "bound_update", "update"):
            bound = instance.bound_update(own.model, self._views[1], period)
        python = lambda: instance.update(own.model, self._views[0], period)  # noqa: E731
        return TwoForms("update", _calls(bound), python, self._sides)

    def _hearing(self) -> TwoForms:
        own, instance, event = self._own, self._own.instance, self._event
        bound = None
        if instance.subscribes_to and _joins(instance, "bound_contact", "on_contact", "subscribes_to"):
            bound = instance.bound_contact(own.model, self._views[1], event.numbers)

        def python() -> None:
            if event.numbers.kind[0] in instance.subscribes_to:  # the loop tells it of nothing else
                instance.on_contact(event.heard(), own.model, self._views[0])

        return TwoForms("on_contact", _calls(bound), python, self._sides)

    def free(self, states: States) -> None:
        """Let what it writes or reads be drawn by itself, most often what it writes or its compiled form is given."""
        own, reads = set(self._fields()), self._own.instance.reads(self._own.model)
        given = [one for form in self.forms for bound in form.bounds for one in _arrays(bound.arguments)]
        own |= {name for name, view in self._compiled.items() if any(np.may_share_memory(view, one) for one in given)}
        chosen: list[Field] = [
            field
            for field in layout(self._model)
            if field.name in own
            or (field.name not in _SESSION and (reads is None or any(fnmatchcase(field.name, one) for one in reads)))
        ]
        states.free(chosen, own, self._state)

    def burst(self, states: States, draw: str) -> None:
        """Draw a State, and let some updates and events follow one another from there, both ways."""
        states.draw(self._python)
        self._sides.level()
        for _ in range(self._rng.integers(1, _BURST + 1)):
            if (hears := self._own.instance.subscribes_to) and self._rng.random() < 0.5:
                self._event.draw(hears, int(self._python["tick"]))
                self._hear.run(f"{draw}, of {self._event.said}", drawn=True)
            else:
                self._update.run(draw, drawn=True)
                self._python["tick"] += 1
                self._sides.level()


def _arrays(arguments: Iterable[object]) -> Iterator[NDArray[Any]]:
    for one in arguments:
        if isinstance(one, np.ndarray):
            yield one
        elif isinstance(one, tuple):
            yield from _arrays(one)


def _joins(instance: Modality, bound: str, *alone: str) -> bool:
    """Tell whether the loop takes what is bound in place of a method: no subclass, nor the instance, overrides that."""
    own = set(getattr(instance, "__dict__", ()))
    return not own & set(alone) and all(is_newest(type(instance), bound, one) for one in alone)


@check("joined", "what is compiled does what it does in Python")
def modality(harness: ModalityHarness) -> str:
    """Run the scene both ways; then let it update and hear both ways from random States."""
    _need_joining()
    engine, rng = harness.engine(), np.random.default_rng(_SEED)
    pairs = [_Pair(engine.model, engine.state, one, rng) for one in harness.own(engine)]
    _need_both(form for pair in pairs for form in pair.forms)
    states = States(rng)
    notes = [_followed(harness, engine, states)]
    for pair in pairs:
        pair.free(states)
        notes.append(_draw_all(pair.forms, partial(pair.burst, states)))
    return "; ".join(notes)


def _followed(harness: ModalityHarness, engine: Engine, states: States) -> str:
    """Run an engine beside one whose modality runs in Python; keep States of the run, among them each with an event."""
    other, ticks = _in_python(harness), round(harness.seconds / engine.model.period)
    sides = Sides((("field", other.state),), (("field", engine.state),)) if other is not None else None
    count, before = engine.state["events.count"], engine.state.copy()
    for tick in range(ticks):
        told = int(count)
        before.raw[:] = engine.state.raw
        engine.tick()
        if tick % max(1, ticks // _KEPT) == 0 or int(count) != told:
            states.keep(before)
            states.keep(engine.state)
        if other is None or sides is None:
            continue
        other.tick()
        if found := sides.differ():
            kinds = engine.state["events.table"]["kind"]
            names = [Contact(kinds[one % kinds.size]).name for one in range(told, int(count))]
            raise unequal(f"{found}, at tick {tick}" + (f", in which {' and '.join(names)} happened" if names else ""))
    return f"{ticks} ticks" if other is not None else "no subclass of it runs in Python"


def _in_python(harness: ModalityHarness) -> Engine | None:
    """Return an engine of the scene that runs the modality in Python; None: its class can not be replaced."""
    engine = harness.engine()
    for one in harness.own(engine):
        cls = type(one.instance)
        own = {"__slots__": (), "__module__": cls.__module__, "update": cls.update, "on_contact": cls.on_contact}
        try:  # an heir that overrides both has its own update, which the loop takes then
            object.__setattr__(one.instance, "__class__", type(cls.__name__, (cls,), own))
        except Exception:  # a plugin may forbid it
            return None
    return type(engine)(engine.model, seed=4)
