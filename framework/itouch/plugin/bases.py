"""Bases that an eigen-solve made: kept with a session and used again, because a solve may round otherwise elsewhere.

A plugin wraps each solve in ``kept``.  Where no scene is compiled that only calls it; where one is, the result is noted
by the digest of what it was made from, and a restored session gets the stored arrays instead of a new solve.  What no
session has stored may have been found by an earlier start on this machine (see ``result_cache``).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import result_cache

Array = NDArray[np.float64]
Arrays = tuple[Array, ...]
T = TypeVar("T")
Load: TypeAlias = Callable[[Arrays], T]


class Bases:
    """The bases of one session: ``stored`` ones are used, and ``used`` has all that the session needed."""

    def __init__(self, stored: Mapping[str, Arrays] | None = None) -> None:
        self.stored = dict(stored or {})
        self.used: dict[str, Arrays] = {}
        self._made: dict[str, Any] = {}

    def take(self, content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Load[T]) -> T:
        """Return what belongs to a content: loaded from what is stored, or found on disk, or made."""
        key = hashlib.sha256(repr(content).encode()).hexdigest()[:32]
        if key not in self._made:
            stored = self.stored.get(key)
            if stored is None:
                self._made[key], self.used[key] = _found(content, make, pack, load)
            else:
                self._made[key], self.used[key] = load(stored), stored
        made: T = self._made[key]
        return made


def _found(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Load[T]) -> tuple[T, Arrays]:
    """Return the result of a solve and its arrays: from the shelf on disk, or from a new solve that is put there."""
    name = result_cache.key(content, make)
    arrays = None if name is None else result_cache.read(name)
    if arrays is not None:
        with suppress(ValueError):  # it does not fit together: as good as none
            return load(arrays), arrays
    made = make()
    arrays = pack(made)
    if name is not None:
        result_cache.write(name, arrays)
    return made, arrays


_OPEN: ContextVar[Bases | None] = ContextVar("bases", default=None)


@contextmanager
def keeping(bases: Bases) -> Iterator[Bases]:
    """Note, or take from ``bases``, all that is built inside."""
    token = _OPEN.set(bases)
    try:
        yield bases
    finally:
        _OPEN.reset(token)


@contextmanager
def keeping_anyhow() -> Iterator[None]:
    """Look up what is found inside among what earlier builds have found, also where no session notes it."""
    if _OPEN.get() is not None:
        yield
        return
    with keeping(Bases()):
        yield


def kept(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
    """Return the result of a solve, or what a session stored of it.

    Parameters
    ----------
    content
        What determines the result besides the code of the plugin's package; its ``repr`` must say all of it.
    make
        The solve.
    pack, load
        Turn the result into float64 arrays, and arrays back into the result; ``load`` raises ValueError if they do
        not fit together, because they come from a file.
    """
    bases = _OPEN.get()
    if bases is None:
        return make()
    return bases.take(content, make, pack, load)


def building() -> bool:
    """Tell whether a session is being built: caches of what is made from kept arrays must then not be used."""
    return _OPEN.get() is not None
