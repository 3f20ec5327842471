"""Hold-to-run: somebody holds a switch while devices may act; letting go makes everything safe (W3).

The switch is a ``deadman`` reading of any device, or a word that the window repeats while its key is held.
Hardware always needs it; twins only if the scene says ``hold-to-run="yes"``.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

from itouch.monitors import DeviceFaultError, Trip
from itouch.plugin import Record, Role
from itouch.safety.supervisor import Supervisor
from itouch.world import limits as default


class HoldToRun:
    """The dead-man's switch of a session; until which tick it holds is State."""

    def __init__(self, state: Record, supervisors: Sequence[Supervisor], period: float, *, asked: bool) -> None:
        self._until, self._supervisors = state["hold"], tuple(supervisors)
        self._ticks = math.ceil(default.HOLD / period)
        self._switches = [
            (s, index, s.device_monitors.seen[channel.name])
            for s in supervisors
            for index, channel in enumerate(s.model.reads)
            if channel.role is Role.DEADMAN
        ]
        self._said = "nobody holds the switch"
        #: Whether nothing may act unless the switch is held.
        self.required = asked or any(not s.model.twin for s in supervisors)

    def press(self, tick: int, held: bool, *, shared: bool = False) -> None:
        """Take a word of the switch: held now, which is good for 80 ms, or let go; ``shared``: another holds on."""
        self._said = "one of those who held the switch let it go" if shared else "nobody holds the switch"
        self._until[...] = tick + self._ticks if held else tick

    def held(self, tick: int) -> bool:
        """Tell whether the switch is held, by a device or by word; no sign of it is good for longer than 80 ms.

        A device that was lost while somebody pressed its switch says nothing any more.
        """
        if 0 < self._until.item() - tick <= self._ticks:
            return True
        oldest = tick - self._ticks
        return any(view.item() > 0.5 and one.knows(index, oldest) for one, index, view in self._switches)

    def ask(self, tick: int) -> None:
        """Read the switches of hardware anew: no tick does while it is stopped, and somebody may have let go meanwhile.

        What a device says of its own trouble is told when it is re-armed.
        """
        for one in {id(one): one for one, _, _ in self._switches if not one.model.twin}.values():
            with contextlib.suppress(DeviceFaultError):
                one.read(tick)

    def check(self, tick: int) -> None:
        """Stop what acts if nobody holds the switch.

        Raises
        ------
        DeviceFaultError
            Naming the device that has most to fear: the one that is to retract, else the first.
        """
        if not self.required or self.held(tick):
            return
        acting = [s for s in self._supervisors if s.enabled]
        if acting:
            first = next((s for s in acting if any(c.role is Role.SURFACE_POSE for c in s.model.commands)), acting[0])
            raise DeviceFaultError(first.model.name, tick, Trip.RELEASED, f"was let go: {self._said}")
