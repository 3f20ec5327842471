"""The states of one device: closed, open, enabled, fault (latched), and the transitions between them.

CLOSED --open--> OPEN --enable--> ENABLED --disable--> OPEN --close--> CLOSED; any error, NaN or trip leads to FAULT,
which latches until an operator re-arms.  In OPEN and FAULT only safe commands are sent: a plugin can't forward a
command while it is disabled, because it never receives one.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any

from itouch.exchange import Exchanged, still_inside
from itouch.monitors import LOSSES, TripError
from itouch.plugin import DeviceError, Record
from itouch.plugin.wire_claims import WireClaims
from itouch.safety.device_opening import PATIENCE, DeviceOpening
from itouch.safety.gate import Gate
from itouch.safety.latch import CLOSED, ENABLED, FAULT, OPEN

#: W4: the time [s] within which a device may be re-armed only a few times.
MINUTE = 60.0
#: How long [s] a device may take to close.
CLOSE_TIME = 2.0


class Lifecycle:
    """Leads one device, or its twin, from status to status; what passes meanwhile is its gate's matter."""

    def __init__(self, gate: Gate, state: Record, period: float) -> None:
        self.gate, self.latch, self._period = gate, gate.latch, period
        self.model = gate.model
        self._rearmed = state[f"{self.model.name}.rearmed"]
        #: Its claims on its wires, which nobody else may use while it is open.
        self._claims = WireClaims()
        #: The attempt to open it that is under way, or was given up and has not returned yet.
        self._opening: DeviceOpening | None = None
        #: Whether it is CLOSED because it could not be reconnected.
        self.missing = False
        #: The thread that has not returned from closing the device.
        self._closing: threading.Thread | None = None
        #: Returns the process of the guardian that watches over this session; 0: there is none.
        self.guardian: Callable[[], int] = int
        #: Why it can't be enabled at all: nothing tells where the finger is that it acts on; empty: it can.
        self.blind = ""

    def reset(self) -> None:
        """Set what is remembered to its start."""
        self.latch.reset()
        self._rearmed[:] = -1
        self.gate.reset()

    def claim_wires(self) -> None:
        """Claim the device's wires, unless they are claimed already; ``close`` and the end of the process release them.

        Raises
        ------
        WireHeldError
            If another process, or another session, has one.
        """
        driver: Any = self.gate.device
        while isinstance(driver, Exchanged):
            driver = driver.device
        if driver is not None and self.model.commands:  # asked anew, because a virtual rig's wires may have moved
            self._claims.take(type(driver).wires(driver.params), self.guardian())

    def free_wires(self) -> None:
        """Release the wires of a device that is not opened after all."""
        if not self.busy and not self._hangs_in():  # else its driver may use them
            self._claims.release()

    def open(self) -> None:
        """Open the device; CLOSED -> OPEN, or FAULT if a trip is latched: only re-arming releases it.

        Raises
        ------
        DeviceError
            If the device is missing or refuses, or its wire is in use.
        """
        self.require_free()
        self.claim_wires()
        if self.gate.device is not None:
            self.gate.device.open()
        self.gate.opened()
        self.latch.open()

    @property
    def busy(self) -> bool:
        """Whether a thread still opens it, be it one that was given up: nobody else may open it then."""
        return self._opening is not None and not self._opening.ended

    @property
    def awaited(self) -> bool:
        """Whether somebody is to take the result of its opening; until then it is CLOSED."""
        return self._opening is not None and not self._opening.given_up

    @property
    def settled(self) -> bool:
        """Whether ``finish_opening`` would not have to wait."""
        return self._opening is None or self._opening.over

    def require_free(self) -> None:
        """Refuse to begin anything with a device that a thread still opens.

        Raises
        ------
        DeviceError
            If one does.
        """
        if self.awaited:
            raise DeviceError("is being opened: wait until that is done")
        if self.busy:
            raise DeviceError(
                "is still being opened, although nobody waits for that any longer: wait, or switch it off"
            )
        if method := self._hangs_in():
            raise DeviceError(still_inside(method))

    def _hangs_in(self) -> str:
        """Return the method of the driver from which a thread has not returned that closes it; empty: none."""
        device = self.gate.device
        if self._closing is not None and self._closing.is_alive():
            return "close"
        return device.hangs_in if isinstance(device, Exchanged) else ""

    def begin_opening(self, patience: float = PATIENCE) -> None:
        """Open the device in a thread of its own; it stays CLOSED until ``finish_opening``.

        Parameters
        ----------
        patience
            How long [s] that may take.

        Raises
        ------
        DeviceError
            If a thread opens it already.
        """
        self.require_free()
        self._begin(lambda: None, patience)

    def _begin(self, before: Callable[[], None], patience: float = PATIENCE) -> None:
        device = self.gate.device
        if device is None:  # nothing to wait for
            return

        def work(opening: DeviceOpening) -> None:
            before()
            if opening.given_up:  # opening may move it
                raise DeviceError("was given up before it was opened")
            if method := self._hangs_in():
                raise DeviceError(still_inside(method))
            self.claim_wires()
            device.open()

        self._opening = DeviceOpening(self.model.name, device, work, self._claims.release, patience)

    def finish_opening(self, meanwhile: Callable[[], object] | None = None) -> str:
        """Wait for the device to be opened; then it is OPEN, or FAULT if a trip is latched.

        Parameters
        ----------
        meanwhile
            Called again and again while it waits.

        Returns
        -------
        str
            Why it is not open; empty: it is.
        """
        if self.gate.device is not None and (failed := self._result(meanwhile)):
            return failed
        self.gate.opened()
        self.latch.open()
        self.missing = False
        return ""

    def _result(self, meanwhile: Callable[[], object] | None) -> str:
        """Wait for the driver to return from opening; return why the device is not open, or nothing."""
        opening = self._opening
        if opening is None or opening.given_up:
            return "is no longer being opened"
        failed = opening.result(meanwhile)
        if not opening.given_up:
            self._opening = None
        return failed

    def enable(self) -> None:
        """Let commands through from the state that was measured; OPEN -> ENABLED.

        Raises
        ------
        DeviceError
            If the device is not OPEN, a trip is latched, a budget is used up, it has not read anything yet, or nothing
            tells where the finger is that it acts on.
        """
        name = self.model.name
        if self.blind:
            raise DeviceError(f"device '{name}' can't be enabled: {self.blind}")
        if self.latch.number != OPEN:
            raise DeviceError(f"device '{name}' is {self.latch.status.name}, it can't be enabled")
        if self.latch.latched:
            raise DeviceError(f"device '{name}' was stopped by {self.latch.trip.label}: it must be re-armed first")
        self._refuse_spent()
        if not self.model.twin and self.model.reads and not self.gate.acquisition.heard:
            raise DeviceError(f"device '{name}' has not read anything yet: nothing could watch what it does")
        self.gate.begin()
        self.latch.become(ENABLED)

    def rearm(self, tick: int) -> None:
        """Release the latched trip: FAULT -> OPEN; commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If what stopped the device is not over, see ``may_rearm``.
        """
        self.may_rearm(tick)
        self.release(tick)

    def may_rearm(self, tick: int, until: float = 0.0) -> None:
        """Take a reading of a device that is not ENABLED, and check that nothing keeps it from being enabled.

        No tick has read hardware while all was stopped: it may stand elsewhere by now, or not answer any more.

        Parameters
        ----------
        tick
            The number of the tick that comes next.
        until
            Time [host s] until which hardware that has nothing new is waited for.

        Raises
        ------
        DeviceError
            If it does not answer, its reading is wrong, or it could not be reconnected; if a budget is used up; or if
            it is stopped by a trip and has been re-armed too often within a minute.
        """
        if self.latch.number == CLOSED and self.missing and not self.model.optional:
            raise DeviceError(f"device '{self.model.name}' could not be reconnected: reconnect it first")
        stopped = self.latch.number == FAULT
        if not stopped and (self.latch.number != OPEN or self.gate.device is None):
            return
        self._refuse_spent()
        if stopped:
            self._refuse_often(tick)
        try:
            self.gate.read_anew(tick, until)
        except TripError as error:
            raise DeviceError(f"device '{self.model.name}' can't be re-armed: it {error}") from error

    def release(self, tick: int) -> None:
        """Release the latched trip of a device that may be re-armed: FAULT -> OPEN."""
        if self.latch.number != FAULT:
            return
        self.latch.release()
        self.latch.become(OPEN)
        self._rearmed[1:] = self._rearmed[:-1].copy()
        self._rearmed[0] = tick

    def _refuse_spent(self) -> None:
        if said := self.gate.spent():
            raise DeviceError(f"device '{self.model.name}' {said}")

    def _refuse_often(self, tick: int) -> None:
        """Refuse to re-arm a device again that was re-armed often within a minute: the cause was not found (W4)."""
        oldest = int(self._rearmed[-1])
        wait = MINUTE - (tick - oldest) * self._period
        if oldest >= 0 and wait > 0.0:
            often = f"was re-armed {len(self._rearmed)} times within a minute"
            raise DeviceError(f"device '{self.model.name}' {often}: find out why it stops, and wait {wait:.0f} s")

    def reconnect(self) -> None:
        """Close and open the device anew, and wait for that; see ``begin_reconnect``.

        Raises
        ------
        DeviceError
            If the device is missing or refuses (it stays CLOSED), or a budget such as its thermal dose is used up.
        """
        self.begin_reconnect()
        if failed := self.finish_reconnect():
            raise DeviceError(failed)

    def begin_reconnect(self) -> None:
        """Send the safe command, and close and open the device anew in a thread; it is CLOSED meanwhile.

        ``finish_reconnect`` makes it OPEN, with nothing remembered from before.  A trip for a lost connection is
        released by that; any other trip stays latched (FAULT).

        Raises
        ------
        DeviceError
            If a budget such as its thermal dose is used up, or a thread opens it already.
        """
        self._refuse_spent()
        self.require_free()
        was_open = self.latch.number != CLOSED
        self._make_closed()
        if self.latch.trip in LOSSES:
            self.latch.release()
        self._begin(self._let_go_first if was_open else self._claims.release)

    def finish_reconnect(self) -> str:
        """Finish as ``finish_opening`` does, with the commands at their safe values; return why it is not open."""
        failed = self.finish_opening()
        if failed:
            self.missing = True
        else:
            self.gate.actuation.rest_at_safe()
        return failed

    def put_down(self) -> None:
        """Give a device up that was reconnected but can't be read, without waiting until it is closed."""
        device = self.gate.device
        self._make_closed()
        self.missing = True
        if device is not None:
            self._opening = DeviceOpening(self.model.name, device, lambda opening: None, self._claims.release, PATIENCE)
            self._opening.give_up()

    def _make_closed(self) -> None:
        """Send the safe command to a device that is open, whatever it raises; any status -> CLOSED."""
        if self.latch.number != CLOSED:
            with contextlib.suppress(TripError):  # a lost device may refuse
                self.gate.actuation.send_safe()
            self.latch.become(CLOSED)

    def _let_go_first(self) -> None:
        """Close the device whatever it raises, and release its wires if it could be closed."""
        with contextlib.suppress(Exception, SystemExit):  # a lost device may refuse to be closed
            self._let_go()
            self._claims.release()

    def take_over(self, other: Lifecycle) -> None:
        """Take over the open device of another instance, which is then CLOSED and can no longer send anything.

        The device itself does not notice.  A latched trip stays latched, and commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If the other still lets commands through.
        """
        if other.latch.enabled:
            raise DeviceError(f"device '{self.model.name}' must be made safe before another scene takes it over")
        if other.latch.number == CLOSED:
            return
        self.gate.device, other.gate.device = other.gate.device, None
        self._claims, other._claims = other._claims, self._claims
        other.latch.become(CLOSED)
        self.latch.open()

    def abandon(self) -> None:
        """Give the device up, whatever it raises; any status -> CLOSED."""
        with contextlib.suppress(Exception, SystemExit):  # a lost device may refuse to be closed
            self.close()

    def close(self) -> None:
        """Send the safe command and release the device; any status -> CLOSED."""
        if self.latch.number == CLOSED:
            self.give_up()
            self.free_wires()
            return
        try:
            self.gate.actuation.send_safe()
        finally:
            self.latch.become(CLOSED)
            self._let_go()
            self._claims.release()  # but not if the device can't be closed: its driver may still use the wire

    def give_up(self, seconds: float = CLOSE_TIME) -> None:
        """Give up the opening that is under way, if one is: its thread closes the device as soon as it is open.

        ``seconds``: how long after it was given up for the first time that is waited for.
        """
        if self._opening is not None:
            self._opening.give_up(seconds)
            if self._opening.ended:
                self._opening = None

    def _let_go(self) -> None:
        """Close the device, which has been sent its safe command by then; don't wait for it for ever.

        Raises
        ------
        DeviceError
            If it does not return from closing in time.
        """
        if self.gate.device is None:
            return
        failed: list[BaseException] = []

        def work(close: Callable[[], None] = self.gate.device.close) -> None:
            try:
                close()
            except BaseException as error:
                failed.append(error)

        thread = threading.Thread(target=work, name=f"close {self.model.name}", daemon=True)
        thread.start()
        thread.join(CLOSE_TIME)
        if thread.is_alive():
            self._closing = thread
            raise DeviceError(f"did not return from closing within {CLOSE_TIME:g} s")
        if failed:
            raise failed[0]
