"""``itouch-py bench start`` measures processes that end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from requirements import meant


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason=meant("there is no /proc"))
def test_ctrl_c_is_one_line_and_ends_what_is_measured() -> None:
    """A terminal sends it to every process of the command; the one that was measured printed a traceback."""
    command = [sys.executable, "-m", "itouch_tools.cli", "bench", "start"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as bench:
        children = Path(f"/proc/{bench.pid}/task/{bench.pid}/children")
        while not (found := [int(one) for one in children.read_text().split()]):
            assert bench.poll() is None
            time.sleep(0.01)
        maps = Path(f"/proc/{found[0]}/maps")
        while "numpy" not in maps.read_text():  # it has begun, and Python answers signals
            time.sleep(0.01)
        limit = time.monotonic() + 60.0
        os.killpg(bench.pid, signal.SIGINT)
        told = bench.communicate(timeout=60.0)[0]
    assert bench.returncode == 130
    assert told.splitlines()[-1] == "interrupted" and "Traceback" not in told
    while maps.exists() and maps.read_text():  # killed; it may be left to be reaped
        assert time.monotonic() < limit
        time.sleep(0.01)
