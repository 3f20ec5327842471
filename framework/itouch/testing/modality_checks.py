"""Checks of a modality plugin, in a scene that uses it."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
import math
from typing import Any

import numpy as np

from itouch.loop.contact_report import of_contact
from itouch.plugin import Contact, Modality, Record
from itouch.schema import SceneError
from itouch.schema.fields import Spec, specs, validate, xml_name
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.child_process import apart
from itouch.testing.continuation import attributes, scatter
from itouch.testing.scenario import ModalityHarness
from itouch.testing.workload import touch
from itouch.world import Model
from itouch.world.modalities import ModalityModel


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("declarations", "declared as the contract says")
def declarations(harness: ModalityHarness) -> None:
    """Check ``Params``, ``Material``, ``subscribes_to`` and ``probe_attributes``."""
    cls = harness.cls
    for name, kind in (("Params", getattr(cls, "Params", None)), ("Material", cls.Material)):
        if kind is None and name == "Material":
            continue
        if not (dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen):  # type: ignore[union-attr]
            raise _fail(
                f"{name} is not a frozen dataclass",
                "@dataclass(frozen=True) is missing",
                f"write @dataclass(frozen=True) above {name}",
            )
        assert isinstance(kind, type)  # noqa: S101  (a dataclass)
        bare = [f.name for f in dataclasses.fields(kind) if f.name not in specs(kind)]
        if bare:
            raise _fail(
                f"{name} has fields that are not schema fields: {', '.join(bare)}",
                "plain defaults",
                "make them with itouch.plugin.schema",
            )
    if not set(cls.subscribes_to) <= set(Contact):
        raise _fail(
            f"subscribes_to = {cls.subscribes_to!r}", "not kinds of contact", "a frozenset of itouch.plugin.Contact"
        )
    if not set(cls.probe_attributes) <= {"clearance", "plate-angle"}:
        advice = 'write frozenset({"clearance", "plate-angle"}), or less'
        raise _fail(
            f"probe_attributes = {cls.probe_attributes!r}",
            "not attributes of a probe that say how a surface comes",
            advice,
        )


@check("documentation", "class, parameters, module say what they are")
def documentation(harness: ModalityHarness) -> None:
    """Check that there are docstrings, and a ``doc=`` for every parameter."""
    own = harness.cls.__dict__.get("__doc__")
    if not own or own == Modality.__doc__:
        raise _fail("the modality class has no docstring", "not written yet", "say in a line what it renders")
    silent = [xml_name(name) for name, spec in specs(harness.cls.Params).items() if not spec.doc]
    if silent:
        raise _fail(f"parameters without a word: {', '.join(silent)}", "`doc=` was forgotten", 'write doc="..."')
    module = inspect.getmodule(harness.cls)
    if module is not None and not (module.__doc__ or "").strip():
        raise _fail(f"the module {module.__name__} has no docstring", "not written yet", "say what it is for")


@check("parameters", "every parameter keeps its range")
def parameters(harness: ModalityHarness) -> str:
    """Set every number below and above its range, and validate."""
    engine = harness.engine()
    params = harness.own(engine)[0].params
    count = 0
    for name, spec in specs(type(params)).items():
        count += 1
        if spec.kind == "quantity" and spec.scalar:
            _ranged(params, name, spec)
    return f"{count} parameters"


def _ranged(params: Any, name: str, spec: Spec) -> None:
    for end, beyond in ((spec.low, -1.0), (spec.high, 1.0)):
        value = end + beyond * max(1.0, abs(end))
        if not math.isfinite(end):
            continue
        try:
            validate(dataclasses.replace(params, **{name: value}))
        except (ValueError, SceneError):
            continue
        raise _fail(
            f"{xml_name(name)} = {value:g} {spec.unit} is accepted",
            "the range is not checked",
            "give low= and high= to schema.quantity",
        )


@check("runs", "it runs through a touch; fields stay finite")
def runs(harness: ModalityHarness) -> str:
    """Run the scene, and check fields and commands in every tick."""
    engine = harness.engine()
    owned = harness.own(engine)
    views = [
        (f"{m.name}.{f.name}", engine.state[f"{m.name}.{f.name}"]) for m in owned for f in m.instance.fields(m.model)
    ]
    views = [(name, view) for name, view in views if view.dtype.kind == "f"]
    told = [(f"{device}.{channel}", engine.state[f"{device}.command.{channel}"])
            for m in owned for device, _, channel in (c.partition(".") for c in m.commands)]  # fmt: skip
    for _ in range(round(harness.seconds / engine.model.period)):
        engine.tick()
        for name, view in views:
            if np.isnan(view).any():
                raise _fail(
                    f"the field {name} is NaN after {engine.seconds:.3f} s",
                    "not set in reset(), or a division by zero",
                    "set every field in reset(), and mind what is zero before the first contact",
                )
        for name, view in told:
            if not np.isfinite(view).all():
                raise _fail(
                    f"it commands {name} with {view} after {engine.seconds:.3f} s",
                    "arithmetic before the first contact, or a division by zero",
                    "write a finite command in every update",
                )
    return f"{harness.seconds:.2g} s simulated, with a touch that begins, slides and ends"


@check("state-declared", "everything that changes is in its fields")
def state_declared(harness: ModalityHarness) -> None:
    """Continue in a second engine from a copy of State, here and in a process that knows nothing of the first."""
    straight, again = harness.engine(), harness.engine(seed=8)
    straight.run(0.4 * harness.seconds)
    again.adopt(straight.state.tobytes())
    before = [_attributes(m) for m in harness.own(straight)]
    straight.run(0.6 * harness.seconds)
    again.run(0.6 * harness.seconds)
    if straight.state.tobytes() != again.state.tobytes():
        names = [name for name in straight.state if straight.state[name].tobytes() != again.state[name].tobytes()]
        raise _fail(
            f"after a restore these fields continue differently: {', '.join(names[:4])}",
            "an attribute, a global or the clock decides",
            "declare it in fields() and keep it in state",
        )
    after = [_attributes(m) for m in harness.own(straight)]
    changed = {name for b, a in zip(before, after, strict=True) for name in a if b.get(name, a[name]) != a[name]}
    if changed:
        raise _fail(
            f"{', '.join(sorted(changed))} changes while it runs",
            "State outside of State",
            "declare a field for it; what compile() returns is read-only",
        )
    _in_another_process(harness)


def _in_another_process(harness: ModalityHarness) -> None:
    harness.seconds  # noqa: B018  (computed once, for both processes)
    straight = apart(lambda: _straight(harness), 60.0)
    if straight.kind != "returned":
        raise _fail(straight.text, "it does not work in a child process", "find out what it needs from the process")
    told = json.loads(straight.value)
    restored = apart(lambda: _restored(harness, bytes.fromhex(told["state"])), 60.0)
    if restored.kind != "returned" or json.loads(restored.value)["end"] != told["end"]:
        raise _fail(
            "a session that is restored in a new process continues differently",
            "something that changes is kept in a global, in the class, in a variable of a function, or in a file",
            "declare it in fields() and keep it in state",
        )


def _straight(harness: ModalityHarness) -> bytes:
    scatter(1)
    engine = harness.engine()
    engine.run(0.4 * harness.seconds)
    state = engine.state.tobytes().hex()
    engine.run(0.6 * harness.seconds)
    return json.dumps({"state": state, "end": _digest(engine.state)}).encode()


def _restored(harness: ModalityHarness, state: bytes) -> bytes:
    scatter(2)
    engine = harness.engine(seed=8)
    engine.adopt(state)
    engine.run(0.6 * harness.seconds)
    return json.dumps({"end": _digest(engine.state)}).encode()


def _digest(state: Record) -> str:
    return hashlib.sha256(state.tobytes()).hexdigest()


def _attributes(modality: ModalityModel) -> dict[str, str]:
    found: dict[str, str] = {}
    for owner, thing in (("self", modality.instance), ("model", modality.model)):
        found |= {f"{owner}.{name}": value for name, value in attributes(thing).items()}
    return found


@check("determinism", "equal seeds give equal bytes")
def determinism(harness: ModalityHarness) -> None:
    """Run one engine alone, then two side by side."""
    alone = harness.engine()
    alone.run(harness.seconds)
    one, two = harness.engine(), harness.engine()
    for _ in range(alone.ticks):
        one.tick()
        two.tick()
    if one.state.tobytes() != alone.state.tobytes() or two.state.tobytes() != alone.state.tobytes():
        raise _fail(
            "a second equal run, beside another, ends in other bytes",
            "a shared global, the clock, or random numbers that the seed does not decide",
            "use itouch.plugin.gaussian with words kept in State",
        )


@check("own-fields", "it writes its own fields and commands only")
def own_fields(harness: ModalityHarness) -> None:
    """Compare State before and after its calls, in copies."""
    engine = harness.engine()
    for modality in harness.own(engine):
        commands = {f"{c.partition('.')[0]}.command.{c.partition('.')[2]}" for c in modality.commands}
        for _ in range(60):
            engine.run(harness.seconds / 60)
            _writes(engine.model, engine.state, modality, "update", (f"{modality.name}.", *commands))
            _writes(engine.model, engine.state, modality, "on_contact", (f"{modality.name}.", *commands))
            _writes(engine.model, engine.state, modality, "on_skipped_time", (f"{modality.name}.", *commands))
            for silent in ("measures", "status", "report"):
                _writes(engine.model, engine.state, modality, silent, ())


#: Time [s] that `on_skipped_time` is told a late loop has left out.
_LEFT_OUT = 0.05
#: A value that nothing commands by chance.
_UNLIKELY = 1.2345e-6


def _writes(world: Model, state: Record, modality: ModalityModel, name: str, allowed: tuple[str, ...]) -> None:
    """Make a call on a copy of State, and check what it writes."""
    instance, model, scratch = modality.instance, modality.model, state.copy()
    foreign = [n for n in scratch if ".command." in n and n not in allowed]
    for field in foreign:  # else rewriting the same value would not show
        scratch[field] = _UNLIKELY
    event = touch(world, int(state["tick"]))
    if name == "update":
        instance.update(model, scratch, world.period * modality.every)
    elif name == "on_contact" and event is not None:
        instance.on_contact(event, model, scratch)
    elif name == "on_skipped_time":
        instance.on_skipped_time(model, scratch, _LEFT_OUT)
    elif name == "measures" and event is not None:
        instance.measures(model, scratch, event.probe, event.object_index)
    elif name == "status":
        instance.status(model, scratch)
    elif name == "report":
        instance.report(model, scratch)
    wrong = [
        n
        for n, view in scratch.items()
        if not n.startswith(allowed or "\0")
        and (np.any(view != _UNLIKELY) if n in foreign else view.tobytes() != state[n].tobytes())
    ]
    if wrong:
        raise _fail(
            f"{name} writes into {', '.join(wrong[:4])}",
            "a field of somebody else's"
            if allowed
            else f"{name} is asked now and then, or never, and must change nothing",
            "write only NAME.* and the commands that commands() names, in on_contact, update and on_skipped_time",
        )


@check("uses-given-state", "it works on the State that it is given")
def uses_given_state(harness: ModalityHarness) -> None:
    """Update a copy of State: the original must not change."""
    engine = harness.engine()
    engine.run(0.5 * harness.seconds)
    for modality in harness.own(engine):
        before, scratch = engine.state.tobytes(), engine.state.copy()
        modality.instance.update(modality.model, scratch, engine.model.period * modality.every)
        if engine.state.tobytes() != before:
            raise _fail(
                "update writes into a State that it was given earlier",
                "a view of State that was kept in reset() or on_contact()",
                "look fields up in the state that each call gets",
            )


@check("measures", "what it reports is plain and finite")
def measures(harness: ModalityHarness) -> None:
    """Ask for the figures of a contact, for the words of the live line, and for the report."""
    engine = harness.engine()
    for _ in range(20):
        engine.run(harness.seconds / 20)
        for modality in harness.own(engine):
            instance, model, state = modality.instance, modality.model, engine.state
            for probe in engine.model.probes:
                _plain("measures", instance.measures(model, state, probe.name, 0))
                if wrong := of_contact(modality, state, probe.name, 0).faults:
                    raise _fail(
                        wrong[0],
                        "a key of the report's own, or a value that is not a figure",
                        "return numbers, texts, yes or no, or None, under keys of your own",
                    )
            _plain("report", instance.report(model, state))
            if not isinstance(instance.status(model, state), str):
                raise _fail("status returns no text", "a number or None", "return a few words, or an empty text")


def _plain(what: str, told: Any) -> None:
    try:
        json.dumps(told, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise _fail(
            f"{what} returns {told!r}",
            "a NumPy number, a NaN or an object",
            "return float(x), and None where there is nothing",
        ) from error
    if not isinstance(told, dict):
        raise _fail(f"{what} returns {told!r}", "no dictionary", "return {} where there is nothing to report")


@check("order", "END comes after BEGIN, before the update")
def order(harness: ModalityHarness) -> None:
    """Watch the calls of ``on_contact``."""
    engine = harness.engine()
    modality = harness.own(engine)[0]
    if not modality.instance.subscribes_to:
        raise NotApplicableError("it hears no contact")
    heard: list[int] = []
    instance = modality.instance
    original = instance.on_contact

    def on_contact(event: Any, model: Any, state: Any) -> None:
        heard.append(int(event.kind))
        original(event, model, state)

    try:
        instance.on_contact = on_contact  # type: ignore[method-assign]
    except AttributeError as error:
        raise NotApplicableError("its class has slots") from error
    engine = type(engine)(engine.model)  # another one, which finds it in the place of what may be compiled
    engine.run(harness.seconds)
    touches = [kind for kind in heard if kind in (Contact.BEGIN, Contact.END)]
    both = {Contact.BEGIN, Contact.END} <= modality.instance.subscribes_to  # with only one of them, it repeats
    if both and any(a == b for a, b in zip(touches, touches[1:], strict=False)) and len(engine.model.probes) == 1:
        raise _fail("BEGIN and END do not alternate", "framework", "report it")
    if not heard:
        raise _fail(
            "it hears no event though something is touched",
            "`subscribes_to` names none of the kinds that come",
            "name the kinds that on_contact wants: BEGIN, MOVE, END, NEAR",
        )
