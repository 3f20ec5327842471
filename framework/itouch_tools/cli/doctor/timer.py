"""A bare timer for comparison: a loop that only waits, and then computes for as long as a tick does.

``python -m itouch_tools.cli.doctor.timer RATE SECONDS WORK`` runs it with the priority of a servo process, and prints
the number of its periods and how many of them ended after the next one was due: because the loop was woken late,
because it lost the processor during the WORK seconds, and because of the work itself.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from itouch.loop.clock import Clock, WallClock, now, processor_time
from itouch.loop.pacing import HOPELESS
from itouch.loop.timing import Timing
from itouch.servo.realtime import be_punctual

_BUSY = "while True: sum(range(10000))"


def waited(clock: Clock, period: float, count: int, work: float) -> tuple[int, int, int]:
    """Wait for ``count`` periods [s], and compute for ``work`` [s] after each; return how many ended too late.

    First those that were woken late, then those that lost the processor, then those that were late because of the work:
    judged by the same rule as the ticks of the servo loop.
    """
    times = Timing(["work"])
    clock.start(period)
    for _ in range(count):
        late = clock.wait()
        begin, since = processor_time(), now()
        while processor_time() - begin < work:
            pass
        end = now()
        times.pace(late, period, (since, end), end=end, busy=processor_time() - begin)
        if late > HOPELESS * period:  # periods that were missed are not made up for
            times.skip(round(late / period))
            clock.start(period)
    late, taken = times.machine().values()
    return late, taken, times.overruns - late - taken


def beside_the_loop(rate: float, seconds: float, work: float) -> tuple[int, int, int, int]:
    """Run the timer in a process of its own; return the number of periods, then what ``waited`` returns."""
    words = [sys.executable, "-m", "itouch_tools.cli.doctor.timer", str(rate), str(seconds), str(work)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=seconds + 120.0)
    periods, late, taken, own = map(int, done.stdout.split())
    return periods, late, taken, own


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let ``count`` processes compute while the context lasts."""
    processes = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def main(argv: Sequence[str]) -> None:
    """Run the timer in this process, and print the result."""
    rate, seconds, work = (float(word) for word in argv)
    be_punctual()
    count = round(rate * seconds)
    print(count, *waited(WallClock(), 1.0 / rate, count, work))


if __name__ == "__main__":
    main(sys.argv[1:])
