"""The live line of a run on a terminal, but for its words on waits and plates, and the closing table of contacts."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from itouch.loop.contact_report import status
from itouch.loop.plate_notices import missed_plates
from itouch.loop.skin_waits import unrecovered_waits, waiting_now
from itouch.schema.terminal import VERBOSITY, colours, control, is_terminal, number_of, plain
from itouch_tools.report import columns
from itouch_tools.viewer.fault_messages import outcome, what

if TYPE_CHECKING:
    from itouch.loop.timing import Timing
    from itouch.plugin import Record
    from itouch.world import Model

#: Shortest time [s] between two updates of the live line.
_EVERY = 0.1
#: How long [s] a run must have taken before its rate tells how much time is left.
_SETTLED = 1.0


class Followed(Protocol):
    """What the screen reads of an engine, in this process or in a servo process."""

    statistics: Any
    clock: Any

    @property
    def model(self) -> Model:
        """The compiled scene."""

    @property
    def state(self) -> Record:
        """The State to show."""

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""

    @property
    def times(self) -> Timing:
        """How long ticks take."""


class Screen:
    """Follows an engine; it reads, and never changes, what it shows."""

    def __init__(self, engine: Followed, stream: TextIO, *, left: Callable[[], float] | None = None) -> None:
        """Begin to follow; ``left`` returns how long the run will simulate yet [s]: then its progress is shown, too."""
        self._engine, self._stream, self._left = engine, stream, left
        self._begun, self._whole = time.monotonic(), left() if left is not None else 0.0
        self._live = is_terminal(stream) and not VERBOSITY.quiet
        self._next = 0.0
        self._told = len(engine.statistics.contacts)
        self._missed = _noted(engine)

    def show(self) -> None:
        """Show progress; to be called every now and then."""
        self._tell_missed()
        if not self._live:
            if not VERBOSITY.quiet:
                self._new_contacts()
            return
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _EVERY
            control(self._stream, "\r\x1b[2K")
            self._stream.write(fitted(self._parts(), shutil.get_terminal_size().columns - 1))
            self._stream.flush()

    def _tell_missed(self) -> None:
        """Say once that a plate was not felt where it should have been, or that skin did not recover while waiting."""
        for sentence in _noted(self._engine):
            if sentence not in self._missed:
                self.interrupt(f"note: {sentence}")
                self._missed = (*self._missed, sentence)

    def interrupt(self, sentence: str) -> None:
        """Print a sentence that can't wait, on a line of its own."""
        if self._live:
            control(self._stream, "\r\x1b[2K")
            self._stream.flush()
        print(sentence, file=sys.stderr, flush=True)

    def _parts(self) -> list[str]:
        """Return the parts of the live line, the most important first."""
        engine = self._engine
        parts = [f"{engine.seconds:7.2f} s", *self._progress()]
        for probe in engine.model.probes:
            index = int(engine.state[f"{probe.name}.contact.object"])
            near = int(engine.state[f"{probe.name}.near_object"])
            where = f"on {engine.model.objects[index]}" if index >= 0 else "free"
            if index < 0 <= near:
                where = f"near {engine.model.objects[near]}"
            where = waiting_now(engine.model, probe, engine.state) or where
            parts.append(f"{probe.name} {where:<18}")
        if not engine.state["ready"]:
            parts.append("calibrating")
        told = (status(one, engine.state) for one in engine.model.modalities)
        parts += [words for words in told if words]
        times = engine.times.summary()
        if times["p99"] is not None:
            parts.append(f"tick p99 {times['p99']:.0f} us")
        if engine.clock.pace == "real":
            late = engine.times.lateness()["p99"] or 0.0
            parts.append(f"late p99 {late:.0f} us, {number_of(engine.times.overruns, 'overrun')}")
        return parts

    def _progress(self) -> list[str]:
        """Return the share that is done and the time left, if anybody asked for them and something is done."""
        left = self._left() if self._left is not None else 0.0
        done = self._whole - left
        if self._left is None or done <= 0.0:
            return []
        share, took = min(0.99, done / self._whole), time.monotonic() - self._begun
        if took < _SETTLED:
            return [f"{share:.0%}"]
        seconds = took * max(0.0, left) / done
        shown = f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"
        return [f"{share:.0%}, about {shown} left"]

    def _new_contacts(self) -> None:
        contacts = self._engine.statistics.contacts
        for entry in contacts[self._told :]:
            said = "; ".join(columns.contact_summaries(self._engine.model, entry))
            left = f"{entry['end_s']:8.3f} s  {entry['probe']} left {entry['object']}"
            self._stream.write(f"{left}: {said}\n" if said else f"{left}\n")
        if len(contacts) > self._told:
            self._stream.flush()
        self._told = len(contacts)

    def finish(self, report: dict[str, Any]) -> None:
        """Show the table of contacts, the timing and the faults."""
        self._tell_missed()
        rows = columns.rows(self._engine.model, report["contacts"])
        if self._live:
            control(self._stream, "\r\x1b[2K")
        elif not VERBOSITY.quiet:
            self._new_contacts()
        if not report["contacts"]:  # heads without rows would look as if something was lost
            self._stream.write("no contact with a virtual object\n")
        else:
            (_rich_table if self._live else _plain_table)(rows, self._stream)
        for entry in report["contacts"]:
            for line in columns.contact_warnings(self._engine.model, entry):
                self._stream.write(line + "\n")
        for line in _waited(report):
            self._stream.write(line + "\n")
        self._stream.write(_closing(report) + "\n")
        for name, device in report["devices"].items():
            if device.get("exchanges"):
                self._stream.write(_wire(name, device["exchanges"]) + "\n")
        for fault in report["faults"]:
            self._stream.write(_fault(fault) + "\n")
        self._stream.flush()


