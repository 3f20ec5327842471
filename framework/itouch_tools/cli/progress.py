"""Progress of long waits on a terminal: one line shows what is being done, and how far it is; a last one what it took.

Where standard error is not a terminal, nothing is shown.
"""

from __future__ import annotations

import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from itouch.schema.terminal import VERBOSITY, PlainStream, colours, control, is_terminal
from itouch.schema.wait_notices import Wait

#: Seconds of silence after which a wait is shown, and between two updates of its line.
PATIENCE, EVERY = 1.0, 0.2
#: Columns that a bar takes, and what stands beside it: the percentage, the spinner and the time.
_BAR, _SHARE, _TURNING = 20, 5, 11


class _Line(ABC):
    """The line of one wait."""

    def __init__(self, what: str, stream: Any) -> None:
        self._what = what
        #: The share that is done, 0 to 1 (None: unknown), and words about it.
        self.done: float | None = None
        self.words = ""
        self._stream, self._begun = stream, time.monotonic()
        self._drawn = False
        self._lock = threading.RLock()
        self._progress: Any = None
        self._shape: tuple[bool, bool] | None = None

    def part(self, done: float | None, words: str = "") -> None:
        """Note the progress: the share that is done, 0 to 1 (None: unknown), and words."""
        self.done, self.words = done, words or self.words

    @abstractmethod
    def begin(self) -> None:
        """Begin to show it."""

    def make_room(self) -> None:
        """Clear the line before something else is written."""
        with self._lock:
            self._clear()

    @abstractmethod
    def written(self, text: str) -> None:
        """Take notice of what else was written."""

    def finish(self) -> float:
        """Clear the line; return how long the wait took [s]."""
        with self._lock, suppress(OSError, ValueError):
            self._clear()
        return time.monotonic() - self._begun

    def _said(self) -> str:
        return f"{self._what}: {self.words}" if self.words else self._what

    def _draw(self) -> None:
        control(self._stream, "\r\x1b[2K" + self._text())
        self._stream.flush()
        self._drawn = True

    def _text(self) -> str:
        """Return the line as rich draws it, cut to the width of the terminal; a bar gives way to words."""
        from rich.console import Console

        inner = getattr(self._stream, "inner", self._stream)
        console = Console(file=inner, no_color=not colours(inner), force_terminal=True)
        share, said = self.done is not None, self._said()
        room = console.width - 1 - self._beside() - (_SHARE if share else 0)
        if share and len(self.words) <= room - _BAR - 1 < len(said) and self.words:
            said = self.words  # what is being done in it, and a bar
        bar = share and len(said) <= room - _BAR - 1
        if self._shape != (share, bar):
            self._shape, self._progress = (share, bar), self._made(console, share, bar)
        self._progress.update(self._task, description=said[: max(8, room)], completed=self.done or 0.0)
        with console.capture() as captured:
            console.print(self._progress.get_renderable(), no_wrap=True, crop=True, end="")
        return captured.get().rstrip("\n").split("\n")[0]

    def _made(self, console: Any, share: bool, bar: bool) -> Any:
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        first, last = self._columns()
        middle: list[Any] = [TextColumn("{task.description}", markup=False)]
        middle += [BarColumn(_BAR)] * bar + [TaskProgressColumn()] * share
        progress = Progress(*first, *middle, *last, console=console, get_time=time.monotonic)
        self._task = progress.add_task("", total=1.0 if share else None)
        progress.tasks[0].start_time = self._begun
        return progress

    def _beside(self) -> int:
        """Return how many columns ``_columns`` take."""
        return 0

    def _columns(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return what stands before and after words and bar."""
        return (), ()

    def _clear(self) -> None:
        if self._drawn:
            control(self._stream, "\r\x1b[2K")
            self._stream.flush()
            self._drawn = False


class _Moving(_Line):
    """A line that is drawn again and again by a thread of its own, as the work may spend long inside a library."""

    def __init__(self, what: str, stream: Any) -> None:
        super().__init__(what, stream)
        self._quiet_until = self._begun + PATIENCE
        self._end = threading.Event()
        self._worker = threading.Thread(target=self._run, name="itouch-progress", daemon=True)

    def begin(self) -> None:
        """Begin to draw the line, after a while."""
        self._worker.start()

    def make_room(self) -> None:
        """Clear the line before something else is written; it comes back after a while."""
        with self._lock:
            self._clear()
            self._quiet_until = time.monotonic() + PATIENCE

    def written(self, text: str) -> None:
        """Do nothing: the thread draws the line again."""

    def finish(self) -> float:
        """Clear the line; return how long the wait took [s]."""
        self._end.set()
        took = super().finish()
        self._worker.join()
        return took

    def _run(self) -> None:
        while not self._end.wait(EVERY):
            with self._lock, suppress(OSError, ValueError):
                if time.monotonic() >= self._quiet_until and not self._end.is_set():
                    self._draw()

    def _beside(self) -> int:
        return _TURNING

    def _columns(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        from rich.progress import SpinnerColumn, TimeElapsedColumn

        return (SpinnerColumn(),), (TimeElapsedColumn(),)


class _Still(_Line):
    """A line that stands still, with the time at which the wait began.

    It is for work that measures times: a thread that draws would take a processor, and the interpreter's lock, from
    what is measured, and so would a timer.  So it is only drawn by the work itself: at its begin, below each line that
    it prints, and when it reports its progress.
    """

    def __init__(self, what: str, stream: Any) -> None:
        super().__init__(what, stream)
        self._since = time.strftime("%H:%M:%S")
        self._next = 0.0

    def begin(self) -> None:
        """Draw the line at once: nothing could draw it later."""
        self._again()

    def part(self, done: float | None, words: str = "") -> None:
        """Note the progress, and show it if that was not done just now."""
        super().part(done, words)
        if time.monotonic() >= self._next:
            self._again()

    def written(self, text: str) -> None:
        """Come back below a line that was written."""
        if text.endswith("\n"):
            self._again()

    def _again(self) -> None:
        with self._lock, suppress(OSError, ValueError):
            self._draw()
            self._next = time.monotonic() + EVERY

    def _said(self) -> str:
        return (
            f"{self._what}, since {self._since}: {self.words}" if self.words else f"{self._what}, since {self._since}"
        )


class _Within:
    """A wait inside another one, whose line says how far this one is."""

    def __init__(self, line: _Line, what: str) -> None:
        self._line, self._what = line, what

    def part(self, done: float | None, words: str = "") -> None:
        """Note the progress: the share that is done, 0 to 1 (None: unknown), and words."""
        self._line.part(done, f"{self._what}: {words}" if words else self._what)


class _Nothing:
    def part(self, done: float | None, words: str = "") -> None:
        """Show nothing."""


#: The line that stands on the terminal now, if there is one: there is one at a time.
_shown: list[_Line] = []


@contextmanager
def shown(what: str) -> Iterator[Wait]:
    """Show a wait while the context lasts; if that took over a second, print at its end how long it took."""
    with _lasting(_Moving, what) as wait:
        yield wait


@contextmanager
def measured(what: str) -> Iterator[Wait]:
    """Do what ``shown`` does for work that measures times: nothing is done beside it."""
    with _lasting(_Still, what) as wait:
        yield wait


@contextmanager
def _lasting(kind: type[_Line], what: str) -> Iterator[Wait]:
    stream = sys.stderr
    if VERBOSITY.quiet or not is_terminal(stream):
        yield _Nothing()
        return
    if _shown:
        outer = _shown[-1]
        before = outer.done, outer.words
        try:
            yield _Within(outer, what)
        finally:
            outer.done, outer.words = before
        return
    line = kind(what, stream)
    _shown.append(line)
    PlainStream.before, PlainStream.after = line.make_room, line.written
    line.begin()
    try:
        yield line
    finally:
        PlainStream.before = PlainStream.after = None
        _shown.remove(line)
        took = line.finish()
    if took >= PATIENCE:
        print(f"{what}: {_duration(took)}", file=stream, flush=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
