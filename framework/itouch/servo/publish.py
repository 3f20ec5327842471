"""Publishing State and Timing from the servo process, which never waits and does not know who reads.

Every State goes into the next slot of a ring.  The slot's sequence number is written before and after the copy; a
reader reads the two in the opposite order, and keeps its copy only if both are the number that it wants.
"""

from __future__ import annotations

import platform
import struct

import numpy as np

from itouch.loop.timing import Timing
from itouch.plugin import Record
from itouch.servo import control_block as at
from itouch.servo.shared_memory import SLOT_HEAD, SharedMemory, monotonic

#: Whether this processor keeps the order of writes, and of reads, as others see it; else a checksum proves a copy.
ORDERED = platform.machine().lower() in ("x86_64", "amd64", "i686", "i386")
#: Greatest size of the ring [bytes], and how far [s] it should reach back.
RING_BYTES, RING_SECONDS = 64 << 20, 2.0
#: Timing is published once in this many ticks.
TIMING_EVERY = 20
_TOLD = struct.Struct("<qqqq")


def slots_for(state_size: int, period: float) -> int:
    """Return how many States of this size [bytes] the ring holds, at a period [s]."""
    return max(64, min(round(RING_SECONDS / period), RING_BYTES // max(1, state_size)))


class Publisher:
    """Writes each tick's State, and from time to time Timing, into a session's memory."""

    def __init__(self, segment: SharedMemory, state: Record, timing: Timing) -> None:
        words = segment.words
        self._words, self._state, self._timing = words, state.raw, timing.record.raw
        self._slots, size = int(words[at.SLOTS]), int(words[at.SLOT_SIZE])
        ring = segment.part(int(words[at.RING_AT]), self._slots * size).reshape(self._slots, size)
        self._marks = [row[:16].view(np.int64) for row in ring]
        self._told = [row[16:48].data for row in ring]
        self._sums = [row[56:64].view(np.int64) for row in ring]
        self._bodies = [row[SLOT_HEAD : SLOT_HEAD + len(self._state)] for row in ring]
        self._summed = bool(words[at.SUMMED])
        self._timing_area = segment.part(int(words[at.TIMING_AT]), int(words[at.TIMING_SIZE]))
        self._count = int(words[at.HEAD])

    def publish(self, tick: int, late: float = 0.0, duration: float = 0.0) -> None:
        """Publish the State after a tick, with how late [s] it began and how long [s] it took."""
        count = self._count + 1
        index = count % self._slots
        mark, body = self._marks[index], self._bodies[index]
        mark[0] = count
        body[:] = self._state
        _TOLD.pack_into(self._told[index], 0, tick, monotonic(), round(late * 1e9), round(duration * 1e9))
        if self._summed:
            self._sums[index][0] = total(body)
        mark[1] = count
        self._words[at.HEAD] = self._count = count

    def publish_timing(self) -> None:
        """Publish Timing."""
        words = self._words
        number = int(words[at.TIMING_BEGIN]) + 1
        words[at.TIMING_BEGIN] = number
        self._timing_area[:] = self._timing
        words[at.TIMING_END] = number


def total(body: np.typing.NDArray[np.uint8]) -> int:
    """Return a checksum of a State, which a copy mixed from two States has only by chance.

    ``body`` (n,): the bytes of the State.
    """
    whole = len(body) // 8 * 8
    weights = np.arange(1, whole // 8 + 1, dtype=np.uint64)
    return int((body[:whole].view(np.uint64) * weights).sum(dtype=np.uint64).view(np.int64))
