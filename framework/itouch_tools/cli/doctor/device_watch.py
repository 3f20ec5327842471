"""One device that the doctor watches: it is read and written at its rate, and statistics of its readings are kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import DeviceFaultError
from itouch.plugin import Record, Role
from itouch.safety import Status

if TYPE_CHECKING:
    from itouch.loop.runner import Runner


class Watched:
    """One device of the rig, with statistics of its readings."""

    def __init__(self, runner: Runner, state: Record) -> None:
        self.runner, self.model = runner, runner.model
        self._sequence = state[f"{runner.model.name}.sequence"]
        #: How many readings came, the longest time [s] between two, and the tick of the newest.
        self.count, self.gap, self.since = 0, 0.0, 0
        self.fault: DeviceFaultError | None = None
        self._rows: set[bytes] = set()
        #: Mean, newest and greatest absolute value of each number that was read; meaningless until ``count`` > 0.
        self.mean, self.newest, self.most = (np.zeros(runner.reading.numbers.shape) for _ in range(3))

    def look(self, tick: int, period: float) -> None:
        """Read what has come, and write safe commands; the loss of an optional device counts as a fault, too."""
        if self.fault is not None or self.runner.latch.status is Status.CLOSED:
            return
        before = int(self._sequence)
        on_loss, self.runner.gate.on_loss = self.runner.gate.on_loss, None
        try:
            self.runner.gate.read(tick)
            self.runner.gate.write(tick)
        except DeviceFaultError as fault:
            self.fault = fault
            return
        finally:
            self.runner.gate.on_loss = on_loss
        if self.runner.latch.status is Status.FAULT:  # its readings are no longer checked then
            trip = self.runner.latch.trip
            self.fault = DeviceFaultError(self.model.name, tick, trip, f"was stopped before by {trip.label}")
            return
        if int(self._sequence) != before:
            self._keep(tick)
        self.gap = max(self.gap, (tick - self.since) * period)

    def _keep(self, tick: int) -> None:
        numbers = self.runner.reading.numbers
        self.count, self.since = self.count + 1, tick
        self.mean += (numbers - self.mean) / self.count
        self.newest[:] = numbers
        np.maximum(self.most, np.abs(numbers), out=self.most)
        if len(self._rows) < 2:
            self._rows.add(numbers.tobytes())

    def at(self, role: Role, numbers: NDArray[Any]) -> tuple[str, list[float]] | None:
        """Return the name of the reading with a role, and its part of ``mean``, ``newest`` or ``most``; None: none.

        ``numbers`` (n,) are those of all readings, one after the other, in their channels' units.
        """
        begin = 0
        for channel in self.model.reads:
            if channel.role is role:
                return channel.name, numbers[begin : begin + channel.size].tolist()
            begin += channel.size
        return None

    @property
    def still(self) -> bool:
        """Whether no number that was read has ever changed."""
        return len(self._rows) < 2
