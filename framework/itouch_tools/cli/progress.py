"""Progress of long waits on a terminal: after a second one line shows what is being done, and how far it is.

Where standard error is not a terminal, nothing is shown.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from itouch.schema.terminal import MANNER, PlainStream, colours, control, is_terminal

#: Seconds of silence after which a wait is shown, and between two updates of its line.
PATIENCE, EVERY = 1.0, 0.2


class _Line:
    """The line of one wait; drawn by a thread of its own, as the work may spend long inside a library."""

    def __init__(self, what: str, stream: Any) -> None:
        self._what, self._words = what, ""
        self._done: float | None = None
        self._stream, self._begun = stream, time.monotonic()
        self._quiet_until = self._begun + PATIENCE
        self._drawn, self._end = False, threading.Event()
        self._lock = threading.RLock()
        self._progress: Any = None

    def part(self, done: float | None, words: str = "") -> None:
        """Note the progress: the share that is done, 0 to 1 (None: unknown), and words."""
        self._done, self._words = done, words or self._words

    def make_room(self) -> None:
        """Clear the line before something else is written; it comes back after a while."""
        with self._lock:
            self._clear()
            self._quiet_until = time.monotonic() + PATIENCE

    def run(self) -> None:
        """Draw the line again and again until ``finish`` is called."""
        while not self._end.wait(EVERY):
            with self._lock, suppress(OSError, ValueError):
                if time.monotonic() >= self._quiet_until and not self._end.is_set():
                    self._draw()

    def finish(self) -> float:
        """Clear the line; return how long the wait took [s]."""
        self._end.set()
        with self._lock, suppress(OSError, ValueError):
            self._clear()
        return time.monotonic() - self._begun

    def _draw(self) -> None:
        control(self._stream, "\r\x1b[2K" + self._text())
        self._stream.flush()
        self._drawn = True

    def _text(self) -> str:
        """Return the line as rich draws it, cut to the width of the terminal."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn

        inner = getattr(self._stream, "inner", self._stream)
        console = Console(file=inner, no_color=not colours(inner), force_terminal=True)
        if self._progress is None:
            bar = (BarColumn(20), TaskProgressColumn()) if self._done is not None else ()
            self._progress = Progress(
                SpinnerColumn(), TextColumn("{task.description}", markup=False), *bar, TimeElapsedColumn(),
                console=console, get_time=time.monotonic,
            )  # fmt: skip
            self._task = self._progress.add_task("", total=1.0 if self._done is not None else None)
            self._progress.tasks[0].start_time = self._begun
        elif self._done is not None and self._progress.tasks[0].total is None:
            self._progress = None
            return self._text()
        said = f"{self._what}: {self._words}" if self._words else self._what
        room = max(8, console.width - (46 if self._done is not None else 14))
        self._progress.update(self._task, description=said[:room], completed=self._done or 0.0)
        with console.capture() as captured:
            console.print(self._progress.get_renderable(), no_wrap=True, crop=True, end="")
        return captured.get().rstrip("\n").split("\n")[0]

    def _clear(self) -> None:
        if self._drawn:
            control(self._stream, "\r\x1b[2K")
            self._stream.flush()
            self._drawn = False


@contextmanager
def shown(what: str) -> Iterator[_Line | _Nothing]:
    """Show a wait while the context lasts; if that took over a second, print at its end how long it took."""
    stream = sys.stderr
    if MANNER.quiet or not is_terminal(stream) or PlainStream.before is not None:  # one at a time
        yield _Nothing()
        return
    line = _Line(what, stream)
    PlainStream.before = line.make_room
    worker = threading.Thread(target=line.run, name="itouch-progress", daemon=True)
    worker.start()
    try:
        yield line
    finally:
        PlainStream.before = None
        took = line.finish()
        worker.join()
    if took >= PATIENCE:
        print(f"{what}: {_said(took)}", file=stream, flush=True)


class _Nothing:
    def part(self, done: float | None, words: str = "") -> None:
        """Show nothing."""


def _said(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
