"""The writing process (`python -m itouch.recording.writing_process`), and how often it closes a chunk.

Its standard input closes when its parent has ended.
It takes rows from the ring about ten times a second, ends when it is told to or when its parent has ended, and survives
signals to its parent's process group.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

import numpy as np

from itouch.gc_policy import keep_collections_rare
from itouch.platforms import Ended, Memory, signals
from itouch.recording.chunking import MOST_ROWS, SPEC, ChunkBuilder
from itouch.recording.ring import ControlWord, Phase, Ring, Shape
from itouch.recording.sink import Sink
from itouch.recording.spec import Spec

#: Time between two chunks [s]: this and the time to the disk is what a kill may cost.
EVERY = 0.1
_PATIENCE = 30.0


def main(words: list[str]) -> int:
    """Write one recording; return 0 if it is whole."""
    rows, row, letters = (int(word) for word in words[1:4])
    ring = Ring(Shape(rows, row, letters), Memory.opened(words[0]))
    ring.words[ControlWord.PROCESS] = os.getpid()
    _settle()
    try:
        sink = Sink(words[4])
        try:
            _write(ring, sink)
        finally:
            sink.close()
    except OSError as error:
        ring.say(Phase.FAILED, error.errno or 1, f"cannot write '{words[4]}': {error.strerror or error}")
        return 1
    except Exception as error:  # whatever it is, the loop must learn of it
        ring.say(Phase.FAILED, 1, f"cannot write '{words[4]}': {type(error).__name__}: {error}")
        return 1
    ring.say(Phase.DONE)
    return 0


def _settle() -> None:
    """Give up the parent's priority and processors, and ignore signals from its terminal."""
    for number in signals("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP"):
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    with contextlib.suppress(OSError, AttributeError):
        os.nice(5)


def _write(ring: Ring, sink: Sink) -> None:
    parent = Ended(0)
    spec = Spec.load(_first(ring, parent))
    scribe = ChunkBuilder(ring, spec, sink, np.dtype(_tuples(spec.session["layout"])))
    scribe.begin()
    ring.say(Phase.RECORDING)
    written = time.monotonic()
    while not ring.words[ControlWord.CLOSING]:
        if parent.wait(0.01 if _waiting(ring) > ring.shape.rows // 4 else 0.02):
            break
        if _waiting(ring) >= min(MOST_ROWS, ring.shape.rows // 4) or time.monotonic() - written >= EVERY - 0.02:
            scribe.step()
            written = time.monotonic()
    scribe.drain()


def _first(ring: Ring, parent: Ended) -> bytes:
    until = time.monotonic() + _PATIENCE
    while (letter := ring.take()) is None:
        if time.monotonic() > until or parent.wait(0.005):
            raise OSError(0, "there was nothing to write")
    if letter[0] != SPEC:
        raise ValueError("the first letter is not a specification")
    return letter[1]


def _waiting(ring: Ring) -> int:
    return int(ring.words[ControlWord.ROWS_IN] - ring.words[ControlWord.ROWS_OUT])


def _tuples(described: list[list[object]]) -> list[tuple[object, ...]]:
    """Return a dtype description from JSON in the form that NumPy expects."""
    out: list[tuple[object, ...]] = []
    for name, kind, *shape in described:
        inner = _tuples(kind) if isinstance(kind, list) else kind
        out.append((name, inner, *(tuple(s) if isinstance(s, list) else s for s in shape)))
    return out


if __name__ == "__main__":
    keep_collections_rare()
    sys.exit(main(sys.argv[1:]))
