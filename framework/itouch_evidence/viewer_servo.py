"""``itouch-py bench viewer --servo``: the servo loop beside a viewer that is open, killed, frozen or overloaded.

One session runs with a small scene and one with a large mesh; in each of them, every round measures all situations in
turn, so that other work of the machine affects all alike.  The viewers are processes of `itouch-py view`.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop.timing import Timing, edges, percentile
from itouch.schema import ItouchError
from itouch.servo import Handle, launch
from itouch_evidence.bumpy_sphere import bumpy_sphere, write_stl
from itouch_tools.cli.doctor.touch_scene import scene

NONE, THERE, KILLED, FROZEN = "no viewer", "viewer", "viewer killed and reopened", "viewer frozen"
#: How long [s] a viewer may take to open, and how long the loop settles after a change.
OPENING, SETTLING = 180.0, 0.5
#: Situations that are measured with the small scene, and with the large mesh.
_SMALL, _GREAT = (NONE, THERE, KILLED, FROZEN), (NONE, THERE)


@dataclass(slots=True)
class Row:
    """One situation: the timing of the ticks in it, and the CPU time of the viewer."""

    situation: str
    triangles: int
    ticks: int = 0
    overruns: int = 0
    reopened: int = 0
    seconds: float = 0.0
    viewer_cpu: float = 0.0
    late: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(edges()) - 1, np.int64))
    work: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(edges()) - 1, np.int64))

    def figures(self) -> dict[str, Any]:
        """Return the figures that are printed: times in us, and how many cores the viewer used."""
        return {
            "situation": self.situation, "triangles": self.triangles, "ticks": self.ticks, "overruns": self.overruns,
            "late_p50_us": _us(self.late, 50), "late_p99_us": _us(self.late, 99), "late_max_us": _us(self.late, 100),
            "tick_p99_us": _us(self.work, 99), "reopened": self.reopened,
            "viewer_cores": None if math.isnan(self.viewer_cpu) else self.viewer_cpu / max(self.seconds, 1e-9),
        }  # fmt: skip


def _us(counts: NDArray[np.int64], percent: float) -> float:
    return round(1e6 * (percentile(counts, percent) or 0.0), 1)


class Viewers:
    """Opens `itouch-py view` on sessions, on this display or a virtual one."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._environment = environment
        self._process: subprocess.Popen[str] | None = None

    def open(self, name: str) -> None:
        """Open a viewer, and wait until it shows the session.

        Raises
        ------
        ItouchError
            If it does not show it.
        """
        self._process = subprocess.Popen(
            self.words(name), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self._environment
        )
        self.await_line("attached")

    def words(self, name: str) -> list[str]:
        """Return the command that shows a session."""
        return [sys.executable, "-m", "itouch_tools.cli", "view", name, "--mute"]

    def await_line(self, begin: str) -> None:
        """Wait until the viewer prints a line that begins with ``begin``.

        Raises
        ------
        ItouchError
            If it ends or takes too long.
        """
        if self._process is not None:
            _await_line(self._process, begin)

    def first_line(self) -> str:
        """Return the first line of its standard output."""
        stream = None if self._process is None else self._process.stdout
        return "" if stream is None else stream.readline().strip()

    def signal(self, number: int) -> None:
        """Send a signal to the viewer."""
        if self._process is not None:
            self._process.send_signal(number)

    def end(self) -> None:
        """Kill the viewer."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdout, process.stderr):
                if stream is not None:
                    stream.close()

    def close(self) -> None:
        """End everything that is still open."""
        self.end()

    @property
    def used(self) -> float:
        """CPU time [s] of the viewer so far; 0 if none is open."""
        return 0.0 if self._process is None else processor_time(self._process.pid)


def processor_time(pid: int) -> float:
    """Return the CPU time [s] that a process has used; 0 if there is no such process."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return 0.0
    user, system = text.rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def _await_line(process: subprocess.Popen[str], begin: str) -> None:
    """Wait until a viewer prints a line that begins with ``begin``.

    Raises
    ------
    ItouchError
        If it ends or takes too long.
    """
    late, said = threading.Timer(OPENING, process.kill), ""
    late.start()
    try:
        for line in process.stderr or ():
            said += line
            if line.startswith(begin):
                return
    finally:
        late.cancel()
    process.wait()
    raise ItouchError(f"the viewer did not open: {said.strip() or 'it said nothing'}")


