"""Progress of a run on one line of the standard error: in a terminal, a notebook, or a script's log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

#: How often [s of host time] the line is written.
EVERY = 0.2


@contextmanager
def told(now: Callable[[], float], seconds: float | None) -> Iterator[Callable[[], None]]:
    """Yield a function to be called often during a run, which writes the line; the context ends the line.

    Parameters
    ----------
    now
        Returns the simulated time [s].
    seconds
        How long the run will be [s]; None: not known.
    """
    began, begin = time.monotonic(), now()
    last = [0.0]

    def line() -> str:
        done, took = now() - begin, time.monotonic() - began
        of = f" of {seconds:.1f}" if seconds is not None else ""
        return f"{done:.1f}{of} s simulated, {done / max(took, 1e-9):.1f} x real time"

    def write(end: str) -> None:
        with suppress(OSError, ValueError):  # the reader of the stream may be gone: the run goes on
            print(f"\r{line()}   ", end=end, file=sys.stderr, flush=True)

    def tell() -> None:
        if time.monotonic() - last[0] >= EVERY:
            last[0] = time.monotonic()
            write("")

    try:
        yield tell
    finally:
        write("\n")
