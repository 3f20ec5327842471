"""The file of a recording: bytes are written at once, and a failed write leaves only whole chunks behind."""

from __future__ import annotations

import contextlib
import errno
import os
import time

from itouch.platforms import OPEN_FLAGS, claim
from itouch.schema.durable import GONE

#: Time between two syncs to the disk [s]: what a power failure may cost beyond what a kill costs.
SYNC_EVERY = 1.0


class Sink:
    """An append-only file; ``write`` writes all of its data, or raises and removes what it has written."""

    def __init__(self, path: str) -> None:
        self.path, self.size = path, 0
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | OPEN_FLAGS, 0o644)
        try:
            self._claim()
        except OSError:
            os.close(self._handle)
            raise
        self._named = os.fstat(self._handle).st_nlink > 0  # some file systems count no names at all
        self._synced = time.monotonic()

    def _claim(self) -> None:
        """Empty the file, unless another session is writing it, whose recording would be lost."""
        try:
            claim(self._handle)
        except BlockingIOError:
            raise OSError(errno.EBUSY, "another session is recording to it") from None
        with contextlib.suppress(OSError):  # a file without a length, such as a device
            os.ftruncate(self._handle, 0)

    def write(self, data: bytes) -> None:
        """Append whole records.

        Raises
        ------
        OSError
            If not all of them could be written; the file then ends where it ended before.
        """
        view = memoryview(data)
        try:
            while view:
                done = self.put(view)
                if done <= 0:
                    raise OSError(errno.EIO, "nothing was written")
                view = view[done:]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._handle, self.size)
                os.lseek(self._handle, self.size, os.SEEK_SET)
            raise
        self.size += len(data)
        if time.monotonic() - self._synced > SYNC_EVERY:
            self.sync()

    def put(self, view: memoryview) -> int:
        """Write as much as the system takes at once, and return how many bytes that was."""
        return os.write(self._handle, view)

    def sync(self) -> None:
        """Wait until the file is on the disk, if it is one that can be synced.

        Raises
        ------
        OSError
            If the disk refuses, or the file has been removed or replaced: what is written is gone when it is closed.
        """
        self._synced = time.monotonic()
        if self._named and os.fstat(self._handle).st_nlink == 0:
            raise OSError(errno.ENOENT, GONE)
        try:
            os.fdatasync(self._handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EROFS):
                raise

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            os.close(self._handle)
