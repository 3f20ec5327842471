"""A device without its wire: the host's session gets the readings of a simulated rig's twin, which obeys its commands.

For runs in step in which only some devices use their wires: for the others only the protocols, with what they cost, are
left out.
"""

from __future__ import annotations

from typing import Any

from itouch.plugin import Device, Emulator, Record


class Straight(Device):
    """The host's end.

    Parameters
    ----------
    params
        The device's parameters.
    reading, sent
        The twin's present reading, and the command that it obeys, with the same channels as the host's.
    """

    def __init__(self, params: Any, reading: Record, sent: Record) -> None:
        super().__init__(params)
        self._reading, self._sent = reading, sent
        #: Whether a host commands it.
        self.driven = False

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Return no wires, whatever the parameters name."""
        return ()

    def open(self) -> None:
        """Begin to read."""

    def close(self) -> None:
        """Stop commanding; the twin keeps its last command."""
        self.driven = False

    def read(self, reading: Record) -> bool:
        """Copy the twin's reading."""
        reading.raw.data[:] = self._reading.tobytes()
        return True

    def write(self, command: Record) -> None:
        """Pass the command to the twin."""
        self._sent.raw.data[:] = command.tobytes()
        self.driven = True


class StraightEmulator(Emulator):
    """The rig's end: there is nothing to answer, since the host's end does everything."""

    def __init__(self, device: Straight) -> None:
        super().__init__(device.params)
        self._device = device

    def open(self) -> str:
        """Return words for the place of listening: there is no wire."""
        return "without a wire"

    def close(self) -> None:
        """Do nothing."""

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Tell whether the host commands the device."""
        return self._device.driven
