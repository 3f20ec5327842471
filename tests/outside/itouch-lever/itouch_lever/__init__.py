"""A one-axis force lever on a line of bytes: a small complete device plugin."""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass

from itouch.plugin import Device, DeviceError, Record, Timing, pose, schema, wrench


@dataclass(frozen=True)
class LeverParams:
    """What <lever:hardware .../> may hold."""

    path: str = schema.text(default="loop://", doc="serial port, or loop:// for none")
    travel: float = schema.quantity("m", low=1e-3, high=0.2, default=0.05, doc="stroke of the lever")
    force_per_amp: float = schema.quantity("N/A", low=0.1, default=4.0, doc="motor constant times lever arm")


class Lever(Device):
    """Moves and pushes along z only; the framework sees six degrees of freedom, five of them locked."""

    Params = LeverParams
    reads = (pose(locked=(0, 1, 3, 4, 5)),)
    commands = (wrench(force=8.0, locked=(0, 1, 3, 4, 5)),)
    timing = Timing(watchdog=0.1)  # the lever's controller lets go of the motor by itself

    def open(self) -> None:
        """Open the line."""
        if self.params.path != "loop://":
            raise DeviceError(f"no lever on {self.params.path}: only loop:// is built in")
        self._line: deque[bytes] = deque([struct.pack("<h", 32767)])
        self._counts = 0
        self.sent: list[int] = []

    def close(self) -> None:
        """Close the line."""
        self._line.clear()

    def read(self, reading: Record) -> bool:
        """Take the newest encoder count."""
        while self._line:
            (self._counts,) = struct.unpack("<h", self._line.popleft())
        reading["pose"][:] = 0.0, 0.0, self._counts / 32767 * self.params.travel, 1.0, 0.0, 0.0, 0.0
        return True

    def write(self, command: Record) -> None:
        """Send the current of the motor; the loop-back answers with a count that sinks by one."""
        milliamps = round(float(command["wrench"][2]) / self.params.force_per_amp * 1000)
        self.sent = [*self.sent[-9:], milliamps]
        self._line.append(struct.pack("<h", max(0, self._counts - 1)))
