"""A force on the operator that must be repeated to last: a stale one fades to zero."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: How long [s] a force lasts after it was given, how long it then takes to fade to zero, and the period of updates.
STANDS, FADES, EVERY = 0.1, 0.1, 0.01


def faded(force: Floats, age: float) -> Floats:
    """Return what is left of a force [N], shape (3,), that was given ``age`` seconds ago."""
    share = min(1.0, max(0.0, 1.0 - (age - STANDS) / FADES))
    return np.asarray(share * force)


class Feedback:
    """Sends the current force from a thread, and holds the dead-man's switch while that thread runs.

    Parameters
    ----------
    send
        Sends a force [N], shape (3,); it may raise when the session has ended.
    hold
        Holds the dead-man's switch; called in every period.
    most
        The greatest force [N]; the session's supervisor applies its own limit as well.
    """

    def __init__(self, send: Callable[[Floats], None], hold: Callable[[], None], most: float) -> None:
        self._send, self._hold, self._most = send, hold, most
        self._told, self._when = np.zeros(3), -np.inf
        self._sent = np.zeros(3)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="itouch feedback", daemon=True)
        #: The exception that ended the thread, if any.
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def tell(self, force: Floats) -> None:
        """Set the force [N], shape (3,), to be felt from now on; one above the greatest is scaled down to it.

        Raises
        ------
        ValueError
            If it is not three finite numbers; the force is then zero.
        """
        if force.shape != (3,) or not np.isfinite(force).all():
            self._told, self._when = np.zeros(3), -np.inf
            raise ValueError(f"a force is of three finite numbers [N], not {force.tolist()}")
        size = float(np.linalg.norm(force))
        self._told, self._when = force * min(1.0, self._most / size) if size else force, time.monotonic()

    def close(self) -> None:
        """Send zero force, and end the thread."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def _run(self) -> None:
        try:
            while not self._end.wait(EVERY):
                self._hold()
                self._put(faded(self._told, time.monotonic() - self._when))
            self._put(np.zeros(3))
        except Exception as error:  # the session has ended: its devices are safe
            self.failure = error

    def _put(self, force: Floats) -> None:
        if not np.array_equal(force, self._sent):
            self._send(force)
            self._sent = force
