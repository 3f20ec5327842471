"""``itouch-py bench ros2``: how late messages of a running session arrive in another process, and how many.

The session runs in real time; `itouch-py view --ros2` publishes it, and this process listens as any Zenoh client
would, through a router of its own.  Lateness is from the stamp, the time when the state was published, to the arrival.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from itouch.scene import bundled_scenes
from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

#: How long [s] to wait for the first message, and what is left out after it.
OPENING, SETTLING = 180.0, 1.0


@dataclass(slots=True)
class Line:
    """Messages of one topic: their type, arrival times [ns], and lateness [s] if they have a stamp."""

    kind: str
    came: list[int] = field(default_factory=list)
    late: list[float] = field(default_factory=list)

    def figures(self, topic: str, seconds: float) -> dict[str, Any]:
        """Return the figures of a topic over some seconds: messages a second, longest gap, and lateness in ms."""
        found = 1e3 * np.array(self.late)
        told = {f"late_{name}_ms": float(np.percentile(found, percent)) if len(found) else None
                for name, percent in (("p50", 50), ("p99", 99), ("max", 100))}  # fmt: skip
        gaps = np.diff(self.came) * 1e-6
        return {"topic": topic, "type": self.kind, "messages": len(self.came), "rate_hz": len(self.came) / seconds,
                "longest_gap_ms": float(gaps.max()) if len(gaps) else None, **told}  # fmt: skip


def main(argv: Sequence[str]) -> int:
    """Measure the topics of ROS 2 that `view --ros2` publishes of a running session."""
    parser = Parser(prog="itouch-py bench ros2", description=main.__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S", help="how long to listen (default 10)")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="messages a second (default 100)")
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures there, too")
    options = parser.parse_args(argv)
    if not 0.5 <= options.seconds <= 3600.0 or not 1.0 <= options.rate <= 1000.0:
        parser.error("--seconds must be 0.5 to 3600, --rate 1 to 1000")
    need("ros2", "bench ros2")
    rows = measure(options.seconds, options.rate)
    if options.json:
        write_output(options.json, json.dumps(rows, indent=1) + "\n")
    print(f"{'topic':<30} {'messages':>8} {'Hz':>6} {'late p50':>9} {'p99':>8} {'max':>8} {'gap max':>8}   ms")
    for row in rows:
        times = (row[name] for name in ("late_p50_ms", "late_p99_ms", "late_max_ms", "longest_gap_ms"))
        said = " ".join(f"{'-':>8}" if one is None else f"{one:>8.2f}" for one in times)
        print(f"{row['topic']:<30} {row['messages']:>8} {row['rate_hz']:>6.1f}  {said}")
    return 0


def measure(seconds: float, rate: float) -> list[dict[str, Any]]:
    """Return the figures of each topic over some seconds, published at a rate [Hz].

    Raises
    ------
    ItouchError
        If no message comes.
    """
    from itouch.servo import launch

    folder = bundled_scenes.folder()
    if folder is None:
        raise ItouchError("the shipped scenes are missing from this installation; install itouch-py again")
    scene = folder / "four_materials.xml"
    with listening() as (port, lines), launch(scene, linger=True, seconds=600.0 + seconds) as handle:
        words = [sys.executable, "-m", "itouch_tools.cli", "view", handle.name, "--ros2", "--router",
                 f"127.0.0.1:{port}", "--rate", str(rate)]  # fmt: skip
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as told:
            try:
                _await(lambda: any(line.came for line in lines.values()), told)
                time.sleep(SETTLING)
                begin = time.time_ns()
                time.sleep(seconds)
                end = time.time_ns()
            finally:
                told.kill()
    for line in lines.values():
        inside = [index for index, when in enumerate(line.came) if begin <= when < end]
        line.late = [line.late[index] for index in inside] if line.late else []
        line.came = [line.came[index] for index in inside]
    return [line.figures(topic, (end - begin) * 1e-9) for topic, line in sorted(lines.items())]


@contextlib.contextmanager
def listening(port: int = 0) -> Iterator[tuple[int, dict[str, Line]]]:
    """Yield the port of a router on this machine, by default a free one, and the messages by topic."""
    import zenoh

    from itouch_tools.export.ros_messages import store

    types, lines, lock = store(), dict[str, Line](), threading.Lock()

    def take(sample: Any) -> None:
        now, parts = time.time_ns(), str(sample.key_expr).split("/")
        kind = parts[-2].replace("::", "/").replace("/dds_", "").rstrip("_")
        with lock:
            line = lines.setdefault("/" + "/".join(parts[1:-2]), Line(kind))
        message = types.deserialize_cdr(sample.payload.to_bytes(), kind)
        head = getattr(message, "header", None)
        line.came.append(now)
        if head is not None:
            line.late.append(1e-9 * (now - head.stamp.sec * 10**9 - head.stamp.nanosec))

    port = port or _free()
    with (
        zenoh.open(_config(zenoh, "router", "listen", port)),
        zenoh.open(_config(zenoh, "client", "connect", port)) as client,
    ):
        subscriber = client.declare_subscriber("*/**", take)
        yield port, lines
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def _config(zenoh: Any, mode: str, way: str, port: int) -> Any:
    found = zenoh.Config()
    found.insert_json5("mode", json.dumps(mode))
    found.insert_json5(f"{way}/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    found.insert_json5("scouting/multicast/enabled", "false")
    return found


def _free() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _await(there: Any, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + OPENING
    while not there():
        if process.poll() is not None or time.monotonic() > end:
            said = process.stderr.read() if process.poll() is not None and process.stderr else "nothing came"
            raise ItouchError(f"no topic came: {said.strip()}")
        time.sleep(0.05)


if __name__ == "__main__":  # listens at a port until it is killed
    with listening(int(sys.argv[1])):
        threading.Event().wait()
