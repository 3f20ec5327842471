"""Starting the guardian of a session, and passing on what it says that it had to do."""

from __future__ import annotations

import os
import subprocess
import sys

from itouch.servo import control_block as at
from itouch.servo.shared_memory import SharedMemory

_ANSWER = 4096
#: Argument for a guardian that watches its caller's own process, which it does not end.
OWN = "own"
#: How long [s] the guardian may take to end after the servo process.
_END = 5.0


class Guarded:
    """The guardian of one servo process, as the launcher sees it."""

    def __init__(self, process: int, segment: SharedMemory, environment: dict[str, str], *manner: str) -> None:
        near, far = os.pipe()
        servo, owner = os.pidfd_open(process), os.pidfd_open(os.getpid())
        passed = (segment.handle, servo, owner, far)
        words = [sys.executable, "-P", "-m", "itouch.servo.guardian", *map(str, passed), segment.name, *manner]
        try:
            self._process = subprocess.Popen(
                words, pass_fds=passed, stdin=subprocess.DEVNULL, start_new_session=True, env=environment
            )
        except OSError:
            os.close(near)
            raise
        finally:
            for handle in (servo, owner, far):
                os.close(handle)
        self._near = near
        segment.words[at.GUARDIAN] = self._process.pid
        #: What it had to do, in words; empty if nothing.
        self.said = ""

    @property
    def pid(self) -> int:
        """The guardian's process id."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def wait(self) -> None:
        """Wait for its end, and take over what it reports."""
        try:
            self._process.wait(_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.said = os.read(self._near, _ANSWER).decode()
        os.close(self._near)


def child_environment() -> dict[str, str]:
    """Return an environment in which a child finds the modules that this process finds."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(os.path.abspath(entry) for entry in sys.path)}
