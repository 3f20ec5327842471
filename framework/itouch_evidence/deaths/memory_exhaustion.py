"""Uses up memory on demand, up to a limit that does not harm the machine: then Python can't allocate any more.

(The kernel's own response when a machine runs out of memory is SIGKILL, which the campaign tries separately.)
"""

from __future__ import annotations

import resource
import signal
from pathlib import Path

#: How much memory may be used up [bytes].
LIMIT = 64 << 20
#: The signal on which a process starts to use up memory.
HUNGER = signal.SIGUSR2


def starve_on_signal() -> None:
    """Make this process use up memory until it can't go on, when the signal comes."""
    signal.signal(HUNGER, _starve)


def _starve(number: int, frame: object) -> None:
    held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + LIMIT, held + LIMIT))
    eaten = []
    while True:
        eaten.append(bytes(1 << 20))
