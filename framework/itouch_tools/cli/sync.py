"""``itouch-py sync``: how long a mark takes to reach the wire on this machine, and how much that varies."""

from __future__ import annotations

import argparse
import os
import random
import select
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from itouch.plugin import Terminal
from itouch.schema import ItouchError
from itouch.schema.wait_notices import waiting
from itouch.session.marks import remembered
from itouch_tools.cli.arguments import Parser, add_json, as_json
from itouch_tools.cli.demo import scenes_folder

if TYPE_CHECKING:
    from itouch.servo import Link

#: The scene that runs if none is named.
_USUAL: Final = "first_touch.xml"
#: The longest time [s] that a code may take before it counts as lost.
LOST: Final = 1.0
_LOOK: Final = 0.05
#: Ticks before the first mark, and time between two marks [s]: longer than a code stays on the wire.
_SETTLED, _PAUSE = 200, 0.015
_COLUMNS: Final = ("min", "p50", "p95", "p99", "max", "sd")


@dataclass(frozen=True, slots=True)
class Delays:
    """The measurement of one way to set marks: delays [s] of the codes that arrived, and how many did not."""

    way: str
    seconds: tuple[float, ...]
    lost: int

    def figures(self) -> dict[str, Any]:
        """Return the distribution [ms]; its figures are None if nothing arrived."""
        said: dict[str, Any] = {"way": self.way, "marks": len(self.seconds) + self.lost, "lost": self.lost}
        found = 1e3 * np.array(self.seconds)
        for name, percent in (("min", 0), ("p50", 50), ("p95", 95), ("p99", 99), ("max", 100)):
            said[f"{name}_ms"] = float(np.percentile(found, percent)) if len(found) else None
        said["sd_ms"] = float(found.std()) if len(found) else None
        return said


def main(argv: Sequence[str]) -> int:
    """Measure the delay between a mark and the wire.

    Without --port the wire is an emulated trigger box on a pseudo-terminal: loop and system are measured, not a cable.
    With --port and --loopback the bytes come back by a plug that joins the port's TX and RX.
    """
    options = _parse(argv)
    with waiting("measuring"):
        rows = measure(options.scene or os.fspath(scenes_folder() / _USUAL), options.marks, options.port, options.seed)
    worst = rows[0].figures()["p99_ms"] or np.inf
    good = not any(row.lost for row in rows) and (options.limit is None or worst <= options.limit)
    told = {"wire": options.port or "emulated trigger box", "limit_ms": options.limit, "good": good,
            "ways": [row.figures() for row in rows]}  # fmt: skip
    if options.json:
        print(as_json(told))
    else:
        print(table(told))
    return 0 if good else 1


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(prog="itouch-py sync", description=main.__doc__)
    parser.add_argument(
        "scene", nargs="?", metavar="SCENE", help="what runs, on twins; default: the smallest that ships"
    )
    parser.add_argument("--marks", type=int, default=200, metavar="N", help="marks sent each way (default 200)")
    parser.add_argument("--port", metavar="PORT", help="a serial port; default: an emulated trigger box")
    parser.add_argument("--loopback", action="store_true", help="what --port sends comes back: TX is joined with RX")
    parser.add_argument("--limit", type=float, metavar="MS",
                        help="also exit with 1 if p99 is above this, not only if a code is lost")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of when marks are set (default 0)")
    add_json(parser)
    options = parser.parse_args(argv)
    if not 10 <= options.marks <= 100_000:
        raise ItouchError(f"--marks {options.marks}: 10 to 100000 give a distribution")
    if options.limit is not None and not options.limit > 0.0:
        raise ItouchError("--limit is a time above 0, in ms")
    if bool(options.port) != options.loopback:
        raise ItouchError("--port PORT --loopback go together: without a plug from TX to RX nothing comes back")
    return options


