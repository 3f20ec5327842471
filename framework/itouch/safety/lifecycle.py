"""The states of one device: closed, open, enabled, fault (latched), and the transitions between them.

CLOSED --open--> OPEN --enable--> ENABLED --disable--> OPEN --close--> CLOSED; any error, NaN or trip leads to FAULT,
which latches until an operator re-arms.  In OPEN and FAULT only safe commands are sent: a plugin can't forward a
command while it is disabled, because it never receives one.
"""

from __future__ import annotations

import contextlib
import enum
import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from itouch.exchange import EveryNth, ThreadedDevice
from itouch.monitors import LOSSES, Heat, Push, Trip, TripError
from itouch.plugin import Channel, Device, DeviceError, Record, Role, Twin
from itouch.plugin.wire_claims import WireClaims
from itouch.safety.device_monitors import DeviceMonitors, InstalledMonitor
from itouch.world import DeviceModel


class Status(enum.IntEnum):
    """What a device may do now."""

    CLOSED = 0
    OPEN = 1
    ENABLED = 2
    FAULT = 3


#: The same as plain numbers: an attribute of an enumeration costs a microsecond.
CLOSED, OPEN, ENABLED, FAULT = (int(status) for status in Status)
_TRIPS = frozenset(int(trip) for trip in Trip)


#: W4: the time [s] within which a device may be re-armed only a few times.
MINUTE = 60.0
#: How long [s] a device may take to close.
CLOSE_TIME = 2.0
#: Values of ``Lifecycle.stopped``.
HELD, BACKWARDS = 1, 2


class SharedFinger(Protocol):
    """A finger on which several plates act."""

    @property
    def plates(self) -> Sequence[InstalledMonitor]:
        """The monitors of its plates."""

    def spent(self) -> str:
        """Return the words for a budget of the finger that is used up; empty: none is."""


