"""A session whose loop runs in a thread of this process: on systems where no guardian can watch over a servo process.

It drives twins only.  The loop shares its interpreter with the program that shows the session, so that ticks may be
later than in a process of their own.
"""

from __future__ import annotations

import os
import socket
import threading
from typing import Any

from itouch.servo.launcher_pipe import Outbox
from itouch.servo.shared_memory import SharedMemory


class ThreadProcess:
    """The thread, with the interface of the servo process that a launcher expects."""

    def __init__(self, segment: SharedMemory, line: socket.socket, config: dict[str, Any]) -> None:
        self.pid = os.getpid()
        self._code = 0
        self._thread = threading.Thread(
            target=self._work, args=(segment, line, config), name="itouch-servo", daemon=True
        )
        self._thread.start()

    def _work(self, segment: SharedMemory, line: socket.socket, config: dict[str, Any]) -> None:
        from itouch.servo import control_block as at
        from itouch.servo.process import serve

        segment.words[at.SERVO] = self.pid
        alone = {**config, "launcher": os.getppid(), "realtime": False}
        self._code = serve(segment, Outbox(line), alone)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the loop's end; return the exit code that a process would have had."""
        self._thread.join(timeout)
        return self._code

    def kill(self) -> None:
        """Do nothing: a thread ends by itself, and devices are twins."""


class NoGuardian:
    """The guardian that a thread does not have, because it drives only twins."""

    pid = 0
    #: What a guardian had to do: nothing.
    said = ""

    def wait(self) -> None:
        """Return at once."""
