"""Exchanges in step with the ticks of a virtual clock, however long they take in real time, or without any wire.

A blocking device exchanges every so many ticks.  A device without its wire gets the readings of a simulated rig's twin,
which obeys its commands: where only some devices of a run use their wires, for the others only the protocols, with what
they cost, are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.exchange.exchanged import Exchanged
from itouch.plugin import Device, Emulator, Field, Record, Timestamps
from itouch.plugin.timestamps import ticks_of

#: Factor on drivers' timeouts in step: the simulated world stands still while they wait.  Other processes, above all
#: some of real-time priority, can keep a simulated device from its answer for seconds: whoever asks again then does
#: something else than on a quiet machine.
PATIENCE = 300.0


class EveryNth(Exchanged):
    """A blocking device that exchanges in the tick itself, in the rhythm of its wire and thread.

    An exchange takes ``every`` ticks.  After it, the device waits up to ``waits`` ticks for a command that differs
    from the last one; ``period`` [s] is that of a tick.  ``cls`` is the class whose channels it has, if not the
    device's own; ``course`` returns after how many ticks the next exchange begins, regardless of commands, or None: as
    above.
    """

    def __init__(
        self, device: Device, every: int, waits: int = 0, period: float = 1e-3, *, cls: type[Device] | None = None,
        course: Callable[[], int | None] = lambda: None,
    ) -> None:  # fmt: skip
        super().__init__(device)
        self._period, self._course = period, course
        #: After how many ticks the next exchange begins, if ``course`` has fixed that.
        self._next: int | None = None
        self._every, self._waits = every, waits
        self._since, self._command, self._sent = every + waits, b"", b""
        reads, self._commands = (cls or type(device)).channels(device.params)
        self._stamps = Timestamps([channel.name for channel in reads])
        self._record = Record.of(Field.of(channel) for channel in self._commands)
        self._told, self._reads = True, 0

    def open(self) -> None:
        """Open the device, which uses the loop's time from then on."""
        self.device.trace, self.device.timeout_factor, self.device.timestamps = self.trace, PATIENCE, self._stamps
        self.device.clock = lambda: self._reads * self._period
        self._since, self._command, self._sent = self._every + self._waits, b"", b""
        self._told = True  # what was sent before it was opened again is not reported
        self.called = "open"
        self.device.open()

    def close(self) -> None:
        """Send the last command, and close the device."""
        try:
            self._send()
        finally:
            self.device.close()

    def read(self, reading: Record) -> bool | None:
        """Exchange if it is due; return False if it is not."""
        self._reads += 1
        since, self._since = self._since, self._since + 1
        due = self._every + (self._waits if self._command == self._sent else 0) if self._next is None else self._next
        if since < due:
            return False
        self._since, self._next = 1, self._course()
        self._stamps.begin()
        self._send()
        self.called = "read"
        return self.device.read(reading)

    def write(self, command: Record) -> None:
        """Keep the command for the next exchange."""
        self._command = command.tobytes()

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in when the reading was measured: in this tick, less the time that it was inside the device.

        ``ticks`` (channels,), written: the number of a tick for each reading.
        """
        for index, inside in enumerate(self._stamps.inside()):
            ticks[index] = tick - ticks_of(inside, self._period)

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Fill in the command that has left in this tick, and return the tick; None: none has left."""
        if self._told:
            return None
        self._told = True
        command.raw.data[:] = self._sent
        return tick

    def _send(self) -> None:
        if self._command:
            self._record.raw.data[:] = self._command
            self.called = "write"
            self.device.write(self._record)
            self._told, self._sent = False, self._command


class DirectHost(Device):
    """The host's end of a device without its wire.

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


class DirectEmulator(Emulator):
    """The rig's end of a device without its wire: there is nothing to answer, since the host's end does everything."""

    def __init__(self, device: DirectHost) -> None:
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
