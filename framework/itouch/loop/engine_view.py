"""What the parts of an engine may know of the whole engine, and no more, as a protocol."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.loop.clock import Clock
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.runner import DeviceFaultError, Runner, Status
from itouch.loop.timing import Timing
from itouch.plugin import Record
from itouch.world import Model


class Running(Protocol):
    """A compiled scene that runs."""

    clock: Clock
    scripted: bool
    taps: list[Callable[[int], None]]

    @property
    def model(self) -> Model:
        """The compiled scene."""

    @property
    def state(self) -> Record:
        """Everything that changes."""

    @property
    def times(self) -> Timing:
        """How late ticks began, and how long they took."""

    @property
    def statistics(self) -> RunStatistics:
        """What happened."""

    @property
    def stamps(self) -> NDArray[np.float64]:
        """Host seconds at the start of the last tick, after its steps, and at its end."""

    @property
    def ticks(self) -> int:
        """How many ticks have been run."""

    @property
    def seconds(self) -> float:
        """Simulated time [s]."""

    @property
    def since(self) -> float:
        """Host seconds since the last tick ended."""

    @property
    def done(self) -> bool:
        """Whether every scripted motion has ended."""

    @property
    def runners(self) -> tuple[Runner, ...]:
        """The devices."""

    @property
    def injected(self) -> list[dict[str, Any]]:
        """The injected faults that have begun."""

    def status(self, device: str) -> Status:
        """Return what a device may do now."""

    def tick(self) -> None:
        """Advance by one servo period."""

    def leave_out(self, seconds: float, *, running: bool = False) -> int:
        """Account for time that no tick stands for; return how many periods it is."""

    def make_safe(self, fault: DeviceFaultError) -> None:
        """Make every device safe because of a fault."""
