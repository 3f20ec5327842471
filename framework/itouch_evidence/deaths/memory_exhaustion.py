"""Eating memory on demand, up to a limit that the machine does not feel: then Python can't allocate any more.

(The kernel's own answer to a machine without memory is SIGKILL, which the deaths try by itself.)
"""

from __future__ import annotations

import resource
import signal
from pathlib import Path

#: What may be eaten [bytes].
LIMIT = 64 << 20
#: The signal that makes hungry.
HUNGER = signal.SIGUSR2


def starve_on_signal() -> None:
    """Let this process eat memory until it can't go on, when the signal comes."""
    signal.signal(HUNGER, _starve)


def _starve(number: int, frame: object) -> None:
    held = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + LIMIT, held + LIMIT))
    eaten = []
    while True:
        eaten.append(bytes(1 << 20))
