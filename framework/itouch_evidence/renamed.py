"""The same plugins with other names: every channel and field has a random name, and nothing else changes.

Code that goes by roles works with them exactly as with the original plugins; code that goes by a name is found.
Names that the framework gives, and those of devices, probes and objects in the scene, stay.
"""

from __future__ import annotations

import random
import re
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from itouch.joining import is_newest
from itouch.plugin import ContactEvent, ContactFields, Modality, SurfaceFields, World
from itouch.plugin.bound import Bound
from itouch.plugin.channel import Channel
from itouch.plugin.device import Device, Twin, TwinInputs
from itouch.plugin.discovery import Catalog, Found
from itouch.plugin.quantity import Quantity
from itouch.plugin.record import Field, Record

Q = TypeVar("Q", bound=Quantity)


class Renaming:
    """A random word for each name: no two names get the same, and a seed always gives the same words."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._words: dict[str, str] = {}
        self._taken: set[str] = set()

    def __call__(self, name: str) -> str:
        """Return the word for a name."""
        while name not in self._words:
            word = "".join(self._random.choices("abcdefghijklmnopqrstuvwxyz", k=self._random.randint(5, 11)))
            if word not in self._taken:
                self._taken.add(word)
                self._words[name] = word
        return self._words[name]

    def back(self, text: str) -> str:
        """Return a text with every word replaced by the name that it stands for."""
        names = {word: name for name, word in self._words.items()}
        return re.sub(r"[a-z]+", lambda found: names.get(found[0], found[0]), text)

    def of(self, quantities: Sequence[Q]) -> tuple[Q, ...]:
        """Return the same quantities, named by their words."""
        return tuple(replace(one, name=self(one.name)) for one in quantities)


class Relabelled(Record):
    """A record over the memory of another; ``names`` maps the names of fields there to the names here.

    A record that minds how it is looked into, as one of the conformance suite that fails, is asked for each field.
    """

    __slots__ = ("_through", "_names")

    def __init__(self, whole: Record, names: Mapping[str, str]) -> None:
        table: Any = whole.dtype.fields or {}
        kind = {
            "names": [names.get(name, name) for name in whole],
            "formats": [table[name][0] for name in whole],
            "offsets": [table[name][1] for name in whole],
            "itemsize": whole.dtype.itemsize,
        }
        super().__init__(np.dtype(kind) if table else np.dtype([]), whole.raw)  # type: ignore[call-overload]
        for name, view in whole.items():  # the other record's views: read-only where those are
            dict.__setitem__(self, names.get(name, name), view)
        minds = type(whole).__getitem__ is not Record.__getitem__
        self._through = whole.__getitem__ if minds else None
        self._names = {names.get(name, name): name for name in whole} if minds else {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if self._through is not None:
            self._through(self._names.get(name, name))
        return super().__getitem__(name)


class _Labels:
    """Makes relabelled records; the last few are used again as long as the records behind them live."""

    def __init__(self, names: Mapping[str, str]) -> None:
        self._names = names
        self._made: list[tuple[weakref.ref[Record], Relabelled]] = []

    def __call__(self, whole: Record) -> Record:
        for known, made in self._made:
            if known() is whole:
                return made
        if not any(name in self._names for name in whole):
            return whole
        del self._made[:-7]
        made = Relabelled(whole, self._names)
        self._made.append((weakref.ref(whole, self._forget), made))
        return made

    def _forget(self, gone: weakref.ref[Record]) -> None:
        self._made[:] = [pair for pair in self._made if pair[0] is not gone]


def renamed_device(kind: type[Device], words: Renaming) -> type[Device]:
    """Return a device class whose channels, and the fields of its twin, have other names."""

    class Other(kind):  # type: ignore[misc, valid-type]
        """The same device with other names."""

        reads = words.of(kind.reads)
        commands = words.of(kind.commands)
        Twin = None if kind.Twin is None else _renamed_twin(kind.Twin, kind, words)

        def __init__(self, params: Any) -> None:
            super().__init__(params)
            self._inner = _Labels({words(c.name): c.name for group in kind.channels(params) for c in group})

        @classmethod
        def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
            """Return the renamed channels."""
            reads, commands = kind.channels(params)
            return words.of(reads), words.of(commands)

        def read(self, reading: Record) -> bool | None:
            """Read."""
            found: bool | None = super().read(self._inner(reading))
            return found

        def write(self, command: Record) -> None:
            """Write a renamed command."""
            super().write(self._inner(command))

        def make_safe(self, safe: Record) -> None:
            """Make the device safe, from a renamed command."""
            super().make_safe(self._inner(safe))

    _pass_for(Other, kind)
    return Other


def _renamed_twin(kind: type[Twin], cls: type[Device], words: Renaming) -> type[Twin]:
    class Other(Twin):
        """The same twin with other names."""

        def __init__(self, params: Any) -> None:
            super().__init__(params)
            self.twin = kind(params)
            self._command = _Labels({words(c.name): c.name for group in cls.channels(params) for c in group})
            self._state: _Labels | None = None

        def _own(self, state: Record) -> Record:
            if self._state is None:
                self._state = _Labels({words(field.name): field.name for field in self.twin.fields()})
            return self._state(state)

        def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
            """Pass the temperatures on to the twin."""
            self.twin.set_environment(ambient, skin_temperature)

        def fields(self) -> tuple[Field, ...]:
            """Return the fields under their other names."""
            return words.of(self.twin.fields())

        def reset(self, state: Record, rng: np.random.Generator) -> None:
            """Begin."""
            self.twin.reset(self._own(state), rng)

        def position(self, state: Record) -> NDArray[np.float64] | None:
            """Return the true position of what the twin carries."""
            return self.twin.position(self._own(state))

        def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
            """Advance."""
            self.twin.step(self._own(state), self._command(command), touch, period)

        def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound | None:
            """Return the twin's step on these records as one compiled call."""
            return self.twin.bound_step(self._own(state), self._command(command), touch, period)

        def read(self, state: Record, reading: Record) -> bool | None:
            """Read."""
            return self.twin.read(self._own(state), self._command(reading))

        def bound_read(self, state: Record, reading: Record) -> Bound | None:
            """Return the twin's read on these records as one compiled call."""
            if not is_newest(type(self.twin), "bound_read", "read"):
                return None
            return self.twin.bound_read(self._own(state), self._command(reading))

    return Other


