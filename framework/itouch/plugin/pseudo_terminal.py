"""A virtual serial port: a pseudo-terminal, behind which an emulator answers."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import time
from collections import deque

from itouch.plugin.device import DeviceError
from itouch.plugin.wire_claims import WireClaims, WireHeldError

#: Bits on a serial line per byte: start, eight, stop.
_BITS = 10
#: Where the system keeps pseudo-terminals.
_TERMINALS = "/dev/pts/"


class Terminal:
    """A pseudo-terminal that a program can open as a serial port, under a chosen name.

    Parameters
    ----------
    name
        Path of a link to make to the port; empty: none.
    baud
        Bits per second of a line whose bytes take time; 0: they arrive at once.

    Raises
    ------
    DeviceError
        If the link cannot be made, or the path is in use.
    """

    def __init__(self, name: str = "", *, baud: float = 0.0) -> None:
        import tty

        self._heard, self._said = _Line(baud), _Line(baud)
        self._claims = WireClaims()
        if name:
            self._claims.stand_in(name)
        self._ours, theirs = os.openpty()
        tty.setraw(self._ours)
        tty.setraw(theirs)
        os.set_blocking(self._ours, False)
        self.path, self._name, self._theirs = os.ttyname(theirs), name, theirs
        if name:
            try:
                self._take_over(name)
                os.symlink(self.path, name)
            except (OSError, WireHeldError) as error:
                self._name = ""
                self.close()
                why = str(error) if isinstance(error, WireHeldError) else error.strerror
                raise DeviceError(f"no virtual port can be made at '{name}': {why}") from error

    def _take_over(self, name: str) -> None:
        """Remove the link of a virtual port that is gone; any other link is left alone, as it may lead to a device.

        Raises
        ------
        WireHeldError
            If a session still has that port open.
        """
        try:
            leads = os.readlink(name)
        except OSError:  # there is none
            return
        if leads.startswith(_TERMINALS):
            before = WireClaims()
            before.take([leads])
            before.release()
            os.unlink(name)

    def fileno(self) -> int:
        """Return the file descriptor on which bytes from the other side arrive."""
        return self._ours

    def set_baud(self, baud: float) -> None:
        """Change the speed of the line."""
        self._heard.set(baud)
        self._said.set(baud)

    def host_baud(self) -> int:
        """Return the speed [baud] that the program at the other end has set; 0 if it is not a standard one."""
        import termios

        usual = {
            getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()
        }
        return usual.get(termios.tcgetattr(self._theirs)[5], 0)

    def receive(self) -> bytes:
        """Return the bytes that have arrived, without waiting; also send those that are due."""
        now = time.monotonic()
        try:
            self._heard.put(os.read(self._ours, 1 << 16), now)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):  # nothing arrived, or no peer
                raise
        self._say(now)
        return self._heard.take(now)

    def send(self, data: bytes) -> None:
        """Send bytes; if nobody reads them, they are lost."""
        now = time.monotonic()
        self._said.put(data, now)
        self._say(now)

    def due(self) -> float:
        """Return in how many seconds there is something to receive or to send; infinite if nothing is on its way."""
        return max(0.0, min(self._heard.due(), self._said.due()) - time.monotonic())

    def _say(self, now: float) -> None:
        data = self._said.take(now)
        if data:
            with contextlib.suppress(BlockingIOError):
                os.write(self._ours, data)

    def close(self) -> None:
        """Close the port and remove its link."""
        os.close(self._ours)
        os.close(self._theirs)
        if self._name:
            with contextlib.suppress(OSError):
                os.unlink(self._name)
        self._claims.release()


class _Line:
    """One direction of a serial line: bytes that are put in come out once the last bit has been transmitted."""

    def __init__(self, baud: float) -> None:
        self._per_byte = _BITS / baud if baud > 0.0 else 0.0
        self._on_its_way: deque[tuple[float, bytes]] = deque()
        self._free = 0.0

    def set(self, baud: float) -> None:
        self._per_byte = _BITS / baud if baud > 0.0 else 0.0

    def put(self, data: bytes, now: float) -> None:
        if data:
            self._free = max(self._free, now) + len(data) * self._per_byte
            self._on_its_way.append((self._free, data))

    def take(self, now: float) -> bytes:
        out = b""
        while self._on_its_way and self._on_its_way[0][0] <= now:
            out += self._on_its_way.popleft()[1]
        return out

    def due(self) -> float:
        return self._on_its_way[0][0] if self._on_its_way else math.inf
