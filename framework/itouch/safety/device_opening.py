"""Opening a device without making anybody wait: in a thread of its own, whose result is taken later, or given up."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

from itouch.exchange import failed_in
from itouch.plugin import Device
from itouch.schema import ItouchError
from itouch.schema.diagnostics import named, spoken
from itouch.schema.plugin_errors import error_text

#: How long [s] a device may take to open.
PATIENCE = 15.0
#: How often [s] whoever waits for it looks whether it is.
LOOK = 0.01


class DeviceOpening:
    """One attempt to open a device.

    A thread can't be ended from outside.  So one that is given up undoes its work as soon as the driver lets it: the
    device is closed and its wires are released then, and not before.

    Parameters
    ----------
    name
        Of the device.
    device
        The device.
    work
        Claims its wires and opens it; called in the thread with this attempt, which may be given up meanwhile.
    release
        Releases its wires; called in the thread after an attempt that was given up.
    patience
        How long [s] it may take.
    """

    def __init__(
        self, name: str, device: Device, work: Callable[[DeviceOpening], None], release: Callable[[], None],
        patience: float,
    ) -> None:  # fmt: skip
        self._patience, self._deadline = patience, time.monotonic() + patience
        self._device, self._work, self._release = device, work, release
        self._lock, self._returned, self._ended = threading.Lock(), threading.Event(), threading.Event()
        #: Whether nobody waits for it any more, and since when [s].
        self.given_up, self._since = False, 0.0
        #: Why the device did not open; empty: it did, or still may.
        self.failure = ""
        threading.Thread(target=self._live, name=f"open {name}", daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether the driver has opened the device, or has failed to, or has taken too long."""
        return self._returned.is_set() or time.monotonic() >= self._deadline

    @property
    def ended(self) -> bool:
        """Whether the thread leaves the device and its wires alone from now on."""
        return self._ended.is_set()

    def result(self, meanwhile: Callable[[], object] | None = None) -> str:
        """Wait until it is over; return why the device is not open, or nothing.  What took too long is given up.

        ``meanwhile`` is called again and again, so that the caller is not taken to hang.
        """
        try:
            while not self.over:
                if meanwhile is not None:
                    meanwhile()
                self._returned.wait(min(LOOK, max(0.0, self._deadline - time.monotonic())))
        except BaseException:  # Ctrl-C: nobody takes the result
            self.give_up()
            raise
        if not self._returned.is_set():
            self.give_up()
            return f"did not open within {self._patience:g} s"
        return self.failure

    def give_up(self, seconds: float = 0.0) -> None:
        """Let the device be closed as soon as it has been opened; wait for that, but not longer than told.

        That is counted from when it was given up first: several that were given up at once are waited for at once.
        """
        with self._lock:
            undone, self.given_up = self.given_up, True
            self._since = self._since if undone else time.monotonic()
            late = self._ended.is_set() and not undone
            if late:
                self._ended.clear()
        if late:
            threading.Thread(target=self._undo, name="close what was opened too late", daemon=True).start()
        self._ended.wait(max(0.0, self._since + seconds - time.monotonic()))

    def _live(self) -> None:
        try:
            self._work(self)
        except BaseException as error:  # whatever a driver raises, it has not opened its device
            self.failure = _cause(error, self._device)
        with self._lock:
            self._returned.set()
            if not self.given_up:
                self._ended.set()
                return
        self._undo()

    def _undo(self) -> None:
        with contextlib.suppress(BaseException):  # nobody is left to be told
            if not self.failure:
                self._device.close()
            self._release()  # but not if the device can't be closed: its driver may still use the wire
        self._ended.set()


def _cause(error: BaseException, device: Device) -> str:
    """Return why a device did not open: an error of ours, or of the system, explains itself; of another, its line."""
    if not isinstance(error, Exception):
        return f"has tried to end the program: {named(error)}"
    if isinstance(error, ItouchError | OSError):
        return spoken(error) or type(error).__name__
    return f"failed in {failed_in(device, 'open')}: {error_text(error)}"
