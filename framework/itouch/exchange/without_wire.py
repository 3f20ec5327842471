"""A device without its wire: a host's session reads what a simulated rig's twin reads, and the twin obeys its commands.

For runs in step in which only some devices are on their wires: what the others' protocols cost, and nothing else, is
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
        The device's.
    reading, sent
        What the twin reads now, and what it obeys: of the same channels as the host's.
    """

    def __init__(self, params: Any, reading: Record, sent: Record) -> None:
        super().__init__(params)
        self._reading, self._sent = reading, sent
        #: Whether a host commands it.
        self.driven = False

    @classmethod
    def wires(cls, params: Any) -> tuple[str, ...]:
        """Return nothing: whatever the parameters name."""
        return ()

    def open(self) -> None:
        """Begin to read."""

    def close(self) -> None:
        """Let go: the twin keeps its last command."""
        self.driven = False

    def read(self, reading: Record) -> bool:
        """Copy what the twin reads."""
        reading.raw.data[:] = self._reading.tobytes()
        return True

    def write(self, command: Record) -> None:
        """Let the twin obey."""
        self._sent.raw.data[:] = command.tobytes()
        self.driven = True


class StraightEmulator(Emulator):
    """The rig's end: there is nothing to answer, since the host's end has done it."""

    def __init__(self, device: Straight) -> None:
        super().__init__(device.params)
        self._device = device

    def open(self) -> str:
        """Say that there is no wire."""
        return "without a wire"

    def close(self) -> None:
        """Do nothing."""

    def serve(self, now: float, reading: Record, command: Record) -> bool:
        """Tell whether the host commands the device."""
        return self._device.driven
