"""``itouch-py bench viewer --servo --rerun`` and ``--ros2``: the loop beside programs to which a session is sent."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch_evidence.viewer_servo import OPENING, Viewers, processor_time


class Told(Viewers):
    """Opens a program on a port of this machine, and `itouch-py view`, which sends it a session.

    The program is killed or frozen, with all its processes; `view` is killed with it, but never frozen.
    """

    #: Arguments of Python that start the program, before the number of its port, and the extra that it needs.
    program: tuple[str, ...] = ()
    extra = ""

    def __init__(self) -> None:
        need(self.extra, f"bench viewer --servo --{self.extra}")
        super().__init__(dict(os.environ))
        self._port = 0
        self._other: subprocess.Popen[bytes] | None = None

    def told(self, port: int) -> list[str]:
        """Return the options by which `view` finds the program."""
        raise NotImplementedError

    def words(self, name: str) -> list[str]:
        """Return the command that sends a session."""
        return [sys.executable, "-m", "itouch_tools.cli", "view", name, *self.told(self._port)]

    def open(self, name: str) -> None:
        """Open the program, and `view` once the program listens."""
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = int(probe.getsockname()[1])
        with tempfile.TemporaryFile() as said:
            self._other = subprocess.Popen(
                [sys.executable, *self.program, str(self._port)], stdout=subprocess.DEVNULL, stderr=said,
                start_new_session=True,
            )  # fmt: skip
            end = time.monotonic() + OPENING
            while not _listens(self._port):
                if self._other.poll() is not None or time.monotonic() > end:
                    self.end()
                    said.seek(0)
                    last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
                    why = f": {last}" if last else ""
                    raise ItouchError(f"the program that --{self.extra} tells did not open its port{why}")
                time.sleep(0.05)
        super().open(name)

    def signal(self, number: int) -> None:
        """Send a signal to all processes of the program."""
        if self._other is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._other.pid, number)

    def end(self) -> None:
        """Kill `view` and the program."""
        super().end()
        self.signal(signal.SIGKILL)
        other, self._other = self._other, None
        if other is not None:
            other.wait()

    @property
    def used(self) -> float:
        """CPU time [s] of `view` and of the program."""
        return super().used + (0.0 if self._other is None else sum(map(processor_time, _group(self._other.pid))))


class Reruns(Told):
    """Opens Rerun, drawing off-screen."""

    program = ("-m", "rerun", "--headless", "--window-size", "1280x720", "--port")
    extra = "rerun"

    def told(self, port: int) -> list[str]:
        """Return the options for Rerun."""
        return ["--rerun", "--to", f"rerun+http://127.0.0.1:{port}/proxy"]


class Listeners(Told):
    """Opens a Zenoh router with a listener to all topics, as ROS 2 has them."""

    program = ("-m", "itouch_evidence.bench_ros2")
    extra = "ros2"

    def told(self, port: int) -> list[str]:
        """Return the options for ROS 2."""
        return ["--ros2", "--router", f"127.0.0.1:{port}"]


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), 0.5).close()
    except OSError:
        return False
    return True


def _group(leader: int) -> list[int]:
    """Return the ids of the processes in a process group."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with contextlib.suppress(OSError):  # it has ended meanwhile
                if os.getpgid(int(entry.name)) == leader:
                    found.append(int(entry.name))
    return found
