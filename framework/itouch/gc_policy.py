"""How rarely the garbage collector runs while a program starts or compiles: nearly all that is made then is in use.

Modules, machine code and what describes a scene come to some hundred thousand objects that stay.  Python looks through
them again and again while they are made: a sixth of a start, and a good part of a first one, which compiles.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Generator
from contextlib import contextmanager

#: Thresholds for good, as for ``gc.set_threshold``: what a process looks through at once takes it some milliseconds.
SELDOM = (50_000, 20, 100)
#: Those while something is made or compiled, when nobody waits for the next millisecond.
MEANWHILE = (200_000, 20, 100)

_lock = threading.Lock()
_depth = 0
_before = gc.get_threshold()


def begin_rare_collections() -> None:
    """Raise the thresholds until `end_rare_collections` has been called as often; a collector that is off stays off."""
    global _depth, _before
    with _lock:
        if _depth == 0:
            _before = gc.get_threshold()
            _raise(MEANWHILE)
        _depth += 1


def end_rare_collections() -> None:
    """Restore the thresholds where this is the last one that was begun."""
    global _depth
    with _lock:
        _depth -= 1
        if _depth == 0:
            gc.set_threshold(*_before)


@contextmanager
def rare_collections() -> Generator[None]:
    """Raise the thresholds within, also where several threads do so, or one does so in turn."""
    begin_rare_collections()
    try:
        yield
    finally:
        end_rare_collections()


def keep_collections_rare() -> None:
    """Raise the thresholds, for a process that is this program's alone."""
    _raise(SELDOM)


def _raise(thresholds: tuple[int, int, int]) -> None:
    now = gc.get_threshold()
    if now[0]:  # 0: collection is switched off
        gc.set_threshold(*map(max, now, thresholds))