def measure(scene: str, count: int, port: str | None, seed: int) -> list[Delays]:
    """Ask a session in real time for marks, and wait for their codes.

    Raises
    ------
    ItouchError
        If the scene is wrong, or the port can't be opened.
    """
    from itouch.servo import launch
    from itouch.session.outputs import Outputs

    terminal = None if port else Terminal()
    try:
        wire = port or (terminal.path if terminal else "")
        keep = Outputs(records=False, trigger=wire)
        with (
            LoopbackReader(port, terminal) as reader,
            launch(scene, twin="all", seconds=600.0 + count, keep=keep) as handle,
        ):
            while handle.running and handle.link.tick < _SETTLED:
                time.sleep(_LOOK)
            return _marks(handle.link, reader, count, random.Random(seed))
    finally:
        if terminal is not None:
            terminal.close()


class LoopbackReader:
    """Reads the far end of the wire, which may be looped back: it says when a code arrives."""

    def __init__(self, port: str | None, terminal: Terminal | None) -> None:
        self._port, self._terminal = port, terminal
        self._handle = -1

    def __enter__(self) -> LoopbackReader:
        if self._port is None:
            return self
        try:
            self._handle = os.open(self._port, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise ItouchError(f"'{self._port}' cannot be read: {error.strerror}") from error
        return self

    def __exit__(self, *_: object) -> None:
        if self._handle >= 0:
            os.close(self._handle)

    def wait(self, code: int) -> int | None:
        """Wait for a code and return when it arrived [ns, monotonic clock]; None if it did not within ``LOST``."""
        handle = self._terminal.fileno() if self._terminal is not None else self._handle
        end = time.monotonic() + LOST
        while (left := end - time.monotonic()) > 0.0:
            ready = select.select([handle], [], [], left)[0]
            now = time.monotonic_ns()
            if ready and code in self._take():
                return now
        return None

    def _take(self) -> bytes:
        if self._terminal is not None:
            return self._terminal.receive()
        try:
            return os.read(self._handle, 4096)
        except BlockingIOError:
            return b""


def _marks(link: Link, reader: LoopbackReader, count: int, rng: random.Random) -> list[Delays]:
    """Set marks at random times; return their delays since they were asked for, and since their tick."""
    state, follower = link.state, link.follow()
    asked: list[float] = []
    ticked: list[float] = []
    ended: dict[int, int] = {}
    for number in range(count):
        time.sleep(_PAUSE + rng.random() * link.period)
        code, before = 1 + number % 255, int(state["marks.count"])
        begun = time.monotonic_ns()
        link.command("mark", {"name": "sync", "payload": {"code": code}})
        came = reader.wait(code)
        if came is None:
            continue
        asked.append(1e-9 * (came - begun))
        deadline = time.monotonic() + LOST
        while link.refresh(state) and int(state["marks.count"]) == before and time.monotonic() < deadline:
            time.sleep(link.period)
        ended.update((entry.tick, entry.host_ns) for entry in follower.take())
        tick = remembered(state)[-1]["tick"]  # the next tick to come: it begins when the one before it has ended
        if tick in ended:
            ticked.append(1e-9 * (came - ended[tick]))
    lost = count - len(asked)
    return [Delays("asked for by another program", tuple(asked), lost), Delays("since its tick", tuple(ticked), lost)]


def table(told: dict[str, Any]) -> str:
    """Return the measurement as a table to print."""
    lines = [f"delay between a mark and the wire: {told['wire']}",
             f"{'':<30} {'marks':>6} {'lost':>5}" + "".join(f" {name:>8}" for name in _COLUMNS)]  # fmt: skip
    for row in told["ways"]:
        numbers = "".join(f" {'-':>8}" if row[f"{n}_ms"] is None else f" {row[f'{n}_ms']:>8.3f}" for n in _COLUMNS)
        lines.append(f"{row['way']:<30} {row['marks']:>6} {row['lost']:>5}{numbers}")
    lines.append("times in ms; negative: on the wire before its tick had ended")
    if told["limit_ms"] is not None:
        lines.append(f"{'within' if told['good'] else 'NOT within'} the limit of {told['limit_ms']:g} ms (p99)")
    return "\n".join(lines)