def renamed_modality(cls: type[Modality], words: Renaming, known: dict[str, str]) -> type[Modality]:
    """Return a modality class whose fields have other names; ``known`` gets the original name of each."""
    labels = _Labels(known)

    class Other(cls):  # type: ignore[misc, valid-type]
        """The same modality with other names."""

        def compile(self, name: str, params: Any, world: World) -> Any:
            """Compile the element, and keep its name; the fields of others have their own names in State."""
            self._named = name
            fields = {
                one: tuple(_own_name(one, field, known) for field in found) for one, found in world.fields.items()
            }
            return super().compile(name, params, replace(world, fields=fields))

        def fields(self, model: Any) -> tuple[Field, ...]:
            """Return the fields under their other names."""
            found = super().fields(model)
            known.update({f"{self._named}.{words(f.name)}": f"{self._named}.{f.name}" for f in found})
            return words.of(found)

        def surface_fields(self, model: Any) -> SurfaceFields | None:
            """Return the declaration of its surface with the other names of its fields."""
            found: SurfaceFields | None = super().surface_fields(model)
            return found and SurfaceFields(*found[:2], *(name and words(name) for name in found[2:]))

        def contact_fields(self, model: Any) -> ContactFields | None:
            """Return the declaration of its contact with the other names of its fields."""
            found: ContactFields | None = super().contact_fields(model)
            if found is None:
                return None
            touched, force, normal, point, proxy, whole = (name and words(name) for name in found[1:7])
            return ContactFields(found.probe, touched, force, normal, point, proxy, whole, found.add_damping)

        def reset(self, model: Any, state: Record) -> None:
            """Begin."""
            super().reset(model, labels(state))

        def on_contact(self, event: ContactEvent, model: Any, state: Record) -> None:
            """Pass a contact event on, with the renamed state."""
            super().on_contact(event, model, labels(state))

        def on_intermediate_tick(self, model: Any, state: Record) -> None:
            """Do the work between touches on the renamed state."""
            super().on_intermediate_tick(model, labels(state))

        def update(self, model: Any, state: Record, period: float) -> None:
            """Advance."""
            super().update(model, labels(state), period)

        def on_ground_truth(self, model: Any, state: Record, twins: Mapping[str, Record]) -> None:
            """Note the truth of the twins in the renamed state."""
            super().on_ground_truth(model, labels(state), twins)

        def bound_update(self, model: Any, state: Record, period: float) -> Bound | None:
            """Return the update on the renamed state as one compiled call."""
            found: Bound | None = super().bound_update(model, labels(state), period)
            return found

        def measures(self, model: Any, state: Record, probe: str, object_index: int) -> Any:
            """Return the measures from the renamed state."""
            return super().measures(model, labels(state), probe, object_index)

        def status(self, model: Any, state: Record) -> str:
            """Return the status from the renamed state."""
            found: str = super().status(model, labels(state))
            return found

        def report(self, model: Any, state: Record) -> dict[str, Any]:
            """Return the report from the renamed state."""
            found: dict[str, Any] = super().report(model, labels(state))
            return found

    _pass_for(Other, cls)
    return Other


def _own_name(modality: str, field: Field, known: Mapping[str, str]) -> Field:
    """Return a field of a modality with the name that it has where it is not renamed."""
    name = f"{modality}.{field.name}"
    return replace(field, name=known.get(name, name).removeprefix(f"{modality}."))


def _pass_for(other: type, cls: type) -> None:
    """Give a class the name, module and docstring of another one."""
    other.__name__, other.__qualname__ = cls.__name__, cls.__qualname__
    other.__module__, other.__doc__ = cls.__module__, cls.__doc__


class RenamedCatalog(Catalog):
    """A catalog whose plugins have other names for their channels and fields."""

    def __init__(self, seed: int, finder: Callable[[str], dict[str, Found]] | None = None) -> None:
        super().__init__(*(() if finder is None else (finder,)))
        self.words = Renaming(seed)
        self._known: dict[str, str] = {}
        self._made: dict[type, type] = {}

    def device(self, name: str) -> type[Device] | None:
        """Return a device class with other names."""
        cls = super().device(name)
        if cls is not None and cls not in self._made:
            self._made[cls] = renamed_device(cls, self.words)
        return None if cls is None else self._made[cls]

    def modality(self, plugin: str, local: str) -> type[Modality] | None:
        """Return a modality class with other names."""
        cls = super().modality(plugin, local)
        if cls is not None and cls not in self._made:
            self._made[cls] = renamed_modality(cls, self.words, self._known)
        return None if cls is None else self._made[cls]
