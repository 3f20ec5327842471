"""The driver of a Phantom or Touch behind OpenHaptics: open it, read the position of its end, send forces.

The library's scheduler calls back about a thousand times a second; each call reads the arm and sends the newest
force, or zero if the newest is older than `STALE`.  Frame: x right, y away from the operator, z up (the library's is
x right, y up, z towards the operator, in millimetres).
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from ctypes import c_int
from types import TracebackType
from typing import Any, NamedTuple, Self

from itouch.plugin import Trace
from itouch.plugin.impedance import Vector
from itouch_arms.errors import ArmError, Disconnected, NotCalibrated, NotFound, ProtocolError, Refused, Timeout
from itouch_arms.openhaptics import api

#: Age [s] above which a force is no longer sent: the program that wrote it hangs.
STALE = 0.05
#: How long [s] a new frame may take, and the last ones; and the pause between two checks for one.
_FRAME, _LAST, _LOOK = 0.1, 0.1, 1e-4
_NO_FORCE: Vector = (0.0, 0.0, 0.0)
_STYLES = {
    api.INKWELL: "put its stylus into the inkwell",
    api.AUTOMATIC: "move it about through its whole reach",
    api.ENCODER_RESET: "calibrate it with its maker's program, which asks for its reset position",
}


class Sample(NamedTuple):
    """One frame's data: its number, the position of the arm's end [m], and the buttons as a bit mask."""

    number: int
    position: Vector
    buttons: int


class Phantom:
    """The driver of one arm; the library has one scheduler, so a process can drive one arm.

    Parameters
    ----------
    name
        The arm's name in the maker's configuration; empty: the default one.
    library
        The library's file; empty: its usual name.
    calibration_time
        How long [s] the operator has to calibrate the arm.
    patience
        Factor on every waiting time for a frame, and on `STALE`.
    trace
        Where to log the positions read and the forces written.
    """

    def __init__(
        self,
        name: str = "",
        library: str = "",
        *,
        calibration_time: float = 0.0,
        patience: float = 1.0,
        trace: Trace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._name, self._library, self._calibration_time = name, library, calibration_time
        self._patience, self._trace, self._clock = patience, trace, clock
        self._hd: Any = None
        self._handle = api.INVALID_HANDLE
        self._scheduled: int | None = None
        self._callback = api.Callback(self._frame)
        self._position, self._asked, self._buttons = api.Vector(), api.Vector(), c_int()
        #: The arm's model, and the greatest force [N] that it can give; known once it is open.
        self.model, self.max_force = "", math.inf
        self._forget()

    def _forget(self) -> None:
        self._sample, self._read, self._force, self._when = Sample(0, _NO_FORCE, 0), 0, _NO_FORCE, -math.inf
        self._failure: ArmError | None = None
        self._calibration, self._style = 0, 0

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open(self) -> None:
        """Load the library, open the arm, wait until it is calibrated, and only then enable forces.

        Raises
        ------
        ArmError
            If the library or the arm is missing or refuses, or the arm is not calibrated in time.
        """
        self._forget()
        self._hd = hd = api.load(self._library)
        try:
            self._begin(hd)
            hd.hdEnable(api.FORCE_CLAMPING)
            hd.hdEnable(api.FORCE_OUTPUT)
            self._check("enabling forces")
        except BaseException:
            self.close()
            raise

    def _begin(self, hd: Any) -> None:
        """Open the arm and start the scheduler, without force."""
        hd.hdGetError()  # clear an error that an earlier user of the library has left
        self._handle = hd.hdInitDevice(self._name.encode() or None)
        error = hd.hdGetError()
        if error.code != api.SUCCESS or self._handle == api.INVALID_HANDLE:
            self._handle = api.INVALID_HANDLE
            raise _missing(self._name, error.code)
        hd.hdMakeCurrentDevice(self._handle)
        style, most = c_int(), api.Vector()
        hd.hdGetIntegerv(api.CALIBRATION_STYLE, style)
        hd.hdGetDoublev(api.MAX_FORCE, most)
        self.model = (hd.hdGetString(api.MODEL) or b"").decode(errors="replace")
        self.max_force = most[0] if most[0] > 0.0 else math.inf
        self._style = next((one for one in (api.AUTOMATIC, api.INKWELL) if style.value & one), style.value)
        self._check("reading its properties")
        if self._trace:
            self._trace.remark(f"opened {self.model}, calibration style {style.value}, at most {self.max_force:g} N")
        self._scheduled = hd.hdScheduleAsynchronous(self._callback, None, api.PRIORITY)
        hd.hdStartScheduler()
        self._check("starting the scheduler")
        self._await_calibration()

    def _await_calibration(self) -> None:
        end, told = self._clock() + self._calibration_time, False
        self._next()
        while self._calibration != api.OK:
            how = _STYLES.get(self._style, _STYLES[api.ENCODER_RESET])
            reason = NotCalibrated(f"the arm {self.model} is not calibrated: {how}")
            if self._clock() >= end:
                raise reason
            if not told:
                logging.getLogger(__name__).warning("%s", reason)
                told = True
            self._next()

    def _frame(self, _: int | None) -> int:
        """Read the arm and send its force; called by the library's scheduler, in its thread."""
        hd, handle = self._hd, self._handle
        if self._failure is not None or self._scheduled is None:
            return api.CONTINUE if self._failure is None else api.DONE
        try:
            hd.hdBeginFrame(handle)
            hd.hdGetDoublev(api.POSITION, self._position)
            hd.hdGetIntegerv(api.BUTTONS, self._buttons)
            if self._calibration != api.OK:
                self._calibrate(hd)
            self._push(hd, self._force if self._clock() - self._when <= STALE * self._patience else _NO_FORCE)
            hd.hdEndFrame(handle)
            self._failure = _named(hd.hdGetError().code, "exchanging")
            if self._failure is not None:  # one more frame, to set the force to zero if that is still possible
                hd.hdBeginFrame(handle)
                self._push(hd, _NO_FORCE)
                hd.hdEndFrame(handle)
            right, up, towards = self._position[:]
            position = (1e-3 * right, -1e-3 * towards, 1e-3 * up)
            self._sample = Sample(self._sample.number + 1, position, self._buttons.value)
        except Exception as error:  # no exception may propagate into the library
            self._failure = ProtocolError(f"OpenHaptics cannot be called: {error}")
        return api.CONTINUE if self._failure is None else api.DONE

    def _push(self, hd: Any, force: Vector) -> None:
        x, y, z = force
        self._asked[:] = [x, z, -y]
        hd.hdSetDoublev(api.FORCE, self._asked)

    def _calibrate(self, hd: Any) -> None:
        self._calibration = hd.hdCheckCalibration()
        if self._calibration == api.NEEDS_UPDATE and self._style in (api.AUTOMATIC, api.INKWELL):
            hd.hdUpdateCalibration(self._style)

    def _next(self) -> Sample:
        """Wait for a frame that has not been read yet, and return it.

        Raises
        ------
        ArmError
            If the library has reported an error, or no frame comes.
        """
        end = self._clock() + _FRAME * self._patience
        while self._sample.number == self._read:
            if self._failure is not None:
                raise self._failure
            if self._clock() >= end:
                raise Timeout("the arm's frames have stopped: OpenHaptics' scheduler does not call any more")
            time.sleep(_LOOK)
        if self._failure is not None:
            raise self._failure
        sample = self._sample
        self._read = sample.number
        return sample

    def read(self) -> Sample:
        """Return the newest frame, waiting for one that has not been read yet.

        Raises
        ------
        ArmError
            If the arm is gone, has a fault, or reports an impossible position.
        """
        if self._hd is None:
            raise ArmError("the arm is not open")
        sample = self._next()
        if not all(math.isfinite(part) and abs(part) < 2.0 for part in sample.position):
            self._force = _NO_FORCE
            raise ProtocolError(f"the arm says that its end is at {sample.position} m")
        if self._trace:
            x, y, z = sample.position
            self._trace.received(b"position %.6f %.6f %.6f buttons %d" % (x, y, z, sample.buttons))
        return sample

    def write(self, force: Sequence[float]) -> None:
        """Set the force on the operator [N] that the following frames send for `STALE`; limited to ``max_force``.

        Raises
        ------
        ValueError
            If it is not three finite numbers; the force stays as it was.
        """
        x, y, z = (float(part) for part in force)
        size = math.sqrt(x * x + y * y + z * z)
        if not math.isfinite(size):
            raise ValueError(f"force = {tuple(force)!r} must be three finite numbers of newtons")
        part = self.max_force / size if size > self.max_force else 1.0
        if self._trace:
            self._trace.sent(b"force %.4f %.4f %.4f" % (part * x, part * y, part * z))
        self._force, self._when = (part * x, part * y, part * z), self._clock()

    def close(self) -> None:
        """Send zero force, stop the scheduler and release the arm; an arm that is already gone is no error."""
        hd, self._hd = self._hd, None
        self._force = _NO_FORCE
        if hd is None:
            return
        if self._scheduled is not None:
            self._hd = hd  # the callback still needs it
            self._last_frames()
            hd.hdStopScheduler()
            hd.hdUnschedule(self._scheduled)
            self._hd, self._scheduled = None, None
        if self._handle != api.INVALID_HANDLE:
            hd.hdMakeCurrentDevice(self._handle)
            hd.hdDisable(api.FORCE_OUTPUT)
            hd.hdDisableDevice(self._handle)
            self._handle = api.INVALID_HANDLE

    def _last_frames(self) -> None:
        """Wait until two frames have sent zero force, unless frames have stopped."""
        count, end = self._sample.number, self._clock() + _LAST * self._patience
        while self._sample.number < count + 2 and self._failure is None and self._clock() < end:
            time.sleep(_LOOK)

    def _check(self, what: str) -> None:
        failure = _named(self._hd.hdGetError().code, what)
        if failure is not None:
            raise failure


def _missing(name: str, code: int) -> ArmError:
    arm = f"the arm '{name}'" if name else "the default arm"
    if code == api.LICENSE:
        return Refused("OpenHaptics has no valid licence on this machine")
    why = api.ERRORS.get(code, f"error 0x{code:04x}" if code else "no handle")
    return NotFound(
        f"OpenHaptics cannot open {arm} ({why}): is it plugged in, powered, set up with its maker's program, "
        "and may this user open its port?"
    )


def _named(code: int, what: str) -> ArmError | None:
    """Return the exception for an error code; None if the code means success."""
    if code == api.SUCCESS:
        return None
    text = api.ERRORS.get(code, f"error 0x{code:04x}")
    if code in (api.COMM_ERROR, api.COMM_CONFIG):
        return Disconnected(f"the arm is gone: {what} failed ({text})")
    if code == api.WARM_MOTORS:
        return Refused("the arm's motors are too warm: let it rest")
    if api.WARM_MOTORS < code < api.DEVICE_FAULT:
        return Refused(f"the arm's own limits have cut its force: {text}")
    return ArmError(f"the arm has failed while {what}: {text} (0x{code:04x})")
