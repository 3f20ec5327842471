"""What a run shows on a terminal: a live line, and a table at the end; plain lines where there is no terminal."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from itouch.loop.faultwords import outcome, what
from itouch.loop.missing import missed_plates
from itouch.schema.terminal import control, plain

if TYPE_CHECKING:
    from itouch.loop.timing import Timing
    from itouch.plugin import Record
    from itouch.world import Model

_EVERY = 0.1
_COLUMNS = ("object", "material", "begin s", "end s", "W/m2", "skin K", "peak N", "gap mm", "flux err")


class Followed(Protocol):
    """What is shown of an engine, here or in a servo process."""

    ledger: Any
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

    def __init__(self, engine: Followed, stream: TextIO) -> None:
        self._engine, self._stream = engine, stream
        self._live = stream.isatty()
        self._next = 0.0
        self._told = len(engine.ledger.contacts)
        self._missed = missed_plates(engine.model, engine.state)

    def show(self) -> None:
        """Show progress; called every now and then."""
        self._tell_missed()
        if not self._live:
            self._new_contacts()
            return
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _EVERY
            control(self._stream, "\r\x1b[2K")
            self._stream.write(self._line())
            self._stream.flush()

    def _tell_missed(self) -> None:
        """Say once that a plate was not felt where it should have been."""
        for sentence in missed_plates(self._engine.model, self._engine.state)[len(self._missed) :]:
            self.interrupt(f"note: {sentence}")
            self._missed = (*self._missed, sentence)

    def interrupt(self, sentence: str) -> None:
        """Say what can't wait, on a line of its own."""
        if self._live:
            control(self._stream, "\r\x1b[2K")
            self._stream.flush()
        print(sentence, file=sys.stderr, flush=True)

    def _line(self) -> str:
        engine = self._engine
        parts = [f"{engine.seconds:7.2f} s"]
        for probe in engine.model.probes:
            index = int(engine.state[f"{probe.name}.contact.object"])
            near = int(engine.state[f"{probe.name}.near_object"])
            where = f"on {engine.model.objects[index]}" if index >= 0 else "free"
            if index < 0 <= near:
                where = f"near {engine.model.objects[near]}"
            parts.append(f"{probe.name} {where:<18}")
        told = (m.instance.status(m.model, engine.state) for m in engine.model.modalities)
        parts += [words for words in told if words]
        times = engine.times.summary()
        if times["p99"] is not None:
            parts.append(f"tick p99 {times['p99']:.0f} us")
        if engine.clock.pace == "real":
            late = engine.times.lateness()["p99"] or 0.0
            parts.append(f"late p99 {late:.0f} us, {engine.times.overruns} overruns")
        if not engine.state["ready"]:
            parts.append("calibrating")
        return "  ".join(parts)

    def _new_contacts(self) -> None:
        contacts = self._engine.ledger.contacts
        for entry in contacts[self._told :]:
            self._stream.write(f"{entry['end_s']:8.3f} s  {entry['probe']} left {entry['object']}{self._flux(entry)}\n")
        if len(contacts) > self._told:
            self._stream.flush()
        self._told = len(contacts)

    def _flux(self, entry: dict[str, Any]) -> str:
        """Say what heat was rendered; nothing where no modality of the scene says anything of heat."""
        mean = entry["mean_flux_W_m2"]
        if mean is not None:
            return f": mean flux {mean:.0f} W/m2"
        return ": no heat rendered" if "plate_ready" in entry else ""

    def finish(self, report: dict[str, Any]) -> None:
        """Show the table of contacts, the timing and the faults."""
        self._tell_missed()
        if self._live:
            control(self._stream, "\r\x1b[2K")
            _rich_table(report, self._stream)
        else:
            self._new_contacts()
            _plain_table(report, self._stream)
        for line in _marks(report):
            self._stream.write(line + "\n")
        for line in _judged(report):
            self._stream.write(line + "\n")
        self._stream.write(_closing(report) + "\n")
        for name, device in report["devices"].items():
            if device.get("exchanges"):
                self._stream.write(_wire(name, device["exchanges"]) + "\n")
        for fault in report["faults"]:
            self._stream.write(_fault(fault) + "\n")
        self._stream.flush()


