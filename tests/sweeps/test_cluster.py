"""A Dask cluster of a scheduler and workers on this machine: what is killed costs time, never a row."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sweeping import COLLECT, VARIED, written
from test_sweeping import Breaking, swept

from itouch_tools.sweeps.sweep_store import rows, table
from itouch_tools.sweeps.worker import close_runners


class Cluster:
    """Processes begun by the commands of docs/how-to/run-a-sweep-on-a-cluster.md."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.begun: list[subprocess.Popen[bytes]] = []

    def begin(self, workers: int) -> None:
        self._dask("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        for _ in range(workers):
            self._dask("worker", self.address, "--nthreads", "1", "--no-dashboard")

    def _dask(self, *words: str) -> None:
        command = [sys.executable, "-m", "dask", *words]
        self.begun.append(
            subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        )

    def kill(self, which: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.begun[which].pid, signal.SIGKILL)
        self.begun[which].wait()

    def end(self) -> None:
        for which in range(len(self.begun)):
            self.kill(which)
        self.begun = []


@pytest.fixture
def cluster() -> Iterator[Cluster]:
    found = Cluster()
    yield found
    found.end()
    close_runners()


def wait_for(what: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.1)


def count(folder: Path) -> int:
    return sum(1 for _ in rows(folder, ["digest"]))


@pytest.mark.long
def test_a_worker_and_the_scheduler_are_killed_in_the_middle(tmp_path: Path, cluster: Cluster) -> None:
    total = 480
    path = written(tmp_path / "a", VARIED.replace('<seeds count="2"/>', f'<seeds count="{total // 4}"/>') + COLLECT)
    cluster.begin(3)
    command = [sys.executable, "-m", "itouch_tools.cli", "sweep", str(path), "-o", str(tmp_path / "out")]
    command += ["--engine", "dask", "--scheduler", cluster.address]
    with open(tmp_path / "log", "wb") as log:
        client = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        wait_for(lambda: count(tmp_path / "out") >= 20 or client.poll() is not None, 600.0)
        cluster.kill(2)  # a worker, with its nanny
        before = count(tmp_path / "out")
        wait_for(lambda: count(tmp_path / "out") >= before + 60 or client.poll() is not None, 600.0)
        cluster.kill(0)  # the scheduler
        cluster.end()
        assert client.poll() is None, (tmp_path / "log").read_text(encoding="utf-8")
        assert count(tmp_path / "out") < total
        cluster.begin(3)
        assert client.wait(1200.0) == 0, (tmp_path / "log").read_text(encoding="utf-8")
    finally:
        client.kill()
        client.wait()
    assert "engine lost: " in (tmp_path / "log").read_text(encoding="utf-8")
    assert swept(path, tmp_path / "alone", Breaking()).rows == total
    assert table(tmp_path / "out").equals(table(tmp_path / "alone"))
