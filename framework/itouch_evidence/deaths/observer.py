"""An observer of remote twins: a thread that notes what acts on each, on the clock that all processes share."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Iterable

from itouch.servo import twin_protocol


class Observer:
    """Watches the twins of one session until they close their connections."""

    def __init__(self, session: str, devices: Iterable[str]) -> None:
        self._lines = {twin_protocol.connect(twin_protocol.address(session, name), 10.0): name for name in devices}
        #: For each device the (time [ns], flags) of its steps, in order.
        self.seen: dict[str, list[tuple[int, int]]] = {name: [] for name in self._lines.values()}
        for line in self._lines:
            line.send(twin_protocol.WATCH)
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        open_lines = dict(self._lines)
        while open_lines:
            for line in select.select(list(open_lines), [], [], 1.0)[0]:
                if not self._take(line, open_lines[line]):
                    del open_lines[line]

    def _take(self, line: socket.socket, name: str) -> bool:
        try:
            packet = line.recv(twin_protocol.PACKET)
        except OSError:
            packet = b""
        if packet[:1] == twin_protocol.OBSERVED:
            host, flags, _ = twin_protocol.split(packet)
            self.seen[name].append((host, flags))
        return bool(packet)

    def wait(self, timeout: float) -> bool:
        """Wait until every twin has closed its connection; tell whether all have."""
        self._thread.join(timeout)
        for line in self._lines:
            with contextlib.suppress(OSError):
                line.close()
        return not self._thread.is_alive()

    def safe_after(self, event_ns: int, flag: int = twin_protocol.OUTPUTS_SAFE) -> dict[str, float | None]:
        """Return, for each device, how long [s] after an event it was safe for good; None if it never was."""
        return {name: _safe_after(steps, event_ns, flag) for name, steps in self.seen.items()}


def _safe_after(steps: list[tuple[int, int]], event_ns: int, flag: int) -> float | None:
    last = None
    for host, flags in reversed(steps):
        if not flags & flag:
            break
        last = host
    return None if last is None else max(0.0, (last - event_ns) * 1e-9)