def _marks(report: dict[str, Any]) -> list[str]:
    """Say which touches were not what they should have been."""
    found = []
    for entry in report["contacts"]:
        where = f"{entry['object']} at {entry['begin_s']:.3f} s"
        if entry.get("plate_missed"):
            found.append(f"{where}: the plate was not felt where it should have been; the arm gave its force")
        if entry.get("plate_ready") is False:
            found.append(f"{where}: began before the plate was ready")
        if entry.get("plate_limited"):
            found.append(f"{where}: its start temperature is out of the plate's band and was clipped")
    return found


def _judged(report: dict[str, Any]) -> list[str]:
    """Say how good an estimated flux is: its deviation, the sensor's own comparison, and the truth of a virtual rig."""
    found = []
    for entry in report["contacts"]:
        if entry.get("flux_source") != "estimate" or entry.get("sensor_error_rms") is None:
            continue
        error, sensor = entry["flux_error_rms"] or 0.0, entry["sensor_error_rms"]
        line = f"{entry['object']}: flux off by {100.0 * error:.1f} % as estimated (+- "
        line += f"{entry['flux_deviation_W_m2']:.0f} W/m2), {100.0 * sensor:.1f} % by the sensor alone"
        if entry.get("true_error_rms") is not None:
            line += f"; truly {100.0 * entry['true_error_rms']:.1f} %, the estimate itself by "
            line += f"{100.0 * entry['estimate_error_rms']:.1f} %"
        found.append(line)
    return found


def _wire(name: str, figures: dict[str, float]) -> str:
    """Say how fast a device has answered over its wire."""
    middle, late, worst = figures["p50_ms"], figures["p99_ms"], figures["max_ms"]
    rate = figures["rate_hz"]
    return f"{name}: {rate:.0f} exchanges/s, {middle:.2f} ms median, {late:.2f} ms p99, {worst:.1f} ms at most"


def _row(entry: dict[str, Any]) -> list[str]:
    def number(key: str, digits: int, scale: float = 1.0, unit: str = "") -> str:
        value = entry.get(key)
        return "-" if value is None else f"{value * scale:.{digits}f}{unit}"

    return [
        entry["object"], entry["material"], number("begin_s", 3), number("end_s", 3), number("mean_flux_W_m2", 0),
        number("skin_drop_K", 2), number("peak_force_N", 2), number("plate_gap_mm", 3),
        number("flux_error_rms", 1, 100.0, " %"),
    ]  # fmt: skip


def _plain_table(report: dict[str, Any], stream: TextIO) -> None:
    rows = [list(_COLUMNS), *(_row(entry) for entry in report["contacts"])]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_COLUMNS))]
    for row in rows:
        cells = [cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))]
        stream.write("  ".join(cells).rstrip() + "\n")


def _rich_table(report: dict[str, Any], stream: TextIO) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for index, column in enumerate(_COLUMNS):
        table.add_column(column, justify="left" if index < 2 else "right")
    for entry in report["contacts"]:
        table.add_row(*(Text(plain(cell)) for cell in _row(entry)))
    Console(file=getattr(stream, "inner", stream)).print(table)


def _closing(report: dict[str, Any]) -> str:
    servo, tracking = report["servo"], report["table"]["tracking_mm"]
    speed = report["simulated_s"] / report["wall_s"] if report["wall_s"] > 0 else 0.0
    parts = [f"{report['simulated_s']:.3f} s simulated in {report['wall_s']:.1f} s ({speed:.1f} x real time)"]
    if servo["tick_us"]["p99"] is not None:
        parts.append(f"tick p50 {servo['tick_us']['p50']:.0f} us, p99 {servo['tick_us']['p99']:.0f} us")
    if servo["overruns"] is not None:
        parts.append(f"{servo['overruns']} overruns")
    if tracking["p99"] is not None:
        parts.append(f"table within {tracking['p99']:.2f} mm of its command (p99)")
    parts.append(f"{len(report['faults'])} faults")
    return "; ".join(parts)


def _fault(fault: dict[str, Any]) -> str:
    kind = fault["trip"] or "injected"
    lines = [f"fault[{kind}]: {what(fault)} at {fault['time_s']:.3f} s"]
    if fault["scene"]:
        lines.append(f"  scene:   {fault['scene']}")
    return "\n".join([*lines, *(f"  {line}" for line in outcome(fault))])
