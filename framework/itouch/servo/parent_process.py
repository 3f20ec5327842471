"""Orphans: helper processes notice the death of the process that started them, and end.

The parent passes its id on the command line, so that its death is noticed from the helper's first instruction on: a
helper that asked for its parent only after its imports might already get the process that has inherited it.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from typing import Any

#: How often [s] a helper looks for its parent.
LOOK = 0.1


def gone(parent: int) -> bool:
    """Tell whether the process that started this one has gone."""
    return os.getppid() != parent


def end_with(parent: int, *, while_: Callable[[], bool] = lambda: True) -> None:
    """End this process at once when its parent has gone.

    Parameters
    ----------
    parent
        The parent's id, as the parent gave it.
    while_
        Called again and again; once it returns false, the parent is no longer watched.
    """

    def watched() -> bool:
        watches = while_()
        if watches and gone(parent):
            os._exit(1)
        return watches

    def look() -> None:
        while watched():
            time.sleep(LOOK)

    if watched():
        threading.Thread(target=look, name="itouch-parent", daemon=True).start()


class ProcessEnd:
    """Notices the end of a process at once, which the kernel tells by a file descriptor; asking takes a microsecond."""

    def __init__(self, process: Callable[[], int]) -> None:
        self._process = process
        self._poller: Any = None

    def seen(self) -> bool:
        """Tell whether the process has ended; false while its id is not known."""
        if self._poller is None:
            number = self._process()
            if not number:
                return False
            poller = select.poll()
            try:
                poller.register(os.pidfd_open(number), select.POLLIN)
            except OSError:  # it has gone already
                return True
            self._poller = poller
        return bool(self._poller.poll(0))