@contextlib.contextmanager
def display() -> Iterator[dict[str, str]]:
    """Yield an environment with a display: this one, or that of a virtual screen.

    Raises
    ------
    ItouchError
        If there is neither.
    """
    if os.environ.get("DISPLAY"):
        yield dict(os.environ)
        return
    if shutil.which("Xvfb") is None:
        raise ItouchError("bench viewer --servo opens windows: there is no display, and no Xvfb to make one")
    read, write = os.pipe()
    words = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    server = subprocess.Popen(words, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as number:
            yield os.environ | {"DISPLAY": f":{number.readline().strip()}"}
    finally:
        server.terminate()
        server.wait()


def measure(
    seconds: float, rounds: int = 1, triangles: int = 2_000_000, browsers: Callable[[], Viewers] | None = None
) -> list[Row]:
    """Measure every situation for some seconds a round, with a large mesh of ``triangles`` triangles.

    ``browsers`` makes the viewers if they are other programs, such as browsers; the large mesh is then left out.

    Raises
    ------
    ItouchError
        If no viewer can be opened.
    """
    rows = []
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        viewers = browsers() if browsers else Viewers(stack.enter_context(display()))
        stack.callback(viewers.close)
        for count, situations in ((0, _SMALL), (triangles, _GREAT))[: 1 if browsers else 2]:
            path = _write(Path(folder), count)
            found = {situation: Row(situation, count) for situation in situations}
            with launch(path) as handle:
                _begin(handle)
                for _ in range(rounds):
                    for situation in situations:
                        _observe(handle, viewers, found[situation], seconds)
            rows += list(found.values())
    return rows


def _write(folder: Path, triangles: int) -> Path:
    """Write a scene in which a finger touches a block again and again, with a mesh of ``triangles`` triangles."""
    text = scene(touches=2000, remote=False, hold=False)
    if triangles:
        write_stl(folder / "ball.stl", *bumpy_sphere(triangles))
        mesh = '<mesh name="ball" file="ball.stl" scale="1 mm" pos="90 0 40 mm" material="wood"/></world>'
        text = text.replace("</world>", mesh)
    path = folder / f"scene{triangles}.xml"
    path.write_text(text, encoding="utf-8")
    return path


def _begin(handle: Handle) -> None:
    """Wait until the session has run for 1 s: before the first touch the finger stands still."""
    while handle.running and handle.link.seconds < 1.0:
        time.sleep(0.01)


def _observe(handle: Handle, viewers: Viewers, row: Row, seconds: float) -> None:
    if row.situation != NONE:
        viewers.open(handle.name)
    if row.situation == FROZEN:
        time.sleep(SETTLING)
        viewers.signal(signal.SIGSTOP)
    try:
        time.sleep(SETTLING)
        before, used, begin = handle.timing, viewers.used, time.monotonic()
        end = begin + seconds
        while row.situation == KILLED and (time.monotonic() < end or not row.reopened):
            viewers.end()
            viewers.open(handle.name)
            row.reopened += 1
        time.sleep(max(0.0, end - time.monotonic()))
        row.viewer_cpu += viewers.used - used if row.situation != KILLED else math.nan
        row.seconds += time.monotonic() - begin
        _add(row, before, handle.timing)
    finally:
        viewers.end()


def _add(row: Row, before: Timing, after: Timing) -> None:
    row.ticks += after.ticks - before.ticks
    row.overruns += after.overruns - before.overruns
    for index, counts in ((0, row.late), (1, row.work)):
        counts += after.record["counts"][index].astype(np.int64) - before.record["counts"][index]


_HEAD = ("beside the loop", "triangles", "late p50", "p99", "max", "tick p99", "overruns", "viewer's cores")
_WIDTHS = (-28, 10, 10, 8, 9, 10, 16, 16)


def table(rows: list[Row]) -> str:
    """Return the rows as lines of text, times in us."""
    lines: list[tuple[str, ...]] = [_HEAD]
    for row in rows:
        told = row.figures()
        times = [f"{told[name]:.0f}" for name in ("late_p50_us", "late_p99_us", "late_max_us", "tick_p99_us")]
        name = row.situation + (f" {row.reopened} x" if row.reopened else "")
        cores = "-" if math.isnan(row.viewer_cpu) or row.situation == NONE else f"{told['viewer_cores']:.2f}"
        lines.append((name, str(row.triangles), *times, f"{row.overruns} of {row.ticks}", cores))
    return "\n".join("".join(map(_cell, line, _WIDTHS)) for line in lines)


def _cell(text: str, width: int) -> str:
    return f"{text:<{-width}}" if width < 0 else f"{text:>{width}}"
