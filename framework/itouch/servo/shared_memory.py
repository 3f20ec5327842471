"""A session's shared memory: an anonymous file that its processes hold open, so that it can't be left behind.

It has no name in any folder.  A process that attaches opens it through the file descriptors of processes of the same
user (``/proc/PID/fd``); when the last process that holds it ends, however it dies, the memory is gone.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.platforms import SERVO_PROCESS, claim
from itouch.schema import ItouchError
from itouch.servo import control_block as at

#: Prefix of the memory's name, followed by the session's name.
PREFIX = "itouch:"


class ServoError(ItouchError):
    """A servo process that can't be started, found or reached, or that has died."""


class SharedMemory:
    """The mapped memory of one session; the control words exist at once, the rest once ``grow`` has been called."""

    def __init__(self, handle: int, name: str) -> None:
        self.handle, self.name = handle, name
        self.map()

    @classmethod
    def create(cls, name: str) -> SharedMemory:
        """Create the memory of a new session, with its control words only."""
        if SERVO_PROCESS:
            handle = os.memfd_create(PREFIX + name, os.MFD_CLOEXEC)
            os.ftruncate(handle, at.HEAD_SIZE)
            segment = cls(handle, name)
        else:
            segment = PrivateMemory(name)
        segment.words[at.FORMAT] = at.FORMAT_VALUE
        segment.words[at.OWNER] = os.getpid()
        segment.words[at.MAGIC] = at.MAGIC_VALUE
        return segment

    def map(self) -> None:
        """Map the memory in its present size.

        Raises
        ------
        ServoError
            If it is too short for that of a session.
        """
        size = os.fstat(self.handle).st_size
        if size < at.HEAD_SIZE:
            raise ServoError("this is not the memory of a servo process: it is too short")
        self._mapped = mmap.mmap(self.handle, size)
        self.bytes: NDArray[np.uint8] = np.frombuffer(self._mapped, np.uint8)
        self.words: NDArray[np.int64] = self.bytes[: at.WORDS * 8].view(np.int64)

    def check(self) -> None:
        """Check that this is the memory of a session whose layout this program knows.

        Raises
        ------
        ServoError
            If it is not.
        """
        if int(self.words[at.MAGIC]) != at.MAGIC_VALUE:
            raise ServoError("this is not the memory of a servo process")
        if int(self.words[at.FORMAT]) != at.FORMAT_VALUE:
            raise ServoError(f"session '{self.name}' has memory format {int(self.words[at.FORMAT])}; this program "
                             f"reads {at.FORMAT_VALUE}: run both with the same version of itouch-py")  # fmt: skip

    def grow(
        self, meta: dict[str, Any], state_size: int, timing_size: int, slots: int, summed: bool,
        files: Mapping[str, bytes] | None = None,
    ) -> None:  # fmt: skip
        """Lay out and write what follows the control words; called once, by the servo process.

        Parameters
        ----------
        meta
            Description of the session, as JSON can hold it.
        state_size, timing_size
            Of State and Timing [bytes].
        slots
            How many States the ring holds.
        summed
            Whether slots carry a checksum.
        files
            The files that the scene names; None: they are not carried along.
        """
        timing_at = _aligned(at.HEAD_SIZE)
        files_at = _aligned(timing_at + timing_size)
        content, places = _packed(files, files_at)
        text = json.dumps({**meta, "files": places}).encode()
        meta_at = _aligned(files_at + len(content))
        ring_at = _aligned(meta_at + len(text))
        slot_size = _aligned(SLOT_HEAD + state_size)
        self._resize(ring_at + slots * slot_size)
        self.bytes[meta_at : meta_at + len(text)] = np.frombuffer(text, np.uint8)
        self.bytes[files_at : files_at + len(content)] = np.frombuffer(content, np.uint8)
        for word, value in (
            (at.META_AT, meta_at), (at.META_SIZE, len(text)), (at.TIMING_AT, timing_at), (at.TIMING_SIZE, timing_size),
            (at.RING_AT, ring_at), (at.SLOTS, slots), (at.SLOT_SIZE, slot_size), (at.STATE_SIZE, state_size),
            (at.SUMMED, int(summed)), (at.SIZE, len(self.bytes)),
        ):  # fmt: skip
            self.words[word] = value

    def _resize(self, size: int) -> None:
        os.ftruncate(self.handle, size)
        self.map()

    @contextlib.contextmanager
    def alone(self, *, wait: bool) -> Iterator[bool]:
        """Lock out all others that write commands or claim words; yield false if another one has the lock.

        The kernel releases the lock if the process dies.  The file is opened anew each time, because two threads of one
        process must lock each other out, too.

        Parameters
        ----------
        wait
            Whether to wait for the lock.
        """
        lock = os.open(f"/proc/self/fd/{self.handle}", os.O_RDWR | os.O_CLOEXEC)
        try:
            yield _claimed(lock, wait=wait)
        finally:
            os.close(lock)

    def meta(self) -> dict[str, Any]:
        """Return the servo process's description of the session: names, layout, scene."""
        start, size = int(self.words[at.META_AT]), int(self.words[at.META_SIZE])
        if start + size > len(self.bytes):  # it was mapped just before it had grown
            self.map()
        found: dict[str, Any] = json.loads(self.bytes[start : start + size].tobytes())
        return found

    def part(self, where: int, size: int) -> NDArray[np.uint8]:
        """Return the view of one part, from offset ``where`` on, of ``size`` bytes."""
        return self.bytes[where : where + size]

    @property
    def phase(self) -> int:
        """The phase of the servo process, see ``control_block.PHASES``."""
        return int(self.words[at.PHASE])

    def close(self) -> None:
        """Release the memory; views that are still held keep it alive."""
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1


