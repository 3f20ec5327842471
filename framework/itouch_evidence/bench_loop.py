"""``itouch-py bench loop``: the loop in a thread, in a process, and in a process with real-time priority, side by side.

Each runs the same scene, alone and beside loads as of a window: a thread that computes in Python, and drawing.
"""

from __future__ import annotations

import argparse
import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass

from itouch.loop import WallClock
from itouch.loop.timing import Timing
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.servo import ServoError
from itouch.session import build
from itouch_tools.cli.doctor.measured_loop import bench_scene, in_process, may_have_priority

#: Where the loop runs, in the order of the table.
THREAD, PROCESS, PRIORITY = "thread", "process", "process, priority"
#: The load that runs beside it.
IDLE, PYTHON, DRAWING = "none", "python thread", "drawing"


@dataclass(frozen=True, slots=True)
class Row:
    """One measurement: how late ticks began and how long they took [us], overruns and skipped ticks."""

    architecture: str
    load: str
    ticks: int
    late_p50_us: float
    late_p99_us: float
    late_p999_us: float
    late_max_us: float
    tick_p99_us: float
    overruns: int
    skipped: int
    culprits: dict[str, int]


def _row(architecture: str, load: str, times: Timing) -> Row:
    late, work = times.lateness(), times.summary()
    return Row(
        architecture, load, times.ticks, late["p50"] or 0.0, late["p99"] or 0.0, late["p99.9"] or 0.0,
        late["max"] or 0.0, work["p99"] or 0.0, times.overruns, times.skipped, times.culprits(),
    )  # fmt: skip


def in_thread(description: Scene, seconds: float) -> Timing:
    """Run in a thread of this process for some seconds of real time: the common design, for comparison."""
    engine = build(description, clock=WallClock())
    end = time.monotonic() + seconds
    thread = threading.Thread(target=lambda: engine.run(until=lambda: time.monotonic() >= end))
    thread.start()
    thread.join()
    engine.close()
    return engine.times


@contextmanager
def beside(load: Callable[[threading.Event], None] | None) -> Iterator[None]:
    """Run a load in a thread of this process meanwhile."""
    ending = threading.Event()
    thread = threading.Thread(target=load, args=(ending,)) if load is not None else None
    if thread is not None:
        thread.start()
    try:
        yield
    finally:
        ending.set()
        if thread is not None:
            thread.join()


def computing(ending: threading.Event) -> None:
    """Compute in plain Python, as a plugin of a window might."""
    while not ending.is_set():
        sum(range(10_000))


def drawer(description: Scene) -> Callable[[threading.Event], None] | None:
    """Return a load that draws the scene again and again, or None where nothing can be drawn."""
    from itouch.world import Model, make_state
    from itouch_tools.viewer.offscreen import Offscreen

    model = Model.of(description, Catalog())
    state = make_state(model)

    def draw(ending: threading.Event) -> None:
        offscreen = Offscreen(model)
        while not ending.is_set():
            offscreen.shoot(state)

    try:
        Offscreen(model).shoot(state)
    except Exception:
        return None
    return draw


def measure(
    seconds: float, *, loads_wanted: Sequence[str], architectures: Sequence[str], tell: Callable[[Row], None]
) -> list[Row]:
    """Measure every pair of architecture and load; ``tell`` is called with each row."""
    description = bench_scene()
    known: dict[str, Callable[[threading.Event], None] | None] = {IDLE: None, PYTHON: computing}
    if DRAWING in loads_wanted and (draw := drawer(description)) is not None:
        known[DRAWING] = draw
    run: dict[str, Callable[[], Timing]] = {
        THREAD: lambda: in_thread(description, seconds),
        PROCESS: lambda: in_process(description, seconds, realtime=False),
        PRIORITY: lambda: in_process(description, seconds, realtime=True),
    }
    rows = []
    for load in loads_wanted:
        if load not in known:
            continue
        for architecture in architectures:
            with beside(known[load]):
                rows.append(_row(architecture, load, run[architecture]()))
            tell(rows[-1])
    return rows


_HEAD = "loop in a          beside          late p50      p99    p99.9       max  tick p99           over   [us]"


def _line(row: Row) -> str:
    numbers = f"{row.late_p50_us:>9.0f} {row.late_p99_us:>8.0f} {row.late_p999_us:>8.0f} {row.late_max_us:>9.0f}"
    over = f"{row.overruns} of {row.ticks}"
    return f"{row.architecture:<18} {row.load:<14} {numbers} {row.tick_p99_us:>9.0f} {over:>14}"


def main(argv: Sequence[str]) -> int:
    """Compare the loop in a thread, in a process, and in a process with real-time priority."""
    parser = argparse.ArgumentParser(prog="itouch-py bench loop", description=main.__doc__)
    parser.add_argument(
        "--seconds", type=float, default=5.0, metavar="S", help="length of each measurement (default 5)"
    )
    parser.add_argument("--no-drawing", action="store_true", help="leave out the load that draws")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    if not 0.1 <= options.seconds <= 3600:
        parser.error(f"--seconds {options.seconds:g} is out of range: 0.1 to 3600")
    wanted = [IDLE, PYTHON, *([] if options.no_drawing else [DRAWING])]
    architectures = [THREAD, PROCESS, *([PRIORITY] if may_have_priority() else [])]
    if not options.json:
        print(_HEAD)
    try:
        rows = measure(options.seconds, loads_wanted=wanted, architectures=architectures,
                       tell=lambda row: None if options.json else print(_line(row), flush=True))  # fmt: skip
    except ServoError as error:
        print(error)
        return 1
    if options.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    elif PRIORITY not in architectures:
        print("real-time priority is not given to this user: `itouch-py doctor` says how to change that")
    return 0
