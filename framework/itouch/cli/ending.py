"""How a run ends: signals that end it safely, and its report as a file."""

from __future__ import annotations

import json
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from itouch.schema import ItouchError


class Stopping:
    """Lets Ctrl-C, SIGTERM and SIGHUP end a run safely while the context lasts.

    Parameters
    ----------
    stop
        Asks the run to end; called from a signal handler.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._signal = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Stopping:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: object) -> None:
        self._signal = number
        self._stop()

    def code(self, otherwise: int) -> int:
        """Return the exit code: of the signal that ended the run, which is said, or the other."""
        if not self._signal:
            return otherwise
        print(f"stopped by {signal.Signals(self._signal).name}; the devices are safe", file=sys.stderr)
        return 128 + self._signal


def write_report(path: str | None, report: Callable[[], dict[str, Any]]) -> None:
    """Write a report as JSON, if a path is given.

    Raises
    ------
    ItouchError
        If the file can't be written.
    """
    if not path:
        return
    try:
        with open(path, "w", encoding="utf-8") as stream:
            json.dump(report(), stream, indent=1, allow_nan=False)
            stream.write("\n")
    except OSError as error:
        raise ItouchError(f"cannot write '{path}': {error.strerror or error}") from error
