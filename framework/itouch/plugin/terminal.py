"""A serial port that is none: a pseudo-terminal, behind which an emulator answers."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from itouch.plugin.device import DeviceError


class Terminal:
    """A pseudo-terminal that a program may open as a serial port, under a name of our choice."""

    def __init__(self, name: str = "") -> None:
        import tty

        self._ours, theirs = os.openpty()
        tty.setraw(self._ours)
        tty.setraw(theirs)
        os.set_blocking(self._ours, False)
        self.path, self._name, self._theirs = os.ttyname(theirs), name, theirs
        if name:
            with contextlib.suppress(FileNotFoundError):
                if Path(name).is_symlink():
                    os.unlink(name)
            try:
                os.symlink(self.path, name)
            except OSError as error:
                self._name = ""
                self.close()
                raise DeviceError(f"no virtual port can be made at '{name}': {error.strerror}") from error

    def fileno(self) -> int:
        """Return the descriptor on which bytes of the other side come."""
        return self._ours

    def receive(self) -> bytes:
        """Return what has come, without waiting."""
        try:
            return os.read(self._ours, 1 << 16)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):  # nothing, or nobody there
                return b""
            raise

    def send(self, data: bytes) -> None:
        """Send; what nobody reads is lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._ours, data)

    def close(self) -> None:
        """Take the port away."""
        os.close(self._ours)
        os.close(self._theirs)
        if self._name:
            with contextlib.suppress(OSError):
                os.unlink(self._name)
