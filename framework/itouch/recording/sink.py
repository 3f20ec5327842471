"""The file under a recording: bytes go to the disk at once; a failed write leaves whole chunks behind."""

from __future__ import annotations

import contextlib
import errno
import os
import time

from itouch.platforms import OPEN_FLAGS, claim

#: Seconds between two syncs to the disk: what a loss of power may cost beyond what a kill costs.
SYNC_EVERY = 1.0


class Sink:
    """An append-only file; ``write`` writes all of it, or raises and takes back what it wrote."""

    def __init__(self, path: str) -> None:
        self.path, self.size = path, 0
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | OPEN_FLAGS, 0o644)
        try:
            self._claim()
        except OSError:
            os.close(self._handle)
            raise
        self._synced = time.monotonic()

    def _claim(self) -> None:
        """Empty the file, unless another session is writing it: what it has recorded would be lost."""
        try:
            claim(self._handle)
        except BlockingIOError:
            raise OSError(errno.EBUSY, "another session is recording to it") from None
        with contextlib.suppress(OSError):  # what has no length, such as a device
            os.ftruncate(self._handle, 0)

    def write(self, data: bytes) -> None:
        """Append some whole records.

        Raises
        ------
        OSError
            If not all of it could be written; the file ends where it ended before.
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
        """Write what the system takes at once, and return how much that was."""
        return os.write(self._handle, view)

    def sync(self) -> None:
        """Wait until it is on the disk, where the file is one that can be synced."""
        self._synced = time.monotonic()
        try:
            os.fdatasync(self._handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EROFS):
                raise

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            os.close(self._handle)
