"""What an engine tells whoever listens: lists of functions, each called in the order in which they were added."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from itouch.loop.runner import DeviceFaultError

Listeners = list[Callable[[], object]]


@dataclass(frozen=True, slots=True)
class Notifications:
    """The moments at which an engine calls its listeners.

    Attributes
    ----------
    tick
        A tick is over, also one of the safe sequence; with its number.  Listeners must not change the State.
    begin
        A run is about to begin.
    act
        Devices are about to be enabled or armed anew: what must be there before anything acts is there after this.
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
