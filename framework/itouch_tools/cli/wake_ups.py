"""``python -m itouch_tools.cli.wake_ups``: how late this machine wakes a process without priority, until stdin ends.

Beside a run in real time it stands for everything else without priority: among it the kernel's own threads, which carry
what is written to a serial line or a socket.
"""

from __future__ import annotations

import json
import select
import subprocess
import sys
import time
from types import TracebackType

#: How long each sleep is meant to last [s].
SLEEP = 1e-3
#: The machine's wake-ups hold if 999 of 1000 are no later than ``MOSTLY``, and none later than ``LATEST`` [us].
MOSTLY, LATEST = 1e3, 10e3


def main() -> int:
    """Sleep again and again; print percentiles of the lateness [us] as JSON."""
    late = list[float]()
    while not select.select([sys.stdin], [], [], 0.0)[0]:
        begun = time.perf_counter()
        time.sleep(SLEEP)
        late.append(1e6 * max(0.0, time.perf_counter() - begun - SLEEP))
    late.sort()
    parts = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    found = {name: late[min(len(late) - 1, int(part * len(late)))] for name, part in parts.items()} if late else {}
    print(json.dumps(found))
    return 0


class WakeUps:
    """Measures wake-ups in another process while the context lasts."""

    def __init__(self) -> None:
        #: Percentiles of the lateness [us]; empty before the end.
        self.late: dict[str, float] = {}

    def __enter__(self) -> WakeUps:
        command = [sys.executable, "-m", "itouch_tools.cli.wake_ups"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        said, _ = self._process.communicate()
        self.late = json.loads(said or "{}")

    @property
    def held(self) -> bool:
        """Whether the machine's wake-ups were punctual enough."""
        return bool(self.late) and self.late["p99.9"] <= MOSTLY and self.late["max"] <= LATEST


if __name__ == "__main__":
    sys.exit(main())
