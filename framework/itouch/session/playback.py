"""Recorded readings in place of devices, for a replay."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Device, DeviceError, Record, Twin, TwinInputs
from itouch.plugin.bound_twin import BoundTwin
from itouch.plugin.device import is_new
from itouch.plugin.timestamps import Timestamped
from itouch.recording import Recording
from itouch.safety import Trip
from itouch.session.row_layout import in_track

if TYPE_CHECKING:
    from itouch.session.session import Session


class PlaybackTwin(Twin, Timestamped):
    """Gives recorded readings in place of a twin's, which goes on stepping underneath."""

    def __init__(self, name: str, inner: Twin, feed: Feed) -> None:
        super().__init__(None)
        self._name, self._inner, self._feed = name, inner, feed
        self._bound = BoundTwin(inner)
        #: What the twin underneath reads: one record, to which its compiled call stays bound.
        self._underneath: Record | None = None

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the true position of the twin underneath."""
        return self._inner.position(state)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Step the twin underneath."""
        self._bound.step(state, command, touch, period)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the reading of this tick; False if there was nothing new.

        Raises
        ------
        DeviceError
            If the device failed in this tick.
        """
        if self._underneath is None:
            self._underneath = reading.copy()
        self._underneath.raw[:] = reading.raw
        answered = is_new(self._bound.read(state, self._underneath))
        uncounted = self._feed.uncounted(self._name)
        return self._feed.give(self._name, reading) or (answered and uncounted)

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Give the ticks that were recorded.

        ``ticks`` (channels,): the number of a tick for each reading, written.
        """
        self._feed.measured(self._name, tick, ticks)

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Give the command that had left."""
        return self._feed.departed(self._name, command)


class PlaybackDevice(Device, Timestamped):
    """Gives recorded readings in place of hardware's, and drops commands."""

    def __init__(self, name: str, feed: Feed) -> None:
        super().__init__(None)
        self._name, self._feed = name, feed

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def read(self, reading: Record) -> bool | None:
        """Give the reading of this tick; False if there was nothing new.

        Raises
        ------
        DeviceError
            If the device failed in this tick.
        """
        return self._feed.give(self._name, reading)

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Give the ticks that were recorded.

        ``ticks`` (channels,): the number of a tick for each reading, written.
        """
        self._feed.measured(self._name, tick, ticks)

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Give the command that had left."""
        return self._feed.departed(self._name, command)


class Feed:
    """The recorded rows, and which of them is the current one."""

    def __init__(self, recording: Recording, session: Session) -> None:
        self._tables = {name: recording[name] for name, t in recording.tracks.items() if t.replay}
        #: What is looked at in every tick, one view a column: the readings of a device, and where it failed.
        self._readings = {
            name: [
                (c.name, self._tables[name][in_track(c.name)])
                for c in device.reads
                if in_track(c.name) in (self._tables[name].dtype.names or ())
            ]
            for name, device in session.model.devices.items()
            if name in self._tables
        }
        self._fails = {
            name: self._tables[name]["trip"] == Trip.DEVICE_ERROR
            for name in self._readings
            if "trip" in (self._tables[name].dtype.names or ())
        }
        self._sequences = {name: session.state[f"{name}.sequence"] for name in self._readings}
        self._ages = {name: session.state[f"{name}.age"] for name in self._readings}
        self._trips = {name: session.state[f"{name}.trip"] for name in self._readings}
        self.ticks = recording.ticks
        self.at = 0
        self._errors = {
            (int(f["tick"]), str(f.get("device"))): str(f.get("cause", "")).removeprefix("failed: ")
            for f in recording.faults
            if f.get("trip") == "device-error" and f.get("optional")
        }
        inputs = self._tables.get("session")
        self._hold = inputs["hold"] if inputs is not None and "hold" in (inputs.dtype.names or ()) else None

    def error_of(self, device: str) -> str:
        """Return the error of a device that failed in this tick, or an empty string."""
        if self.at >= len(self.ticks):
            return ""
        return self._errors.get((int(self.ticks[self.at]), device), "") or self._failed_too(device)

    def _failed_too(self, device: str) -> str:
        """Return an error for a device that failed after another one, while all was made safe.

        No fault tells of it, as that of the first device does, but its recorded trip.
        """
        fails = self._fails.get(device)
        if fails is None or not fails[self.at] or self._trips[device].item() == Trip.DEVICE_ERROR:
            return ""
        return "it failed after another device"

    def give(self, device: str, reading: Record) -> bool:
        """Fill a reading from the current row; tell whether it was new.

        A new one has another sequence number than State's; in the safe sequence, which does not count, other values.

        Raises
        ------
        DeviceError
            If the device failed in this tick, and the session went on without it.
        """
        if cause := self.error_of(device):
            raise DeviceError(cause)
        table, at = self._tables.get(device), self.at
        if table is None or at >= len(table):
            return False
        changed = bool(table["sequence"][at] != self._sequences[device])
        for name, column in self._readings[device]:
            found = column[at]
            changed = changed or not np.array_equal(reading[name], found, equal_nan=True)
            reading[name][...] = found
        return changed

    def uncounted(self, device: str) -> bool:
        """Tell whether the current row is of the safe sequence, in which readings are neither counted nor age.

        A reading that came there and equalled the one before left no trace: only the twin can tell that it came.
        """
        table, at = self._tables.get(device), self.at
        if table is None or at >= len(table) or device not in self._ages:
            return False
        same = table["sequence"][at] == self._sequences[device] and table["age"][at] == self._ages[device]
        return bool(same)

    def measured(self, device: str, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in when the current reading was measured; in this tick, if the recording does not say.

        ``ticks`` (channels,): the number of a tick for each reading, written.
        """
        table, at = self._tables.get(device), self.at
        known = table is not None and at < len(table) and "measured" in (table.dtype.names or ())
        ticks[...] = table["measured"][at] if table is not None and known else tick

    def departed(self, device: str, command: Record) -> int | None:
        """Fill in the command that had left by now, and return the tick in which it did; None: it is not recorded."""
        table, at = self._tables.get(device), self.at
        if table is None or at >= len(table) or "left" not in (table.dtype.names or ()):
            return None
        for name in command:
            command[name][...] = table[f"out.{name}"][at]
        return int(table["left"][at])

    def inputs(self, state: Record) -> None:
        """Write to State what else came from outside in this tick."""
        if self._hold is not None and "hold" in state and self.at < len(self._hold):
            state["hold"][...] = self._hold[self.at]