class Lifecycle(ABC):
    """The states and transitions of one device, or its twin, on its part of State."""

    def __init__(
        self, model: DeviceModel, state: Record, period: float, *, device: Device | None, twin: Twin | None
    ) -> None:
        self.model, self._period = model, period
        self.device, self._twin = device, twin
        #: 1 once the twin was replaced by another one, so that what was compiled for the first is not used, shape (1,).
        self.replaced = np.zeros(1, np.int64)
        name = model.name
        self.reading = _part(state, f"{name}.", model.reads)
        self.command = _part(state, f"{name}.command.", model.commands)
        self.sent = _part(state, f"{name}.sent.", model.commands)
        has_twin_state = twin is not None and any(n.startswith(f"{name}.twin.") for n in state)
        self.twin_state = state.part(f"{name}.twin.") if has_twin_state else Record(np.dtype([]))
        self._status, self._trip, self._tripped = (state[f"{name}.{field}"] for field in ("status", "trip", "tripped"))
        #: The status, kept where nothing that writes into the memory of State can change it: a surface under a finger
        #: must be withdrawn, and a device closed, even if State says otherwise.
        self.status_number: int = self._status.item()
        self._ramp, self._age, self._sequence = (state[f"{name}.{field}"] for field in ("ramp", "age", "sequence"))
        self._measured, self._left = state[f"{name}.measured"], state.get(f"{name}.left")
        self._out = _part(state, f"{name}.out.", model.commands) if self._left is not None else self.sent
        #: How a surface retracts (None: it can't): 0, as it should; HELD where it is, because it came nearer when told
        #: to retract; BACKWARDS, because it still pressed when it was held.
        self.stopped = state.get(f"{name}.stopped")
        #: Height to which a surface was sent when all stopped, and the lowest and highest one to which its safe command
        #: may lead [m], shape (3,); NaN: not known, or as far as it travels.
        self.way = state.get(f"{name}.way")
        # A reading over a wire may come in any tick, depending on when an exchange began.
        self._every = max(1, round(model.cls.period / period)) if self._left is None else 1
        pose = next((channel for channel in model.reads if channel.role is Role.TRACKED_POSE), None)
        self._pose = pose.name if pose is not None else None
        self._rearmed, self._tick = state[f"{name}.rearmed"], state["tick"]
        #: The status as compiled code sees it, shape (1,).
        self.gate = self._status.reshape(1)
        #: The monitors in force.
        self.device_monitors = DeviceMonitors(model, state, self.reading, self.sent, period)
        #: The monitors of its plates.
        self.heats = [post for post in self.device_monitors.installed if isinstance(post.monitor, Heat)]
        #: Whether it presses by a fluid, and measures the force.
        self.presses = any(isinstance(post.monitor, Push) for post in self.device_monitors.installed)
        #: Whether its last command could not be written: the one before may still act.
        self.unsent = False
        #: The fingers on which other plates act, too, and which therefore share a budget among them.
        self.shared: list[SharedFinger] = []
        #: Its claims on its wires, which nobody else may use while it is open.
        self._claims = WireClaims()
        #: Why it can't be enabled at all: nothing tells where the finger is that it acts on; empty: it can.
        self.blind = ""

    @abstractmethod
    def _take(self) -> bool:
        """Read the twin or the device, and tell whether there was a new reading; whatever goes wrong is a trip."""

    @abstractmethod
    def _send_safe(self) -> None:
        """Send the safe command of every channel."""

    @property
    def twin(self) -> Twin | None:
        """The twin that stands in for the device, if one does."""
        return self._twin

    @twin.setter
    def twin(self, other: Twin | None) -> None:
        self._twin = other
        self.replaced[0] = 1

    def become(self, status: int) -> None:
        """Set the status."""
        self._status[...] = self.status_number = status

    def recall(self) -> None:
        """Take the status from a State that was restored."""
        self.status_number = self._status.item()

    def forged(self) -> str:
        """Correct the status in State if something has overwritten it; return the words for that, or nothing."""
        said = self._status.item()
        if said == self.status_number:
            return ""
        self._status[...] = self.status_number
        return f"something has written {said} over its status"

    @property
    def enabled(self) -> bool:
        """Whether commands are let through."""
        return self.status_number == ENABLED

    def knows(self, reading: int, since: int) -> bool:
        """Tell whether the device is not CLOSED, and has measured reading number ``reading`` in this tick or later."""
        return self.status_number != CLOSED and bool(self._measured[reading] >= since)

    @property
    def status(self) -> Status:
        """What the device may do now."""
        return Status(self.status_number)

    @property
    def trip(self) -> Trip:
        """Why the device was stopped, latched until it is re-armed."""
        number = self._trip.item()
        return Trip(number) if number in _TRIPS else Trip.MODALITY_ERROR  # something has overwritten it

    @property
    def tripped(self) -> int:
        """The tick at which the device was stopped last; -1: never."""
        return int(self._tripped.item())

    def reset(self) -> None:
        """Set what is remembered to its start."""
        self._tripped[...] = -1
        self._rearmed[:] = -1
        if self.way is not None:
            self.way[:] = math.nan
        self.device_monitors.reset()

    def restore(self) -> None:
        """Go on from a State that was restored."""
        self.recall()
        self.device_monitors.restore()

    def claim_wires(self) -> None:
        """Claim the device's wires, unless they are claimed already; ``close`` and the end of the process release them.

        Raises
        ------
        WireHeldError
            If another process, or another session, has one.
        """
        driver: Any = self.device
        while isinstance(driver, ThreadedDevice | EveryNth):
            driver = driver.device
        if driver is not None and self.model.commands:  # asked anew, because a virtual rig's wires may have moved
            self._claims.take(type(driver).wires(driver.params))

    def free_wires(self) -> None:
        """Release the wires of a device that is not opened after all."""
        self._claims.release()

    def open(self) -> None:
        """Open the device; CLOSED -> OPEN, or FAULT if a trip is latched: only re-arming releases it.

        Raises
        ------
        DeviceError
            If the device is missing or refuses, or its wire is in use.
        """
        self.claim_wires()
        if self.device is not None:
            self.device.open()
        self._forget()
        self.become(FAULT if self._trip.item() else OPEN)

    def _forget(self) -> None:
        """Drop what was read before: it tells nothing about the device as it is now."""
        self.device_monitors.forget()
        self._age[...] = 0
        self._sequence[...] = 0
        if self.stopped is not None and self.way is not None:
            self.stopped[...], self.way[:] = 0, math.nan

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
        if self.status_number != OPEN:
            raise DeviceError(f"device '{name}' is {self.status.name}, it can't be enabled")
        if self._trip.item():
            raise DeviceError(f"device '{name}' was stopped by {self.trip.label}: it must be re-armed first")
        self._refuse_spent()
        if not self.model.twin and self.model.reads and not self._sequence.item():
            raise DeviceError(f"device '{name}' has not read anything yet: nothing could watch what it does")
        self.rest_at_measured()
        self.device_monitors.begin()
        self.become(ENABLED)
        self._ramp[...] = 0.0 if self.model.limits.ramp > 0.0 else 1.0

    def rest_at_measured(self) -> None:
        """Begin each command at its safe value, or where the device stands."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.sent[channel.name] = channel.safe
            elif channel.role is Role.SURFACE_POSE and self._pose is not None:
                self.sent[channel.name] = self.reading[self._pose]
            self.command[channel.name] = self.sent[channel.name]

    def disable(self) -> None:
        """Stop commands; ENABLED -> OPEN."""
        if self.status_number == ENABLED:
            self.become(OPEN)

    def rearm(self, tick: int) -> None:
        """Release the latched trip: FAULT -> OPEN; commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If what stopped the device is not over: its reading is still wrong, a budget is used up, or it has been
            re-armed too often within a minute.
        """
        if self.status_number != FAULT:
            return
        self._refuse_spent()
        self._refuse_often(tick)
        self._forget()
        try:
            self._take()
            self.device_monitors.believe(tick, 0.0)
        except TripError as error:
            self.device_monitors.put_back()
            raise DeviceError(f"device '{self.model.name}' can't be re-armed: it {error}") from error
        self._sequence[...] = 1
        self._trip[...] = Trip.NONE
        self.become(OPEN)
        self._rearmed[1:] = self._rearmed[:-1].copy()
        self._rearmed[0] = tick

    def _refuse_spent(self) -> None:
        said = next(
            (words for words in (self.device_monitors.spent(), *(one.spent() for one in self.shared)) if words), ""
        )
        if said:
            raise DeviceError(f"device '{self.model.name}' {said}")

    def _refuse_often(self, tick: int) -> None:
        """Refuse to re-arm a device again that was re-armed often within a minute: the cause was not found (W4)."""
        oldest = int(self._rearmed[-1])
        wait = MINUTE - (tick - oldest) * self._period
        if oldest >= 0 and wait > 0.0:
            often = f"was re-armed {len(self._rearmed)} times within a minute"
            raise DeviceError(f"device '{self.model.name}' {often}: find out why it stops, and wait {wait:.0f} s")

    def ramp_in(self) -> None:
        """Begin with a share of zero and let it grow, as after every re-arming."""
        self._ramp[...] = 0.0

    def reconnect(self) -> None:
        """Close and open the device anew; FAULT or CLOSED -> OPEN, with nothing remembered from before.

        A trip for a lost connection is released by that; any other trip stays latched (FAULT).

        Raises
        ------
        DeviceError
            If the device is missing or refuses (it stays CLOSED), or a budget such as its thermal dose is used up.
        """
        self._refuse_spent()
        self.leave()
        if self._trip.item() in LOSSES:
            self._trip[...] = Trip.NONE
        self.open()
        self.rest_at_safe()

    def rest_at_safe(self) -> None:
        """Set commands to their safe values, so that nothing that was requested before is ever sent again."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = self.sent[channel.name] = np.array(channel.safe)

    def take_over(self, other: Lifecycle) -> None:
        """Take over the open device of another instance, which is then CLOSED and can no longer send anything.

        The device itself does not notice.  A latched trip stays latched, and commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If the other still lets commands through.
        """
        if other.enabled:
            raise DeviceError(f"device '{self.model.name}' must be made safe before another scene takes it over")
        if other.status_number == CLOSED:
            return
        self.device, other.device = other.device, None
        self._claims, other._claims = other._claims, self._claims
        other.become(CLOSED)
        self.become(FAULT if self._trip.item() else OPEN)

    def leave(self) -> None:
        """Give the device up, whatever it raises; any status -> CLOSED."""
        with contextlib.suppress(Exception, SystemExit):  # a lost device may refuse to be closed
            self.close()

    def close(self) -> None:
        """Send the safe command and release the device; any status -> CLOSED."""
        if self.status_number == CLOSED:
            self._claims.release()
            return
        try:
            self._send_safe()
        finally:
            self.become(CLOSED)
            self._let_go()
            self._claims.release()  # but not if the device can't be closed: its driver may still use the wire

    def _let_go(self) -> None:
        """Close the device, which has been sent its safe command by then; don't wait for it for ever.

        Raises
        ------
        DeviceError
            If it does not return from closing in time.
        """
        if self.device is None:
            return
        failed: list[BaseException] = []

        def work(close: Callable[[], None] = self.device.close) -> None:
            try:
                close()
            except BaseException as error:
                failed.append(error)

        thread = threading.Thread(target=work, name=f"close {self.model.name}", daemon=True)
        thread.start()
        thread.join(CLOSE_TIME)
        if thread.is_alive():
            raise DeviceError(f"did not return from closing within {CLOSE_TIME:g} s")
        if failed:
            raise failed[0]


def _part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
