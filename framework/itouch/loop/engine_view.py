"""What others learn of an engine: what its parts may know of the whole, and what it tells whoever listens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.loop.clock import Clock
from itouch.loop.device_runner import DeviceFaultError, Runner, Status
from itouch.loop.run_statistics import RunStatistics
from itouch.loop.timing import Timing
from itouch.plugin import Record
from itouch.world import Model

Listeners = list[Callable[[], object]]


class Running(Protocol):
    """A compiled scene that runs: what the parts of an engine may know of the whole engine, and no more."""

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

    @property
    def left(self) -> int:
        """In how many ticks, at the earliest, every scripted motion has ended; at least 1."""

    def tick(self) -> None:
        """Advance by one servo period."""

    def advance(self, most: int) -> None:
        """Advance by at least one servo period, and by up to ``most`` where nobody is told of each tick."""

    @property
    def stopping(self) -> bool:
        """Whether the run that is under way has been asked to end."""

    def leave_out(self, seconds: float, *, running: bool = False) -> int:
        """Account for time that no tick stands for; return how many periods it is."""

    def make_safe(self, fault: DeviceFaultError) -> None:
        """Make every device safe because of a fault."""


@dataclass(frozen=True, slots=True)
class Notifications:
    """The moments at which an engine calls its listeners: lists of functions, called in the order of their adding.

    Attributes
    ----------
    tick
        A tick is over, also one of the safe sequence; with its number.  Listeners must not change the State.
    begin
        A run is about to begin.
    act
        Devices are about to be enabled or armed anew: what must be there before anything acts is there after this.
    waiting
        Nothing is enabled, and the caller of ``enable`` or ``rearm`` waits for devices to be opened: called again and
        again.  What a listener raises ends the waiting.
    outside
        The State was changed from outside the loop, or is about to be by a sequence that is no tick; with the reason.
    left_out
        Time was left out that no tick stands for; with the seconds, and whether a loop that was late left it out.
    fault
        A tick has failed, and nothing has been made safe yet; with the fault.  Listeners must not change the State.
    safe
        All devices have been made safe, because of a fault or by `Engine.park`.
    closed
        All devices have been released.
    """

    tick: list[Callable[[int], None]] = field(default_factory=list)
    begin: Listeners = field(default_factory=list)
    act: Listeners = field(default_factory=list)
    waiting: Listeners = field(default_factory=list)
    outside: list[Callable[[str], object]] = field(default_factory=list)
    left_out: list[Callable[[float, bool], object]] = field(default_factory=list)
    fault: list[Callable[[DeviceFaultError], object]] = field(default_factory=list)
    safe: Listeners = field(default_factory=list)
    closed: Listeners = field(default_factory=list)

    def tell_fault(self, fault: DeviceFaultError) -> BaseException | None:
        """Call the listeners of a fault, each whatever the others raise; return what was raised, or None.

        What is no ``Exception``, as Ctrl-C, counts before one that is, and else the later before the earlier.
        """
        failed: BaseException | None = None
        for listener in tuple(self.fault):  # a copy, because a recorder that fails removes itself
            try:
                listener(fault)
            except BaseException as error:
                failed = error if failed is None or isinstance(failed, Exception) else failed
        return failed


def tell(listeners: Listeners) -> None:
    """Call listeners that are told nothing but that it is time."""
    for listener in tuple(listeners):
        listener()
