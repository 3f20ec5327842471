"""Stub."""

from __future__ import annotations

import subprocess

from itouch.servo.segment import Segment


class Guarded:
    """Stub."""

    def __init__(self, process: subprocess.Popen[bytes], segment: Segment) -> None:
        self.said = ""
        self.pid = 0

    def wait(self) -> None:
        """."""
