"""The emulator: a serial port behind which the twin answers as the device would."""

from itouch.plugin import Emulator, Terminal


class VoiceCoilEmulator(Emulator):
    """Says how the mass is accelerated, hears what current shall flow."""

    def open(self):
        """Listen at the port that the parameters name."""
        self._terminal, self._rest, self._current = Terminal(self.params.port), b"", 0.0
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
        """Hang up."""
        self._terminal.close()
