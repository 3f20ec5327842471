"""Bases from eigen-solves: stored with a session and used again, because a new solve may round differently elsewhere.

A plugin wraps each solve in ``kept``.  Outside the building of a session, that only calls the solve.  Inside, the
result is recorded by the digest of what determines it, and a restored session gets the stored arrays instead of a new
solve.  A result that no session has stored may be in this machine's cache from an earlier start (``result_cache``).
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
        """Return the result for a content: loaded from the stored arrays, found in the cache on disk, or made."""
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
    """Return the result of a solve and its arrays: from the cache on disk, or from a new solve, which is put there."""
    name = result_cache.key(content, make)
    arrays = None if name is None else result_cache.read(name)
    if arrays is not None:
        with suppress(ValueError):  # arrays that do not fit together count as absent
            return load(arrays), arrays
    made = make()
    arrays = pack(made)
    if name is not None:
        result_cache.write(name, arrays)
    return made, arrays


_OPEN: ContextVar[Bases | None] = ContextVar("bases", default=None)


@contextmanager
def keeping(bases: Bases) -> Iterator[Bases]:
    """Inside the context, record in ``bases`` what ``kept`` returns, or take it from there."""
    token = _OPEN.set(bases)
    try:
        yield bases
    finally:
        _OPEN.reset(token)


@contextmanager
def keeping_anyhow() -> Iterator[None]:
    """Inside the context, let ``kept`` use the cache on disk even if no session is being built."""
    if _OPEN.get() is not None:
        yield
        return
    with keeping(Bases()):
        yield


def kept(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
    """Return the result of a solve, or the one that a session has stored.

    Parameters
    ----------
    content
        What determines the result besides the code of the plugin's package; its ``repr`` must contain all of it.
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
    """Tell whether a session is being built: then caches of what is made from kept arrays must not be used."""
    return _OPEN.get() is not None
