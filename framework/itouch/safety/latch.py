"""What a device may do now, and the trip that stopped it, which stays latched until an operator re-arms."""

from __future__ import annotations

import enum

from itouch.monitors import Trip
from itouch.plugin import Record


class Status(enum.IntEnum):
    """What a device may do now."""

    CLOSED = 0
    OPEN = 1
    ENABLED = 2
    FAULT = 3


#: The same as plain numbers: an attribute of an enumeration costs a microsecond.
CLOSED, OPEN, ENABLED, FAULT = (int(status) for status in Status)
_TRIPS = frozenset(int(trip) for trip in Trip)


class Latch:
    """The status and the latched trip of one device, in State; the status is kept beside it, too."""

    def __init__(self, state: Record, name: str) -> None:
        self._status, self._trip, self._tripped = (state[f"{name}.{field}"] for field in ("status", "trip", "tripped"))
        #: The status, kept where nothing that writes into the memory of State can change it: a surface under a finger
        #: must be withdrawn, and a device closed, even if State says otherwise.
        self.number: int = self._status.item()
        #: The status as compiled code sees it, shape (1,).
        self.seen = self._status.reshape(1)

    def become(self, status: int) -> None:
        """Set the status."""
        self._status[...] = self.number = status

    def recall(self) -> None:
        """Take the status from a State that was restored."""
        self.number = self._status.item()

    def forged(self) -> str:
        """Correct the status in State if something has overwritten it; return the words for that, or nothing."""
        said = self._status.item()
        if said == self.number:
            return ""
        self._status[...] = self.number
        return f"something has written {said} over its status"

    @property
    def status(self) -> Status:
        """What the device may do now."""
        return Status(self.number)

    @property
    def enabled(self) -> bool:
        """Whether commands are let through."""
        return self.number == ENABLED

    @property
    def latched(self) -> bool:
        """Whether a trip is latched."""
        return bool(self._trip.item())

    @property
    def trip(self) -> Trip:
        """Why the device was stopped, latched until it is re-armed."""
        number = self._trip.item()
        return Trip(number) if number in _TRIPS else Trip.MODALITY_ERROR  # something has overwritten it

    @property
    def tripped(self) -> int:
        """The tick at which the device was stopped last; -1: never."""
        return int(self._tripped.item())

    def stop(self, trip: Trip, tick: int) -> None:
        """Latch a trip; any status -> FAULT, but one that is CLOSED stays that: it is FAULT once it is open."""
        if self.number != CLOSED:
            self.become(FAULT)
        self._trip[...] = trip
        self._tripped[...] = tick

    def release(self) -> None:
        """Release the latched trip; the status stays as it is."""
        self._trip[...] = Trip.NONE

    def disable(self) -> None:
        """Stop commands; ENABLED -> OPEN."""
        if self.number == ENABLED:
            self.become(OPEN)

    def open(self) -> None:
        """Begin without commands, as a device that was opened: OPEN, or FAULT if a trip is latched."""
        self.become(FAULT if self.latched else OPEN)

    def reset(self) -> None:
        """Forget when the device was stopped."""
        self._tripped[...] = -1
