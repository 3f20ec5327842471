"""The emulator: a serial port behind which the twin answers as the device would."""

from itouch.plugin import Emulator, Terminal


class VoiceCoilEmulator(Emulator):
    """Says how the mass is accelerated, hears what current shall flow."""

    def __init__(self, params):
        super().__init__(params)
        self._terminal, self._rest, self._current = None, b"", 0.0

    def open(self):
        """Listen at the port that the parameters name."""
        self._terminal = Terminal(self.params.port)
        return self.params.port

    def serve(self, now, reading, command):
        """Answer what came, and say the acceleration."""
        *lines, self._rest = (self._rest + self._terminal.receive()).split(b"\n")
        for line in lines:
            self._current = float(line[2:])
        command["current"] = self._current
        self._terminal.send(f"A {float(reading['acceleration'][0]):.6f}\n".encode())
        return True

    def close(self):
        """Hang up; nothing is open if `open` has failed."""
        if self._terminal is not None:
            self._terminal.close()
        self._terminal = None
