"""The simulated observers: those that ship, and those that plugins bring by the entry point ``itouch.observers``.

A plugin's observer is a class that is made without arguments and has ``cue(self, felt)``; it imports nothing of the
framework, which adds here what an observer does with its cues.  It may judge in another way, by methods of its own with
the names of those of `Observer`; ``self.person`` holds the person's noise, memory, lapses and biases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.discovery import find
from itouch.schema import ItouchError
from itouch_tools.study.observers import (
    CombinedObserver,
    Felt,
    FluxObserver,
    NaiveObserver,
    Observer,
    Person,
    ReceptorObserver,
)

GROUP = "itouch.observers"
SHIPPED: Mapping[str, type[Observer]] = {
    "flux": FluxObserver, "combined": CombinedObserver, "receptors": ReceptorObserver, "naive": NaiveObserver,
}  # fmt: skip


class ObserverError(ItouchError, ValueError):
    """An observer that does not exist, can't be loaded, or fails."""


def names() -> Sequence[str]:
    """Return the names of all observers: first the shipped ones, which plugins can't replace."""
    return [*SHIPPED, *(name for name in sorted(find(GROUP)) if name not in SHIPPED)]


def observer_of(name: str) -> type[Observer]:
    """Return the class of an observer.

    Raises
    ------
    ObserverError
        If there is no such observer, or something is wrong with a plugin's; the message says which there are, or what.
    """
    if name in SHIPPED:
        return SHIPPED[name]
    found = find(GROUP).get(name)
    if found is None:
        raise ObserverError(f"there is no observer '{name}'; there are {', '.join(names())}")
    loaded = found.load()
    whose = f"observer '{name}' ({found.distribution} {found.version})"
    if not isinstance(loaded, type) or not callable(getattr(loaded, "cue", None)):
        raise ObserverError(f"{whose} is not a class with a method cue(self, felt)")
    if issubclass(loaded, Observer):
        return loaded
    own = {"__init__": _made(loaded, whose), "cue": _checked(loaded, whose), "__doc__": loaded.__doc__}
    own |= {name: _decides(getattr(loaded, name), name, whose) for name in DECISIONS if hasattr(loaded, name)}
    return type(loaded.__name__, (loaded, Observer), own)


def _made(loaded: Any, whose: str) -> object:
    def init(self: Observer, person: Person) -> None:
        Observer.__init__(self, person)
        if loaded.__init__ is not object.__init__:
            try:
                loaded.__init__(self)
            except Exception as error:  # a plugin's code may raise anything
                raise ObserverError(f"{whose}: making it raised {type(error).__name__}: {error}") from error

    return init


def _decides(own: Any, name: str, whose: str) -> object:
    """Return a plugin's decision method, wrapped: what is not one of the possible answers raises an ObserverError."""
    allowed, what = DECISIONS[name]

    def decide(self: Observer, felt: Any, *rest: Any) -> Any:
        try:
            found = own(self, felt, *rest)
        except ObserverError:  # of its cue, which has its message already
            raise
        except Exception as error:  # a plugin's code may raise anything
            raise ObserverError(f"{whose}: {name} raised {type(error).__name__}: {error}") from error
        if not allowed(found, felt, rest):
            raise ObserverError(f"{whose}: {name} gave {found!r}; it must be {what}")
        return found

    return decide


def _is_place(found: Any, felt: Any, _: Sequence[Any]) -> bool:
    return isinstance(found, int | np.integer) and not isinstance(found, bool) and 0 <= int(found) < len(felt)


#: The decisions that a plugin's observer may make itself, each with a test of its answer and a description of one.
DECISIONS: Mapping[str, tuple[Callable[[Any, Any, Sequence[Any]], bool], str]] = {
    "identify": (
        lambda found, _, rest: isinstance(found, str) and found in rest[0],
        "one of the names that it is given",
    ),
    "colder": (_is_place, "the number of an interval, from 0"),
    "odd": (_is_place, "the number of an interval, from 0"),
    "same": (lambda found, _, __: isinstance(found, bool | np.bool_), "True or False"),
}


def _checked(loaded: type, whose: str) -> object:
    """Return a plugin's ``cue``, wrapped: it gives finite numbers, shape (cues,), or raises an ObserverError."""

    def cue(self: Observer, felt: Felt) -> NDArray[np.float64]:
        try:
            found = np.atleast_1d(np.asarray(loaded.cue(self, felt), np.float64))  # type: ignore[attr-defined]
        except Exception as error:  # a plugin's code may raise anything
            raise ObserverError(f"{whose}: cue raised {type(error).__name__}: {error}") from error
        if found.ndim != 1 or not len(found) or not np.isfinite(found).all():
            raise ObserverError(f"{whose}: cue gave {found.tolist()}; it must be one or more finite numbers")
        return found

    return cue
