"""The driver of an Inverse3 behind its service: open it, read its cursor's position, send forces.

>>> with Inverse3() as arm:                              # doctest: +SKIP
...     while True:
...         x, y, z = arm.read().position
...         arm.write((0.0, 0.0, -200.0 * (z - 0.15)))
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from itouch.plugin import Trace
from itouch.plugin.impedance import Vector
from itouch_arms.errors import ArmError, Disconnected, NotCalibrated, ProtocolError, Timeout
from itouch_arms.haply import messages
from itouch_arms.haply.line import Line

SERVICE = "localhost:10001"
PROFILE = "itouch-py"
#: How long [s] to wait for the inventory, for an answer, and for the answer to the last message.
_INVENTORY, _ANSWER, _LAST = 2.0, 0.1, 0.2
#: How many messages that do not mention arms are skipped for one answer, and the pause between two checks of
#: an arm that is not calibrated yet [s].
_PASSED, _LOOK = 8, 0.02
_NO_FORCE: Vector = (0.0, 0.0, 0.0)


class Inverse3:
    """The driver of one arm; it must not be used from two threads at once.

    Parameters
    ----------
    service
        ``HOST:PORT`` of the Inverse Service.
    device
        The arm's number, or "any" for the only one.
    button
        The grip's button to report: "a", "b", "c", "button", or "none".
    calibration_time
        How long [s] the operator has to calibrate the arm.
    patience
        Factor on every waiting time for an answer.
    trace
        Where to log the messages that go over the wire.
    """

    def __init__(
        self,
        service: str = SERVICE,
        device: str = "any",
        *,
        button: str = "none",
        calibration_time: float = 0.0,
        patience: float = 1.0,
        trace: Trace | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._service, self._wanted, self._button = service, device, button
        self._calibration, self._patience, self._trace = calibration_time, patience, trace
        self._clock, self._sleep = clock, sleep
        self._line: Line | None = None
        self._force = _NO_FORCE
        self._last: Vector | None = None
        #: The arm's number while it is open.
        self.device = ""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open(self) -> None:
        """Connect, choose the arm, set its force to zero, and wait until it is calibrated.

        Raises
        ------
        ArmError
            If it is missing, refuses, or is not calibrated in time.
        """
        self._force, self._last = _NO_FORCE, None
        self._line = Line(self._service, wait=_INVENTORY * self._patience, trace=self._trace)
        try:
            inventory = self._update(_INVENTORY)
            one = messages.chosen(inventory, self._wanted)
            self.device = one["device_id"]
            profile = PROFILE if "session_id" in inventory else ""  # versions before 3.5 know no sessions
            update = self._exchange(messages.force(self.device, _NO_FORCE, profile=profile))
            self._await_calibration(one, update)
        except BaseException:
            self.close()
            raise

    def _await_calibration(self, first: messages.Message, update: messages.Message) -> None:
        """Poll the arm with zero force until it reports that it is calibrated."""
        end, told = self._clock() + self._calibration, False
        config = {"config": first.get("config")}
        while True:
            try:
                messages.check({**config, **self._mine(update)})
                return
            except NotCalibrated as reason:
                if self._clock() >= end:
                    raise
                if not told:
                    logging.getLogger(__name__).warning("%s", reason)
                    told = True
            self._sleep(_LOOK)
            update = self._exchange(messages.force(self.device, _NO_FORCE))

    def read(self) -> messages.State | None:
        """Send the last written force and return the cursor's state; None if the answer does not hold a position.

        Raises
        ------
        ArmError
            If no answer comes, it is invalid, or the arm is gone; the next force sent is then zero.
        """
        try:
            update = self._exchange(messages.force(self.device, self._force))
            one = self._mine(update)
            messages.check(one)
            state = messages.state_of(update, one, self._button, self._last)
        except ArmError:
            self._force = _NO_FORCE
            raise
        if state is not None:
            self._last = state.position
        return state

    def write(self, force: Sequence[float]) -> None:
        """Set the force on the operator [N] that the next exchange sends.

        Raises
        ------
        ValueError
            If it is not three finite numbers; the force stays as it was.
        """
        x, y, z = (float(part) for part in force)
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            raise ValueError(f"force = {tuple(force)!r} must be three finite numbers of newtons")
        self._force = x, y, z

    def close(self) -> None:
        """Send zero force, wait for the answer, and close the connection; an arm that is already gone is no error."""
        line, self._line = self._line, None
        self._force = _NO_FORCE
        if line is None:
            return
        try:
            if self.device:
                with contextlib.suppress(ArmError):
                    line.send(messages.force(self.device, _NO_FORCE))
                    line.receive(_LAST)
        finally:
            line.close()

    def _mine(self, update: messages.Message) -> messages.Message:
        one = messages.arm(update, self.device)
        if one is None:
            raise Disconnected(f"the Inverse3 {self.device} is gone: the Inverse Service does not list it any more")
        return one

    def _exchange(self, text: str) -> messages.Message:
        if self._line is None:
            raise ArmError("the arm is not open")
        self._line.send(text)
        update = self._update(_ANSWER)
        while (newer := self._line.waiting()) is not None:  # more than one answer is here: take the newest
            message = messages.read(newer)
            update = message if messages.is_update(message) else update
        return update

    def _update(self, wait: float) -> messages.Message:
        """Return the next message that mentions arms."""
        if self._line is None:
            raise ArmError("the arm is not open")
        end = self._clock() + wait * self._patience
        passed: messages.Message = {}
        for _ in range(_PASSED):
            try:
                message = messages.read(self._line.receive(max(1e-3, end - self._clock())))
            except Timeout:
                if any(kind in passed for kind in (*messages.GRIPS, "session_id")):
                    raise Disconnected("the Inverse Service lists no Inverse3 any more: is it plugged in?") from None
                raise
            if messages.is_update(message):
                return message
            passed = message
        raise ProtocolError(f"the Inverse Service sent {_PASSED} messages without a word of an Inverse3")
