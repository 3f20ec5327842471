"""Reading what a servo process publishes: copies of State and Timing that are whole, or none at all."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.servo import control_block as at
from itouch.servo.publish import total
from itouch.servo.shared_memory import SLOT_HEAD, ServoError, SharedMemory

_TOLD = struct.Struct("<qqqq")
_ATTEMPTS = 1000


@dataclass(frozen=True, slots=True)
class Entry:
    """One published State: its bytes, and what is known of its tick.

    ``sequence`` counts publications from 1; ``host_ns`` is the monotonic clock [ns] when it was published; ``lateness``
    and ``duration`` [s] are those of the tick.
    """

    sequence: int
    tick: int
    host_ns: int
    lateness: float
    duration: float
    state: bytes


class Ring:
    """The ring of States, as a reader sees it."""

    def __init__(self, segment: SharedMemory) -> None:
        words = segment.words
        self._words = words
        self.slots, size = int(words[at.SLOTS]), int(words[at.SLOT_SIZE])
        self.state_size, self._summed = int(words[at.STATE_SIZE]), bool(words[at.SUMMED])
        self._ring = segment.part(int(words[at.RING_AT]), self.slots * size).reshape(self.slots, size)

    @property
    def head(self) -> int:
        """The sequence number of the newest State; 0 before the first."""
        return int(self._words[at.HEAD])

    def copy(self, sequence: int, into: NDArray[np.uint8]) -> tuple[int, int, int, int] | None:
        """Copy one State; return its tick, and host time, lateness and duration [ns], or None if it is gone.

        ``into`` (n,): room for the bytes of a State.
        """
        row = self._ring[sequence % self.slots]
        marks = row[:16].view(np.int64)
        if int(marks[1]) != sequence:
            return None
        into[:] = row[SLOT_HEAD : SLOT_HEAD + self.state_size]
        told = _TOLD.unpack_from(row, 16)
        if self._summed and int(row[56:64].view(np.int64)[0]) != total(into):
            return None
        return told if int(marks[0]) == sequence else None

    def newest(self, into: NDArray[np.uint8]) -> tuple[int, int, int, int] | None:
        """Copy the bytes of the newest State into an array (n,); None before the first.

        Raises
        ------
        ServoError
            If no whole copy could be made, which means that the writer died while writing its only State.
        """
        for attempt in range(_ATTEMPTS):
            head = self.head
            if head == 0:
                return None
            told = self.copy(head, into)
            if told is not None:
                return told
            if attempt > 10:
                time.sleep(1e-4)
        raise ServoError("the newest State could not be read whole")


class Follower:
    """Takes every State in order, from the one after the newest; those that it was too slow for are counted."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._next = ring.head + 1
        self._buffer = np.zeros(ring.state_size, np.uint8)
        #: How many States were overwritten before they were taken.
        self.dropped = 0

    def take(self, most: int = 1 << 30) -> Iterator[Entry]:
        """Yield the new States, at most ``most``."""
        for _ in range(most):
            head = self._ring.head
            if self._next > head:
                return
            behind = head - self._next
            if behind >= self._ring.slots - 2:  # about to be overwritten: skip to where there is time to read
                lost = behind - self._ring.slots // 2
                self.dropped += lost
                self._next += lost
            told = self._ring.copy(self._next, self._buffer)
            self._next += 1
            if told is None:
                self.dropped += 1
                continue
            tick, host, late, duration = told
            yield Entry(self._next - 1, tick, host, late * 1e-9, duration * 1e-9, self._buffer.tobytes())


def copy_timing(segment: SharedMemory, into: NDArray[np.uint8]) -> bool:
    """Copy the bytes of Timing into an array (n,); false if the servo process died while it was writing it."""
    words = segment.words
    area = segment.part(int(words[at.TIMING_AT]), int(words[at.TIMING_SIZE]))
    for attempt in range(_ATTEMPTS):
        number = int(words[at.TIMING_END])
        into[:] = area
        if int(words[at.TIMING_BEGIN]) == number:
            return True
        if attempt > 10:
            time.sleep(1e-5)
    return False
