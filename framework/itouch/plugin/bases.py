"""Bases that an eigen-solve made: kept with a session and used again, because a solve may round otherwise elsewhere.

A plugin wraps each solve in ``kept``.  Outside a session's build that only calls it; inside, the result is noted by
the digest of what it was made from, and a restored session gets the stored arrays instead of a new solve.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Arrays = tuple[Array, ...]
T = TypeVar("T")


class Bases:
    """The bases of one session: ``stored`` ones are used, and ``used`` has all that the session needed."""

    def __init__(self, stored: Mapping[str, Arrays] | None = None) -> None:
        self.stored = dict(stored or {})
        self.used: dict[str, Arrays] = {}
        self._made: dict[str, Any] = {}

    def take(self, key: str, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
        """Return what belongs to a key: loaded from what is stored, or made."""
        if key not in self._made:
            stored = self.stored.get(key)
            self._made[key] = make() if stored is None else load(stored)
            self.used[key] = pack(self._made[key]) if stored is None else stored
        made: T = self._made[key]
        return made


_OPEN: ContextVar[Bases | None] = ContextVar("bases", default=None)


@contextmanager
def keeping(bases: Bases) -> Iterator[Bases]:
    """Note, or take from ``bases``, all that is built inside."""
    token = _OPEN.set(bases)
    try:
        yield bases
    finally:
        _OPEN.reset(token)


def kept(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
    """Return the result of a solve, or what a session stored of it.

    Parameters
    ----------
    content
        What determines the result; its ``repr`` must say all of it.
    make
        The solve.
    pack, load
        Turn the result into float64 arrays, and arrays back into the result; ``load`` raises ValueError if they do
        not fit together, because they come from a file.
    """
    bases = _OPEN.get()
    if bases is None:
        return make()
    return bases.take(hashlib.sha256(repr(content).encode()).hexdigest()[:32], make, pack, load)


def building() -> bool:
    """Tell whether a session is being built: caches of what is made from kept arrays must then not be used."""
    return _OPEN.get() is not None
