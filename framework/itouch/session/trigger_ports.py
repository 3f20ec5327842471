"""Wires for event codes: a serial trigger box, a parallel port.

A trigger box takes each byte as the state of its eight lines; a parallel port's data lines are set the same way.
Sources: the Linux headers ``termios`` and ``linux/ppdev.h``.
"""

from __future__ import annotations

import contextlib
import os
import sys
from abc import ABC, abstractmethod

from itouch.session.session_error import SessionError

#: Requests to Linux parallel ports: claim, release, set the data lines.
_CLAIM, _LET_GO, _SET = 0x708B, 0x708C, 0x40017086


class Wire(ABC):
    """Eight lines that show a code until the next one; setting them never blocks."""

    def __init__(self, port: str) -> None:
        self.port = port

    @abstractmethod
    def put(self, code: int) -> None:
        """Set the lines to a code, 0 to 255.

        Raises
        ------
        OSError
            If the port is gone.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the port."""


class SerialWire(Wire):
    """A trigger box on a serial port: 115200 baud, eight bits, no parity."""

    def __init__(self, port: str) -> None:
        super().__init__(port)
        import termios
        import tty

        self.handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            tty.setraw(self.handle)
            set_ = termios.tcgetattr(self.handle)
            set_[2] |= termios.CLOCAL | termios.CREAD  # don't wait for modem control lines
            set_[4] = set_[5] = termios.B115200
            termios.tcsetattr(self.handle, termios.TCSANOW, set_)
        except (OSError, termios.error) as error:
            os.close(self.handle)
            raise OSError(f"no serial port: {error}") from error

    def put(self, code: int) -> None:
        """Send the byte."""
        os.write(self.handle, bytes((code,)))

    def close(self) -> None:
        """Close the port."""
        os.close(self.handle)


class ParallelWire(Wire):
    """The data lines of a parallel port, by Linux's ``/dev/parportN``."""

    def __init__(self, port: str) -> None:
        super().__init__(port)
        self._handle = os.open(port, os.O_RDWR | os.O_CLOEXEC)
        try:
            self._ask(_CLAIM)
        except OSError:
            os.close(self._handle)
            raise

    def _ask(self, request: int, data: bytes = b"") -> None:
        from fcntl import ioctl

        ioctl(self._handle, request, data)

    def put(self, code: int) -> None:
        """Set the lines."""
        self._ask(_SET, bytes((code,)))

    def close(self) -> None:
        """Release the port."""
        with contextlib.suppress(OSError):
            self._ask(_LET_GO)
        os.close(self._handle)


def wire(port: str) -> Wire:
    """Open a port for event codes: a parallel port by its name, else a serial one.

    Raises
    ------
    SessionError
        If it can't be opened.
    """
    if sys.platform == "win32":
        raise SessionError("event codes on a wire need Linux or macOS; --lsl gives marks on every system")
    try:
        return (ParallelWire if "parport" in os.path.basename(port) else SerialWire)(port)
    except OSError as error:
        raise SessionError(f"no event codes can be put on '{port}': {error.strerror or error}") from error