#: Before each State in the ring: sequence at start and end, tick, host time, lateness and duration [ns], flags, sum.
SLOT_HEAD = 64
_PAGE = 64


def _packed(files: Mapping[str, bytes] | None, start: int) -> tuple[bytes, dict[str, list[int]] | None]:
    """Return files one after the other, and file name -> offset and size; None if files are not carried along."""
    if files is None:
        return b"", None
    places, end = {}, start
    for name, data in files.items():
        places[name] = [end, len(data)]
        end += len(data)
    return b"".join(files.values()), places


def _aligned(size: int) -> int:
    return -(-size // _PAGE) * _PAGE


def _claimed(lock: int, *, wait: bool) -> bool:
    while True:
        try:
            claim(lock)
        except BlockingIOError:
            if not wait:
                return False
            time.sleep(0.001)
        else:
            return True


class PrivateMemory(SharedMemory):
    """The memory of a session whose loop runs in a thread: nobody else can see it."""

    def __init__(self, name: str) -> None:
        self._alone = threading.Lock()
        self._mapped = mmap.mmap(-1, at.HEAD_SIZE)
        super().__init__(-1, name)

    def map(self) -> None:
        """Make views of the memory in its present size."""
        self.bytes = np.frombuffer(self._mapped, np.uint8)
        self.words = self.bytes[: at.WORDS * 8].view(np.int64)

    def _resize(self, size: int) -> None:
        before = self.words
        larger = mmap.mmap(-1, size)
        larger[: len(self._mapped)] = self._mapped[:]
        self._mapped = larger
        self.map()
        self.words[at.STOP] |= before[at.STOP]  # a request to stop at this very moment must not be lost

    @contextlib.contextmanager
    def alone(self, *, wait: bool) -> Iterator[bool]:
        """Lock out the other threads; yield false if one of them has the lock."""
        held = self._alone.acquire(blocking=wait)
        try:
            yield held
        finally:
            if held:
                self._alone.release()


def monotonic() -> int:
    """Return the monotonic clock [ns], which all processes of this machine share."""
    return time.monotonic_ns()
