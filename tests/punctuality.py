"""Whether this machine wakes a process when it should: what is tested in real time needs that, and says so if it is left out."""

from __future__ import annotations

import threading
import time

from needed import not_here


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
