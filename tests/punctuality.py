"""Whether this machine wakes a process when it should: what is tested in real time needs that, and says so if it is left out.

A test marked ``punctual`` is tried again where it fails while the machine keeps a loop waiting, or has kept the test
itself waiting, and is left out after the third time.  What fails on a machine that keeps nobody waiting, or fails
every time and once on such a machine, has failed.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol
from requirements import not_here

#: How late [s] a loop may come to its turn where tests that are marked ``punctual`` must pass, and how often they may try.
LATE, TRIES = 0.01, 3
#: A loop that works for half of each millisecond for so many seconds, as that of a session does; it prints how late it was.
_LOOP = """
import sys, time
end, worst = time.perf_counter() + float(sys.argv[1]), 0.0
while (begin := time.perf_counter()) < end:
    time.sleep(5e-4)
    while (now := time.perf_counter()) < begin + 1e-3:
        pass
    worst = max(worst, now - begin - 1e-3)
print(worst)
"""


def latest(seconds: float) -> float:
    """Return how late a thread that sleeps for a millisecond, beside one that does so as well, was woken at most [s]."""
    over = threading.Event()
    beside = threading.Thread(target=_turns, args=(seconds, over), daemon=True)
    beside.start()
    try:
        return _turns(seconds, over)
    finally:
        over.set()
        beside.join()


def _turns(seconds: float, over: threading.Event) -> float:
    begin = last = time.perf_counter()
    worst = 0.0
    while last - begin < seconds and not over.is_set():
        time.sleep(1e-3)
        now = time.perf_counter()
        worst = max(worst, now - last - 1e-3)
        last = now
    return worst


def skip_unless_punctual(within: float) -> None:
    """Leave the test out if this machine now wakes a thread later than it may [s]; go on, and fail, if it does not."""
    late = latest(3.0)
    if late > within:
        not_here(f"this machine wakes a thread {1e3 * late:.0f} ms late now; the test needs {1e3 * within:.0f} ms")


def kept_waiting(seconds: float) -> float:
    """Return for how long [s] a process of its own that works half of the time was kept waiting at most."""
    words = [sys.executable, "-I", "-S", "-c", _LOOP, str(seconds)]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def waited() -> float:
    """Return for how long [s] the threads of this process have waited for a processor; 0.0 where no system tells.

    Linux: the second number of ``schedstat``.  A machine that is in time when a test is over may not have been before.
    """
    total = 0
    for thread in Path("/proc/self/task").glob("*/schedstat"):
        with contextlib.suppress(OSError, IndexError, ValueError):  # it has ended; another system writes other things
            total += int(thread.read_text(encoding="ascii").split()[1])
    return 1e-9 * total


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test that is marked ``punctual`` until it passes, or fails on a machine that is in time; or leave it out."""
    if item.get_closest_marker("punctual") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for last in (False,) * (TRIES - 1) + (True,):
        before = waited()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = [report for report in reports if report.failed]
        meanwhile = waited() - before
        if not failed or ((late := kept_waiting(3.0)) <= LATE and (last or meanwhile <= LATE)):
            break
    else:
        said = f"this machine keeps a loop waiting for {1e3 * late:.0f} ms now; the test needs {1e3 * LATE:.0f} ms"
        for report in failed:
            report.outcome, report.longrepr = "skipped", (str(item.path), item.location[1] or 0, f"Skipped: {said}")
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
