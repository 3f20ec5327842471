"""A session that waits for the dead-man's switch to be held says so, and does not wait for ever."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from itouch.plugin import Role
from itouch.schema import ItouchError

if TYPE_CHECKING:
    from itouch.servo import Handle
    from itouch.world import Model

#: Seconds without anybody holding the switch after which this is said again, and after which the session ends.
AGAIN, PATIENCE = 30.0, 120.0


class Waiting:
    """Watches, where there is no window, whether a session waits for the dead-man's switch."""

    def __init__(self, handle: Handle, model: Model, *, again: float = AGAIN, patience: float = PATIENCE) -> None:
        self._handle, self._model, self._again, self._patience = handle, model, again, patience
        self._begun: float | None = None
        self._next = 0.0
        self._over = False

    def look(self) -> None:
        """Print what the session waits for; end it if nobody has held a switch for too long.

        Raises
        ------
        ItouchError
            When the session is ended; it says what to do.
        """
        if self._over or self._handle.link.phase != "ready" or self._has_a_switch():
            self._over = True
            return
        now = time.monotonic()
        if self._begun is None:
            self._begun, self._next = now, 0.0
        waited = now - self._begun
        if waited >= self._patience:
            self._over = True
            self._handle.request_stop()
            raise ItouchError(f"nobody held a dead-man's switch for {self._patience:.0f} s: nothing was enabled\n"
                              f"  = help: {self._advice()}")  # fmt: skip
        if waited >= self._next:
            self._next += self._again
            hardware = ", ".join(f"'{d.name}'" for d in self._model.devices.values() if not d.twin)
            print(f"waiting: {hardware or 'the devices'} will move or heat for real, and nobody holds a dead-man's "
                  f"switch; {self._advice()}; Ctrl-C ends this", file=sys.stderr, flush=True)  # fmt: skip

    def _has_a_switch(self) -> bool:
        return any(device.reading(Role.DEADMAN) is not None for device in self._model.devices.values())

    def _advice(self) -> str:
        return (
            f"hold Space in a window of it (itouch-py view {self._handle.name}), or give a device a switch of its own "
            '(for example deadman="centre" on <usb-arm:hardware>)'
        )
