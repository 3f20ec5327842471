"""Helper processes end with the process that started them.

That process gives its id with the command line, so that its death is seen from the helper's first instruction on: who
asks for its parent only after its imports may be told of whoever has inherited it.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable

#: How often [s] a helper looks for its parent.
LOOK = 0.1
#: What the kernel says of a process that has ended.
_ENDED = frozenset("ZXx")


def gone(parent: int) -> bool:
    """Tell whether the process that started this one has gone."""
    return os.getppid() != parent


def end_with(
    parent: int, *, while_: Callable[[], bool] = lambda: True, first: Callable[[], None] | None = None
) -> None:
    """End this process at once when its parent has gone.

    Parameters
    ----------
    parent
        The parent's id, as the parent gave it.
    while_
        Asked again and again; once it is false nobody looks any more.
    first
        Called when the parent has gone; if it returns, this process ends.
    """

    def look() -> None:
        while while_():
            if gone(parent):
                if first is not None:
                    first()
                os._exit(1)
            time.sleep(LOOK)

    if gone(parent) and while_():
        if first is not None:
            first()
        os._exit(1)
    threading.Thread(target=look, name="itouch-parent", daemon=True).start()


class EndOf:
    """Sees the end of a process at once, which the kernel tells by a file descriptor; asking costs a microsecond."""

    def __init__(self, process: Callable[[], int]) -> None:
        self._process, self._poller = process, select.poll()
        self._known = False

    def seen(self) -> bool:
        """Tell whether the process has ended; false while it is not known."""
        if not self._known:
            number = self._process()
            if not number:
                return False
            try:
                self._poller.register(os.pidfd_open(number), select.POLLIN)
            except OSError:  # it has gone already
                return True
            self._known = True
        return bool(self._poller.poll(0))


def lives(process: int) -> bool:
    """Tell whether a process exists and has not ended; one that nobody has buried yet has ended."""
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as stream:
            return stream.read(512).rpartition(")")[2].split()[0] not in _ENDED
    except (OSError, IndexError):
        return False
