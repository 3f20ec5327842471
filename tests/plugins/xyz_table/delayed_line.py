"""A line that delays all that it carries, for tests of drivers whose answers come late."""

from __future__ import annotations

import time
from collections.abc import Callable


def delayed(late: float) -> Callable[[bytes], bytes]:
    """Return what is called with the bytes that come, and gives those that came ``late`` [s] ago."""
    waiting: list[tuple[float, bytes]] = []

    def hold(data: bytes) -> bytes:
        now = time.monotonic()
        if data:
            waiting.append((now + late, data))
        out = b""
        while waiting and waiting[0][0] <= now:
            out += waiting.pop(0)[1]
        return out

    return hold
