"""What a modality plugin must hold to, in a scene that uses it."""

from __future__ import annotations

import copy
import dataclasses
import gc
import inspect
import json
import math
import tracemalloc
from typing import Any

import numpy as np

from itouch.loop import Engine
from itouch.plugin import Contact, Modality
from itouch.plugin.discovery import Catalog
from itouch.schema.fields import specs, xml_name
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.subject import ModalitySubject
from itouch.world import Model
from itouch.world.modalities import ModalityModel


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


def _engine(subject: ModalitySubject, seed: int = 4) -> Engine:
    return Engine(Model.of(subject.without_record(), Catalog()), seed=seed)


def _own(engine: Engine, subject: ModalitySubject) -> list[ModalityModel]:
    found = [m for m in engine.model.modalities if isinstance(m.instance, subject.cls)]
    if not found:
        raise _fail(
            f"the scene does not use {subject.cls.__name__}",
            "its element is missing under <interaction>",
            "write <NAME:local .../> there",
        )
    return found


@check("declarations", "parameters, hears and material are declared as the contract says")
def declarations(subject: ModalitySubject) -> None:
    """Look at ``Params``, ``Material`` and ``hears``."""
    cls = subject.cls
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
                f"{name} has fields that are no grammar: {', '.join(bare)}",
                "plain defaults",
                "make them with itouch.plugin.schema",
            )
    if not set(cls.hears) <= set(Contact):
        raise _fail(f"hears = {cls.hears!r}", "not kinds of contact", "a frozenset of itouch.plugin.Contact")


@check("documentation", "the class, its parameters and its module say what they are")
def documentation(subject: ModalitySubject) -> None:
    """Look for docstrings."""
    own = subject.cls.__dict__.get("__doc__")
    if not own or own == Modality.__doc__:
        raise _fail("the modality class has no docstring", "not written yet", "say in a line what it renders")
    silent = [xml_name(name) for name, spec in specs(subject.cls.Params).items() if not spec.doc]
    if silent:
        raise _fail(f"parameters without a word: {', '.join(silent)}", "`doc=` was forgotten", 'write doc="..."')
    module = inspect.getmodule(subject.cls)
    if module is not None and not (module.__doc__ or "").strip():
        raise _fail(f"the module {module.__name__} has no docstring", "not written yet", "say what it is for")


@check("runs", "it runs in its scene without a fault, and its fields stay finite")
def runs(subject: ModalitySubject) -> str:
    """Run the scene."""
    engine = _engine(subject)
    owned = _own(engine, subject)
    engine.run(subject.seconds)
    for modality in owned:
        for field in modality.instance.fields(modality.model):
            view = engine.state[f"{modality.name}.{field.name}"]
            if view.dtype.kind == "f" and np.isnan(view).any():
                raise _fail(
                    f"the field {modality.name}.{field.name} is NaN",
                    "not set in reset(), or a division by zero",
                    "set every field in reset()",
                )
        for command in modality.commands:
            device, _, channel = command.partition(".")
            if not np.isfinite(engine.state[f"{device}.command.{channel}"]).all():
                raise _fail(
                    f"it commands {command} with NaN",
                    "arithmetic before the first contact",
                    "write a finite command in every update",
                )
    return f"{subject.seconds:g} s simulated"


@check("state-declared", "everything that changes is in its declared fields")
def state_declared(subject: ModalitySubject) -> None:
    """Go on in a second engine from copied State; watch attributes."""
    straight, again = _engine(subject), _engine(subject, seed=8)
    straight.run(0.4 * subject.seconds)
    again.adopt(straight.state.tobytes())
    before = [_attributes(m) for m in _own(straight, subject)]
    straight.run(0.6 * subject.seconds)
    again.run(0.6 * subject.seconds)
    if straight.state.tobytes() != again.state.tobytes():
        names = [name for name in straight.state if straight.state[name].tobytes() != again.state[name].tobytes()]
        raise _fail(
            f"after a restore these fields go on otherwise: {', '.join(names[:4])}",
            "an attribute, a global or the clock decides",
            "declare it in fields() and keep it in state",
        )
    after = [_attributes(m) for m in _own(straight, subject)]
    changed = {name for b, a in zip(before, after, strict=True) for name in a if b.get(name) != a[name]}
    if changed:
        raise _fail(
            f"{', '.join(sorted(changed))} changes while it runs",
            "State outside of State",
            "declare a field for it; what compile() returns is read-only",
        )


