"""A fake of OpenHaptics' library: a hand holds the arm's end; its scheduler calls in a thread of its own.

Forces and positions are in the library's frame: x right, y up, z towards the operator, millimetres.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from itouch_arms.openhaptics import api


def _function(method: Any) -> Any:
    """ctypes sets a function's signature; a bound method takes no attributes."""
    return lambda *words: method(*words)


class FakeHd:
    """What `itouch_arms.openhaptics.api.load` returns; the knobs say what goes wrong."""

    def __init__(self) -> None:
        self.place = [0.0, 20.0, -30.0]
        self.buttons, self.style, self.most = 0, api.AUTOMATIC, 3.3
        self.calibration = api.OK
        self.missing = self.refused = 0  # numbers of errors: opening, starting the scheduler
        self.errors: list[int] = []  # of the next frames
        self.mute = False
        self.forces: list[tuple[float, float, float]] = []
        self.calls: list[str] = []
        self.enabled: set[int] = set()
        self.open = False
        self.force = (0.0, 0.0, 0.0)
        self._error = 0
        self._thread: threading.Thread | None = None
        self._callback: Any = None
        for name in dir(type(self)):
            if name.startswith("hd"):
                setattr(self, name, _function(getattr(self, name)))

    def hdInitDevice(self, name: bytes | None) -> int:
        self.calls.append("init")
        if self.missing:
            self._error = self.missing
            return api.INVALID_HANDLE
        self.open = True
        return 7

    def hdDisableDevice(self, handle: int) -> None:
        assert handle == 7
        self.calls.append("disable")
        self.open = False

    def hdMakeCurrentDevice(self, handle: int) -> None:
        assert handle == 7

    def hdGetIntegerv(self, what: int, value: Any) -> None:
        value.value = {api.CALIBRATION_STYLE: self.style, api.BUTTONS: self.buttons}[what]

    def hdGetDoublev(self, what: int, values: Any) -> None:
        if what == api.MAX_FORCE:
            values[0] = self.most
        else:
            assert what == api.POSITION and self._in_frame
            values[0:3] = self.place

    def hdSetDoublev(self, what: int, values: Any) -> None:
        assert what == api.FORCE and self._in_frame
        self._next = (values[0], values[1], values[2])

    def hdGetString(self, what: int) -> bytes:
        assert what == api.MODEL
        return b"PHANTOM Omni"

    def hdGetError(self) -> api.ErrorInfo:
        found, self._error = self._error, 0
        return api.ErrorInfo(found, 0, 7)

    def hdEnable(self, what: int) -> None:
        self.enabled.add(what)

    def hdDisable(self, what: int) -> None:
        self.enabled.discard(what)

    def hdCheckCalibration(self) -> int:
        return self.calibration

    def hdUpdateCalibration(self, style: int) -> None:
        self.calls.append(f"calibrate {style}")
        self.calibration = api.OK

    _in_frame = False

    def hdBeginFrame(self, handle: int) -> None:
        assert not self._in_frame and handle == 7
        self._in_frame = True

    def hdEndFrame(self, handle: int) -> None:
        assert self._in_frame
        self._in_frame = False
        if self.errors:
            self._error = self.errors.pop(0)
            if self._error == api.COMM_ERROR:
                return  # nothing reaches an arm that is gone
        self.force = self._next if api.FORCE_OUTPUT in self.enabled else (0.0, 0.0, 0.0)
        self.forces.append(self._next)

    def hdScheduleAsynchronous(self, callback: Any, data: Any, priority: int) -> int:
        self._callback = callback
        return 3

    def hdUnschedule(self, number: int) -> None:
        assert number == 3
        self.calls.append("unschedule")
        self._callback = None

    def hdStartScheduler(self) -> None:
        if self.refused:
            self._error = self.refused
            return
        self._running = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def hdStopScheduler(self) -> None:
        self.calls.append("stop")
        self._running = False
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    _running = False

    def _run(self) -> None:
        while self._running:
            if not self.mute and self._callback(None) == api.DONE:
                return
            time.sleep(5e-4)
