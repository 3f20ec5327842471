"""A force that the operator feels as long as it is told again and again; what is stale fades to zero."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: How long [s] a force stands after it was told, how long it then takes to zero, and how often that is looked at.
STANDS, FADES, EVERY = 0.1, 0.1, 0.01


def faded(force: Floats, age: float) -> Floats:
    """Return what is left of a force [N], shape (3,), told so long ago [s]."""
    share = min(1.0, max(0.0, 1.0 - (age - STANDS) / FADES))
    return np.asarray(share * force)


class Feedback:
    """Sends the force that stands now, in a thread, and holds the dead-man's switch while that thread runs.

    Parameters
    ----------
    send
        Takes a force [N], shape (3,); it may raise when the session has ended.
    hold
        Called in every turn.
    most
        The greatest force [N]; the session's supervisor limits it once more.
    """

    def __init__(self, send: Callable[[Floats], None], hold: Callable[[], None], most: float) -> None:
        self._send, self._hold, self._most = send, hold, most
        self._told, self._when = np.zeros(3), -np.inf
        self._sent = np.zeros(3)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="itouch feedback", daemon=True)
        #: What the thread failed of, if it did.
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def tell(self, force: Floats) -> None:
        """Let a force be felt from now on; a longer one than the greatest is shortened.

        Raises
        ------
        ValueError
            If it is not of three finite numbers; nothing is felt then.
        """
        if force.shape != (3,) or not np.isfinite(force).all():
            self._told, self._when = np.zeros(3), -np.inf
            raise ValueError(f"a force is of three finite numbers [N], not {force.tolist()}")
        size = float(np.linalg.norm(force))
        self._told, self._when = force * min(1.0, self._most / size) if size else force, time.monotonic()

    def close(self) -> None:
        """Let the force go, and end."""
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