def _noted(engine: Followed) -> tuple[str, ...]:
    """Return the notes so far that are each said once, when they come up."""
    return (*missed_plates(engine.model, engine.state), *unrecovered_waits(engine.model, engine.state))


def _waited(report: dict[str, Any]) -> list[str]:
    """Say for each finger how long it waited for its skin to recover."""
    found: dict[str, list[str]] = {}
    for entry in report.get("waits", ()):
        over = "" if entry["back"] else " (not back)" if entry["ended"] else " so far"
        found.setdefault(entry["probe"], []).append(f"{entry['waited_s']:.1f} s{over}")
    return [f"{probe} waited for its skin: {', '.join(times)}" for probe, times in found.items()]


def fitted(parts: list[str], width: int) -> str:
    """Return the parts as one line of at most ``width`` columns, cut at its end so that nothing wraps.

    >>> fitted(["1.00 s", "finger on wood", "plate 30.1 degC"], 30)
    '1.00 s  finger on wood  plate…'
    """
    from rich.cells import cell_len, set_cell_size

    line = "  ".join(part.rstrip() for part in parts)
    return line if cell_len(line) <= width else set_cell_size(line, max(width - 1, 0)).rstrip() + "…"


def _wire(name: str, figures: dict[str, float]) -> str:
    """Say how fast a device answered over its wire."""
    middle, late, worst = figures["p50_ms"], figures["p99_ms"], figures["max_ms"]
    rate = figures["rate_hz"]
    return f"{name}: {rate:.0f} exchanges/s, {middle:.2f} ms median, {late:.2f} ms p99, {worst:.1f} ms at most"


def _plain_table(rows: list[list[str]], stream: TextIO) -> None:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    last = rows[0].index("material")  # of the columns that are words
    for row in rows:
        sized = enumerate(zip(row, widths, strict=True))
        cells = [cell.ljust(w) if i <= last else cell.rjust(w) for i, (cell, w) in sized]
        stream.write("  ".join(cells).rstrip() + "\n")


def _rich_table(rows: list[list[str]], stream: TextIO) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    last = rows[0].index("material")
    for index, column in enumerate(rows[0]):
        table.add_column(Text(plain(column)), justify="left" if index <= last else "right")
    for row in rows[1:]:
        table.add_row(*(Text(plain(cell)) for cell in row))
    Console(file=getattr(stream, "inner", stream), no_color=not colours(stream)).print(table)


def _closing(report: dict[str, Any]) -> str:
    servo, tracking = report["servo"], report["table"]["tracking_mm"]
    whole, ran = report["simulated_s"], report["ran_s"]
    speed = ran / report["wall_s"] if report["wall_s"] > 0 else 0.0
    last = "" if f"{ran:.3f}" == f"{whole:.3f}" else f", {ran:.3f} s of them"  # of a session that was restored
    parts = [f"{whole:.3f} s simulated{last} in {report['wall_s']:.1f} s ({speed:.1f} x real time)"]
    if servo["tick_us"]["p99"] is not None:
        parts.append(f"tick p50 {servo['tick_us']['p50']:.0f} us, p99 {servo['tick_us']['p99']:.0f} us")
    if servo["overruns"] is not None:
        parts.append(number_of(servo["overruns"], "overrun"))
    if tracking["p99"] is not None:
        parts.append(f"table within {tracking['p99']:.2f} mm of its command (p99)")
    parts.append(number_of(len(report["faults"]), "fault"))
    return "; ".join(parts)


def _fault(fault: dict[str, Any]) -> str:
    kind = fault["trip"] or "injected"
    lines = [f"fault[{kind}]: {what(fault)} at {fault['time_s']:.3f} s"]
    if fault["scene"]:
        lines.append(f"  scene:   {fault['scene']}")
    return "\n".join([*lines, *(f"  {line}" for line in outcome(fault))])
