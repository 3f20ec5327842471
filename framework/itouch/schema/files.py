"""Opens files that a user names: regular files only, so that no pipe or device can block the program."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO

from itouch.platforms import NO_WAIT, OPEN_FLAGS


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading.

    Raises
    ------
    OSError
        If it cannot be opened, or is a pipe, a device, a socket or a folder.
    """
    handle = os.open(path, os.O_RDONLY | NO_WAIT | OPEN_FLAGS)  # a pipe without a writer is not waited for
    try:
        mode = os.fstat(handle).st_mode
        if not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "a pipe, a device or a socket"
            raise OSError(errno.EINVAL, f"it is {kind}, not a file", os.fspath(path))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise
