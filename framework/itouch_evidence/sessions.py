"""``itouch-py bench sessions``: what publishing, recording, saving and restoring cost."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from itouch.loop.clock import WallClock
from itouch.loop.engine import SAMPLED
from itouch.plugin.commands import exit_code, judged
from itouch.recording import RecordingError
from itouch.recording.chunking import ChunkBuilder
from itouch.recording.ring import ControlWord, Ring, Shape
from itouch.recording.sink import Sink
from itouch.recording.spec import Spec
from itouch.recording.tracks import Column, Track
from itouch.session import Session, build, restore
from itouch.session.recorder import Recorder
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

#: Number and rate [Hz] of the channels that are recorded.
CHANNELS, RATE = 60, 1000.0
_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured figure and its limit."""

    name: str
    value: float
    unit: str
    limit: float
    at_least: bool = False

    @property
    def good(self) -> bool:
        """Whether the value is within its limit."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def line(self) -> str:
        """Return the figure and its limit as a line for the screen."""
        head = f"{self.name:<58} {self.value:9.3f} {self.unit:<3}"
        if self.limit == float("inf"):
            return head
        return f"{head} {'>=' if self.at_least else '<='} {self.limit:g}  {judged(self.good)}"


def main(argv: Sequence[str]) -> int:
    """Measure what publishing, recording, saving and restoring cost; exit code 1: a limit is missed."""
    parser = Parser(prog="itouch-py bench sessions", description=main.__doc__)
    parser.add_argument("--scene", help="a scene that runs on twins; default: the four-material scene")
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures to this file too")
    options = parser.parse_args(argv)
    figures = measure(options.scene or _four_materials())
    for figure in figures:
        print(figure.line())
    if options.json:
        limited = [figure for figure in figures if figure.limit != float("inf")]
        content = [{**asdict(figure), "good": figure.good} for figure in limited]
        write_output(options.json, json.dumps(content, indent=1) + "\n")
    return exit_code(figure.good for figure in figures)


def _four_materials() -> str:
    import itouch

    package = Path(itouch.__file__).parent
    folders = (package / "scenes", package.parents[1] / "scenes")
    return str(next(f / "four_materials_hurried.xml" for f in folders if (f / "four_materials_hurried.xml").is_file()))


def measure(scene: str) -> list[Figure]:
    """Return the figures, each the best of several tries, because the machine does other things, too."""
    with tempfile.TemporaryDirectory() as folder:
        session = build(scene)
        for _ in range(3000):
            session.tick()
        figures = _publishing(session, os.path.join(folder, "r.mcap"))
        times = recording(os.path.join(folder, "s.mcap"))
        label = f"recording {CHANNELS} float64 channels at 1 kHz, times real time"
        figures.append(Figure(label, times, "x", 50.0, at_least=True))
        return figures + _saving(session, os.path.join(folder, "s.itouch"))


def _publishing(session: Session, path: str) -> list[Figure]:
    """Return how long a tick takes, and what its recorder takes besides, on the virtual clock and in real time.

    There the recorder is called where the tick is counted, but for one tick in `SAMPLED`, when Python calls it.
    """
    recorder = session.record(path)
    publish, virtual = recorder.tap, session.clock
    session.taps.remove(publish)

    tick, stamps, times = session.ticks - 1, session.stamps.tolist(), session.times
    ways = (lambda: times.add(stamps), lambda: times.add(stamps, publish.place), lambda: publish(tick))
    ticks, rows, real_ticks = list[float](), list[float](), list[float]()
    real_rows: tuple[list[float], ...] = ([], [], [])
    for _ in range(12):
        ticks.append(_each(session.tick, 500))
        _await(recorder)
        rows.append(_each(lambda: publish.repeat(2000), 1) / 2000)
        session.clock = WallClock()
        real_ticks.append(_each(session.tick, 500))
        for work, took in zip(ways, real_rows, strict=True):
            _await(recorder)
            took.append(_each(work, 2000))
        session.clock = virtual
    without, within, alone = (min(took) for took in real_rows)
    session.close()
    session.enable()
    figures = []
    in_real_time = ((SAMPLED - 1) * (within - without) + alone) / SAMPLED
    for kind, whole, row in (("", min(ticks), min(rows)), (" in real time", min(real_ticks), in_real_time)):
        figures += [
            Figure(f"a tick{kind}", whole * 1e6, "us", float("inf")),
            Figure(f"publishing it to the recorder{kind}", row * 1e6, "us", float("inf")),
            Figure(f"publishing{kind}, part of a tick", 100 * row / whole, "%", 2.0),
        ]
    return figures


def _await(recorder: Recorder) -> None:
    """Wait until the writing process has emptied the ring: a full one takes no rows.

    Raises
    ------
    RecordingError
        If it takes none for a minute.
    """
    until = time.monotonic() + 60.0
    while recorder.waiting:
        if time.monotonic() > until:
            raise RecordingError(f"cannot write '{recorder.path}': the writing process takes nothing")
        time.sleep(0.01)


def _each(work: Callable[[], object], count: int) -> float:
    begin = time.perf_counter()
    for _ in range(count):
        work()
    return (time.perf_counter() - begin) / count


def recording(path: str) -> float:
    """Return how many times faster than real time the writing process is, from ring to file, measured alone."""
    track = Track("bench", 1, True, tuple(Column(f"bench.c{i}", f"c{i}", "f8", 0, "m") for i in range(CHANNELS)))
    places = {column.field: 8 * index for index, column in enumerate(track.columns)}
    spec = Spec((track,), places, {}, 1.0 / RATE, 0, {"manifest": {}, "layout": []}, {})
    ring = Ring.create(Shape(8192, 8 * CHANNELS, 1 << 16))
    walk = np.cumsum(np.random.default_rng(1).standard_normal((4096, CHANNELS)), axis=0)
    slots = np.frombuffer(ring.rows, np.float64).reshape(8192, CHANNELS)
    count, spent = int(_SECONDS * RATE), 0.0
    sink = Sink(path)
    scribe = ChunkBuilder(ring, spec, sink, np.dtype([("tick", "i8")]))
    begin = time.perf_counter()
    scribe.begin()
    spent += time.perf_counter() - begin
    for first in range(0, count, 2048):
        block = min(2048, count - first)
        at = (first + np.arange(block)) % 8192
        slots[at] = walk[:block]
        np.frombuffer(ring.ticks, np.int64)[at] = first + np.arange(block)
        ring.words[ControlWord.ROWS_IN] = first + block
        begin = time.perf_counter()
        scribe.step()
        spent += time.perf_counter() - begin
    begin = time.perf_counter()
    scribe.drain()
    spent += time.perf_counter() - begin
    sink.close()
    return _SECONDS / spent


def _saving(session: Session, path: str) -> list[Figure]:
    def best(work: Callable[[], Any], count: int) -> float:
        work()
        return min(_each(work, 1) for _ in range(count))

    packing, saving = best(session.pack, 40), best(lambda: session.save(path), 40)
    restoring = best(lambda: restore(path), 5)
    return [
        Figure("snapshot: putting it together", packing * 1e3, "ms", 5.0),
        Figure("snapshot: on the disk, synced and renamed", saving * 1e3, "ms", 5.0),
        Figure("restore", restoring, "s", 0.5),
    ]
