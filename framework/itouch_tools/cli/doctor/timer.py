"""A loop that only waits for its next period: what this machine's timer gives by itself, for comparison.

``python -m itouch_tools.cli.doctor.timer RATE SECONDS WORK`` runs it in a process of the servo's priority and prints
how many of its periods there were, and of how many the wake-up was so late that a tick of WORK seconds would have
overrun.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from itouch.loop.clock import Clock, WallClock
from itouch.servo.realtime import be_punctual

_BUSY = "while True: sum(range(10000))"


def waited(clock: Clock, period: float, count: int, work: float) -> int:
    """Wait for so many periods [s]; return after how many a tick of ``work`` [s] would have ended too late."""
    late, found = 0.0, 0
    clock.start(period)
    for _ in range(count):
        late = clock.wait()
        found += late + work > period
        if late > period:  # what is missed is not caught up with
            clock.start(period)
    return found


def beside_the_loop(rate: float, seconds: float, work: float) -> tuple[int, int]:
    """Run it in a process of its own; return how many periods there were, and after how many it was woken too late."""
    words = [sys.executable, "-m", "itouch_tools.cli.doctor.timer", str(rate), str(seconds), str(work)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=seconds + 120.0)
    periods, late = done.stdout.split()
    return int(periods), int(late)


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let so many processes compute beside."""
    processes = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def main(argv: Sequence[str]) -> None:
    """Run it here, and print."""
    rate, seconds, work = (float(word) for word in argv)
    be_punctual()
    count = round(rate * seconds)
    print(count, waited(WallClock(), 1.0 / rate, count, work))


if __name__ == "__main__":
    main(sys.argv[1:])
