"""``itouch-py bench viewer --servo --web``: the servo loop beside a browser that is open, killed, or frozen."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile

from itouch.schema import ItouchError
from itouch_evidence.viewer_servo import Viewers, processor_time

#: Options of the browser: it draws off-screen, without a GPU, and does not use the network by itself.
_FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync", "--window-size=1280,720",
          "--disable-background-networking", "--disable-component-update")  # fmt: skip
_NAMES = ("chromium", "chromium-browser", "google-chrome")


class Browsers(Viewers):
    """Opens `itouch-py view --web` on sessions, and a headless Chromium on its page, which is killed or frozen.

    Raises
    ------
    ItouchError
        If there is no Chromium.
    """

    def __init__(self) -> None:
        super().__init__(dict(os.environ))
        found = next((path for name in _NAMES if (path := shutil.which(name))), None)
        if found is None:
            raise ItouchError("bench viewer --servo --web opens Chromium, which is not installed")
        self._chromium: str = found
        self._address = ""
        self._browser: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def words(self, name: str) -> list[str]:
        """Return the command that serves a session."""
        return [sys.executable, "-m", "itouch_tools.cli", "view", name, "--web", "--port", "0"]

    def open(self, name: str) -> None:
        """Open a browser on a session, and wait until it shows it; the first time, the server is opened, too."""
        if self._process is None:
            super().open(name)
            self._address = self.first_line()
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        words = [self._chromium, *_FLAGS, f"--user-data-dir={self._folder.name}", self._address]
        self._browser = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        self.await_line("a browser looks")

    def signal(self, number: int) -> None:
        """Send a signal to all processes of the browser."""
        if self._browser is not None:
            os.killpg(self._browser.pid, number)

    def end(self) -> None:
        """Kill the browser; the server stays for the next one."""
        browser, self._browser = self._browser, None
        if browser is not None:
            os.killpg(browser.pid, signal.SIGKILL)
            browser.wait()
        if self._folder is not None:
            self._folder.cleanup()

    def close(self) -> None:
        """Kill the browser and the server."""
        self.end()
        super().end()

    @property
    def used(self) -> float:
        """CPU time [s] of the server and of the browser's first process."""
        return super().used + (processor_time(self._browser.pid) if self._browser is not None else 0.0)
