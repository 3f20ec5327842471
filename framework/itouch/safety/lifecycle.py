"""The status machine round one device.

CLOSED --open--> OPEN --enable--> ENABLED --disable--> OPEN --close--> CLOSED; any error, NaN or trip leads to FAULT,
which latches until an operator re-arms.  In OPEN and FAULT only safe commands are sent: a plugin can't forward a
command while it is disabled, because it never receives one.
"""

from __future__ import annotations

import contextlib
import enum
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from itouch.plugin import Channel, Device, DeviceError, Record, Twin
from itouch.safety.heat import Heat
from itouch.safety.readings import Watch
from itouch.safety.trips import LOSSES, Trip, TripError
from itouch.world import DeviceModel
from itouch.world.supervision import SLOW, heats


class Status(enum.IntEnum):
    """What a device may do now."""

    CLOSED = 0
    OPEN = 1
    ENABLED = 2
    FAULT = 3


#: The same as plain numbers: an attribute of an enumeration costs a microsecond.
CLOSED, OPEN, ENABLED, FAULT = (int(status) for status in Status)


#: See ``Lifecycle.stopped``.
HELD, BACKWARDS = 1, 2


class Lifecycle(ABC):
    """What one device, or its twin, may do now, on its part of State."""

    def __init__(
        self, model: DeviceModel, state: Record, period: float, *, device: Device | None, twin: Twin | None
    ) -> None:
        self.model, self._period = model, period
        self.device, self.twin = device, twin
        name = model.name
        self.reading = _part(state, f"{name}.", model.reads)
        self.command = _part(state, f"{name}.command.", model.commands)
        self.sent = _part(state, f"{name}.sent.", model.commands)
        has_twin_state = twin is not None and any(n.startswith(f"{name}.twin.") for n in state)
        self.twin_state = state.part(f"{name}.twin.") if has_twin_state else Record(np.dtype([]))
        self._status, self._trip, self._tripped = (state[f"{name}.{field}"] for field in ("status", "trip", "tripped"))
        self._ramp, self._age, self._sequence = (state[f"{name}.{field}"] for field in ("ramp", "age", "sequence"))
        self._measured, self._left = state[f"{name}.measured"], state.get(f"{name}.left")
        self._out = _part(state, f"{name}.out.", model.commands) if self._left is not None else self.sent
        #: How a surface retracts (none: it can't): 0 as it should; HELD where it is, because retracting made it come
        #: nearer; BACKWARDS, because it still presses then.
        self.stopped = state.get(f"{name}.stopped")
        self._every = max(1, round(model.cls.period / period))
        self._slow = self._every * max(1, round(SLOW / (self._every * period)))
        self.watch = Watch(model.reads, self.reading, model.limits, model.commands)
        self.heat: Heat | None = None
        if heats(model.reads):
            self.heat = Heat(model, state, self.reading, self.sent, self._slow * period)

    @abstractmethod
    def _take(self) -> bool | None:
        """Read the twin or the device; whatever goes wrong is a trip."""

    @abstractmethod
    def _send_safe(self) -> None:
        """Send the safe command of every channel."""

    @property
    def enabled(self) -> bool:
        """Whether commands are let through."""
        return bool(self._status.item() == ENABLED)

    @property
    def status(self) -> Status:
        """What the device may do now."""
        return Status(self._status.item())

    @property
    def trip(self) -> Trip:
        """Why the device was stopped, latched until it is re-armed."""
        return Trip(self._trip.item())

    @property
    def tripped(self) -> int:
        """The tick at which the device was stopped last; -1: never."""
        return int(self._tripped.item())

    def reset(self) -> None:
        """Set what is remembered to its start."""
        self.watch.forget()
        self._tripped[...] = -1
        if self.heat is not None:
            self.heat.reset()

    def restore(self) -> None:
        """Go on from a State that was put in place."""
        if self._sequence.item():
            self.watch.recall()
        else:
            self.watch.forget()

    def open(self) -> None:
        """Open the device; CLOSED -> OPEN, or FAULT if a trip is latched: only re-arming releases it.

        Raises
        ------
        DeviceError
            If the device is missing or refuses.
        """
        if self.device is not None:
            self.device.open()
        self._forget()
        self._status[...] = FAULT if self._trip.item() else OPEN

    def _forget(self) -> None:
        """Drop what was read before: it says nothing of the device as it is now."""
        self.watch.forget()
        self._age[...] = 0
        self._sequence[...] = 0
        if self.stopped is not None:
            self.stopped[...] = 0
        if self.heat is not None:
            self.heat.forget()

    def enable(self) -> None:
        """Let commands through from the state that was measured; OPEN -> ENABLED.

        Raises
        ------
        DeviceError
            If the device is not OPEN.
        """
        if self._status.item() != OPEN:
            raise DeviceError(f"device '{self.model.name}' is {self.status.name}, it can't be enabled")
        self.rest_at_measured()
        self._status[...] = ENABLED
        self._ramp[...] = 0.0 if self.model.limits.ramp > 0.0 else 1.0

    def rest_at_measured(self) -> None:
        """Begin each command where it is safe: at its safe value, or where the device stands."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.sent[channel.name] = channel.safe
            elif channel.name == "pose_target" and "pose" in self.reading:
                self.sent[channel.name] = self.reading["pose"]
            self.command[channel.name] = self.sent[channel.name]

    def disable(self) -> None:
        """Stop commands; ENABLED -> OPEN."""
        if self._status.item() == ENABLED:
            self._status[...] = OPEN

    def rearm(self) -> None:
        """Release the latched trip: FAULT -> OPEN; commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If what stopped the device is not over: its reading is still wrong, or its thermal dose is used up.
        """
        if self._status.item() != FAULT:
            return
        self._refuse_spent()
        self._forget()
        try:
            self._take()
            self.watch.check(0.0)
        except TripError as error:
            self.watch.put_back()
            raise DeviceError(f"device '{self.model.name}' can't be re-armed: it {error}") from error
        self._sequence[...] = 1
        self._trip[...] = Trip.NONE
        self._status[...] = OPEN

    def _refuse_spent(self) -> None:
        if self._trip.item() == Trip.DOSE:
            raise DeviceError(f"device '{self.model.name}' has given the whole thermal dose of a session")

    def ramp_in(self) -> None:
        """Begin with nothing and let commands grow, as after every re-arming."""
        self._ramp[...] = 0.0

    def reconnect(self) -> None:
        """Close and open the device anew; FAULT or CLOSED -> OPEN, with nothing remembered of before.

        What it was stopped for is over with a connection that was lost; any other trip stays latched (FAULT).

        Raises
        ------
        DeviceError
            If the device is missing or refuses (it stays CLOSED), or its thermal dose is used up.
        """
        self._refuse_spent()
        self.leave()
        if self._trip.item() in LOSSES:
            self._trip[...] = Trip.NONE
        self.open()
        self.rest_at_safe()

    def rest_at_safe(self) -> None:
        """Forget every command: nothing that was asked for before is ever sent again."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = self.sent[channel.name] = np.array(channel.safe)

    def leave(self) -> None:
        """Give the device up, whatever it says; any status -> CLOSED."""
        with contextlib.suppress(Exception):  # a lost device may refuse to be closed
            self.close()

    def close(self) -> None:
        """Send the safe command and release the device; any status -> CLOSED."""
        if self._status.item() == CLOSED:
            return
        try:
            self._send_safe()
        finally:
            self._status[...] = CLOSED
            if self.device is not None:
                self.device.close()


def _part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
