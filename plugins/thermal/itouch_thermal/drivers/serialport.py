"""A serial line whose messages end with one byte, through serialx; every wait is bounded."""

from __future__ import annotations

import errno
import os
import time
from typing import Any

from itouch.plugin import DeviceError, Trace
from itouch.plugin.wire_claims import share

#: Longest wait for a byte [s], and so the greatest lateness in noticing that a wait is over.
_POLL = 0.01
#: Advice about a port that cannot be opened, by error number.
_ADVICE = {
    errno.ENOENT: ": check its plug", errno.EBUSY: ": another program has it; end that first",
    errno.ENOTTY: ": it is not a serial port", errno.EISDIR: ": it is not a serial port",
    errno.ECONNREFUSED: ": nothing listens there; start its server first",
    errno.EACCES: ": its group may open it, to which you can be added (see ls -l)",
}  # fmt: skip
#: Most bytes read at once; bytes that are there are returned without waiting for more.
_PIECE = 4096


class SerialLine:
    """An open line.

    Raises
    ------
    DeviceError
        If it cannot be opened; the message names the port.
    """

    def __init__(self, port: str, baud: int, *, end: bytes, trace: Trace | None = None, patience: float = 1.0) -> None:
        try:
            import serialx
        except ImportError as error:
            raise DeviceError("serial ports need a package more: pip install 'itouch-py[thermal-hardware]'") from error
        self.port, self._end, self._trace, self._waiting = port, end, trace, b""
        self._refused = serialx.SerialException  # for settings that the port does not support; not an OSError
        try:
            # Not exclusive: if a process hangs, a second opener must be able to set the current to zero.
            self._serial: Any = serialx.serial_for_url(
                port, baud, read_timeout=_POLL, write_timeout=0.5 * patience, exclusive=False
            )
            self._serial.open()
        except (OSError, ValueError, serialx.SerialException) as error:
            number = getattr(error, "errno", None)  # serialx's own text has number and port as well
            reason = os.strerror(number) if number else str(error)
            advice = _ADVICE.get(number or 0, "")
            raise DeviceError(f"serial port '{port}' cannot be opened: {reason}{advice}") from error
        if "://" not in port:
            try:
                share(self._serial.fileno(), port)
            except DeviceError:
                self._serial.close()
                raise

    def close(self) -> None:
        """Release the port."""
        self._serial.close()

    def set_baud(self, baud: int) -> None:
        """Change the line's speed, after sending what is still in the buffer.

        Raises
        ------
        DeviceError
            If the port is gone, or does not support the speed.
        """
        try:
            self._serial.flush()
            self._serial.reconfigure_port(baudrate=baud)
        except (OSError, ValueError, self._refused) as error:
            raise DeviceError(f"serial port '{self.port}' does not take {baud} baud: {error}") from error

    def send(self, message: bytes) -> None:
        """Send a message, which includes its end.

        Raises
        ------
        DeviceError
            If the port is gone.
        """
        if self._trace:
            self._trace.sent(message)
        try:
            self._serial.write(message)
        except OSError as error:
            raise DeviceError(f"serial port '{self.port}' is gone: {error}") from error

    def clear(self) -> None:
        """Discard received bytes that were not read."""
        self._waiting = b""
        try:
            self._serial.reset_read_buffer()
        except OSError as error:
            raise DeviceError(f"serial port '{self.port}' is gone: {error}") from error

    def receive(self, wait: float) -> bytes | None:
        """Return the next message without its end, or None if none is complete within ``wait`` seconds.

        Raises
        ------
        DeviceError
            If the port is gone.
        """
        limit = time.monotonic() + wait
        while self._end not in self._waiting:
            if time.monotonic() >= limit:
                return None
            try:
                self._waiting += self._serial.read(_PIECE)
            except OSError as error:
                raise DeviceError(f"serial port '{self.port}' is gone: {error}") from error
        message, _, self._waiting = self._waiting.partition(self._end)
        if self._trace:
            self._trace.received(message + self._end)
        return message