def _attributes(modality: ModalityModel) -> dict[str, str]:
    found = {}
    for owner, thing in (("self", modality.instance), ("model", modality.model)):
        for name, value in getattr(thing, "__dict__", {}).items():
            if callable(value):
                continue
            try:
                found[f"{owner}.{name}"] = repr(copy.deepcopy(value))
            except Exception:  # what can't be copied can't be compared
                continue
    return found


@check("determinism", "equal seeds give equal bytes")
def determinism(subject: ModalitySubject) -> None:
    """Run twice."""
    one, two = _engine(subject), _engine(subject)
    one.run(subject.seconds)
    two.run(subject.seconds)
    if one.state.tobytes() != two.state.tobytes():
        raise _fail(
            "two equal runs end in other bytes",
            "the clock, or random numbers that the seed does not decide",
            "use itouch.plugin.gaussian with words kept in State",
        )


@check("own-fields", "it writes its own fields and commands, and nothing else")
def own_fields(subject: ModalitySubject) -> None:
    """Compare State before and after each update."""
    engine = _engine(subject)
    engine.run(0.3 * subject.seconds)
    for modality in _own(engine, subject):
        allowed = tuple(
            {f"{modality.name}.", *(f"{c.partition('.')[0]}.command.{c.partition('.')[2]}" for c in modality.commands)}
        )
        for _ in range(20):
            before = {name: view.copy() for name, view in engine.state.items()}
            modality.instance.update(modality.model, engine.state, engine.model.period * modality.every)
            wrong = [
                n
                for n, view in engine.state.items()
                if not n.startswith(allowed) and view.tobytes() != before[n].tobytes()
            ]
            if wrong:
                raise _fail(
                    f"update writes into {', '.join(wrong)}",
                    "a field of somebody else's",
                    "write only NAME.* and the commands that commands() names",
                )
            engine.tick()


@check("allocates-nothing", "no memory is gathered from tick to tick")
def allocates_nothing(subject: ModalitySubject) -> str:
    """Compare what is allocated after many updates."""
    engine = _engine(subject)
    engine.run(0.3 * subject.seconds)
    modality = _own(engine, subject)[0]
    period = engine.model.period * modality.every
    for _ in range(300):
        modality.instance.update(modality.model, engine.state, period)
    gc.collect()
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(1000):
            modality.instance.update(modality.model, engine.state, period)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    grown = (after - before) / 1000
    if grown > 12.0:
        raise _fail(
            f"memory grows by {grown:.0f} bytes an update",
            "a list that is appended to, or a log",
            "keep what must be kept in State, which has a fixed size",
        )
    return f"{grown:.1f} bytes an update"


@check("measures", "what it tells of a contact is plain and finite")
def measures(subject: ModalitySubject) -> None:
    """Ask for the measures of a contact."""
    engine = _engine(subject)
    engine.run(subject.seconds)
    for modality in _own(engine, subject):
        for probe in engine.model.probes:
            told = modality.instance.measures(modality.model, engine.state, probe.name, 0)
            try:
                json.dumps(told, allow_nan=False)
            except (TypeError, ValueError) as error:
                raise _fail(
                    f"measures returns {told!r}",
                    "a NumPy number, a NaN or an object",
                    "return float(x), and None where there is nothing",
                ) from error
            _finite(told)


def _finite(told: dict[str, Any]) -> None:
    for key, value in told.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise _fail(f"measures['{key}'] is {value}", "no contact yet", "return None where there is nothing")


@check("order", "contact events come before the update of their tick, END after BEGIN")
def order(subject: ModalitySubject) -> None:
    """Watch the calls of the instance."""
    engine = _engine(subject)
    modality = _own(engine, subject)[0]
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
    engine.run(subject.seconds)
    touches = [kind for kind in heard if kind in (Contact.BEGIN, Contact.END)]
    if any(a == b for a, b in zip(touches, touches[1:], strict=False)) and len(engine.model.probes) == 1:
        raise _fail("BEGIN and END do not alternate", "framework", "report it")
    if not heard and subject.cls.hears:
        raise NotApplicableError("nothing is touched in the scene: it can't be seen whether events are heard")
