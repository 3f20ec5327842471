"""The dead-man's switch for a person at a window that may draw slowly."""

from __future__ import annotations

import threading
import time

from itouch.servo import Link

#: Period [s] at which holding is reported again, and how long [s] a window may be silent before the switch is let go.
AGAIN, SILENCE = 0.02, 0.25


class DeadMansSwitch:
    """Holds the switch while a key is down and the window answers.

    The servo process takes the switch as let go a time `HOLD` after it was last told otherwise, and a picture drawn by
    software may take longer than that.  So a thread repeats that the switch is held, as long as ``beat`` is called: a
    process that dies lets go within that time, a window that hangs a quarter of a second later.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._lock = threading.Lock()
        self._held = self._over = False
        self._beat = time.monotonic()
        self._thread: threading.Thread | None = None

    def beat(self) -> None:
        """Report that the window is responding."""
        self._beat = time.monotonic()

    def hold(self, held: bool) -> None:
        """Hold the switch, or let it go at once."""
        self.beat()
        with self._lock:
            self._held = held
            self._link.hold(held)
        if held and self._thread is None and not self._over:
            self._thread = threading.Thread(target=self._work, name="itouch-holding", daemon=True)
            self._thread.start()

    def _work(self) -> None:
        while not self._over:
            with self._lock:
                if self._held and time.monotonic() - self._beat < SILENCE:
                    self._link.hold()
            time.sleep(AGAIN)

    def close(self) -> None:
        """Let go for good, and end the thread."""
        self.hold(False)
        self._over = True
        if self._thread is not None:
            self._thread.join()
