"""The serial port: whole lines in, whole lines out, nothing waits."""

import serialx

from itouch.plugin import DeviceError


class Line:
    """An open port."""

    def __init__(self, port, baud=115200):
        try:
            # not exclusive: if this process hangs, another one must be able to make the device safe
            self._port = serialx.serial_for_url(port, baud, read_timeout=0, write_timeout=0.05, exclusive=False)
            self._port.open()
        except (OSError, ValueError, serialx.SerialException) as error:
            raise DeviceError(f"no 'voice-coil' at {port}: {error}; is it plugged in, and may you open it?") from error
        self._rest = b""

    def lines(self):
        """Return the whole lines that have come since the last call."""
        try:
            data = self._port.read(4096)
        except (OSError, serialx.SerialException) as error:
            raise DeviceError(f"'voice-coil' is gone: {error}") from error
        *whole, self._rest = (self._rest + data).split(b"\n")
        return [line.decode("ascii", "replace") for line in whole]

    def send(self, text):
        """Send one line."""
        try:
            self._port.write(text.encode() + b"\n")
        except (OSError, serialx.SerialException) as error:
            raise DeviceError(f"'voice-coil' is gone: {error}") from error

    def close(self):
        """Close the port."""
        self._port.close()
