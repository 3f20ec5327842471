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
        #: Which of the devices' switches were held in the tick before, by number; found again from State.
        self._pressed: frozenset[int] = frozenset()
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
        return self.word(tick) or bool(self._pressed_at(tick))

    def word(self, tick: int) -> bool:
        """Tell whether somebody's word holds the switch, whatever devices say."""
        return 0 < int(self._until.item()) - tick <= self._ticks

    def _pressed_at(self, tick: int) -> frozenset[int]:
        """Return which of the devices' switches are held."""
        oldest = tick - self._ticks
        listed = enumerate(self._switches)
        return frozenset(n for n, (one, index, view) in listed if view.item() > 0.5 and one.knows(index, oldest))

    def recall(self, tick: int) -> None:
        """Begin with those switches of devices that are held now: who let go before has let nothing go."""
        self._pressed = self._pressed_at(tick)

    def ask(self, tick: int) -> None:
        """Read the switches of hardware anew: no tick does while it is stopped, and somebody may have let go meanwhile.

        What a device says of its own trouble is told when it is re-armed.
        """
        for one in {id(one): one for one, _, _ in self._switches if not one.model.twin}.values():
            with contextlib.suppress(DeviceFaultError):
                one.read(tick)
        self.recall(tick)

    def check(self, tick: int) -> None:
        """Stop what acts if nobody holds the switch, or if one who held it lets go, whoever else holds on.

        Raises
        ------
        DeviceFaultError
            Naming the device that has most to fear: the one that is to retract, else the first.
        """
        if not self.required:
            return
        before, self._pressed = self._pressed, self._pressed_at(tick)
        let_go = before - self._pressed
        if self.held(tick) and not let_go:
            return
        acting = [s for s in self._supervisors if s.enabled]
        if acting:
            first = next((s for s in acting if any(c.role is Role.SURFACE_POSE for c in s.model.commands)), acting[0])
            shared = "one of those who held the switch let it go"
            said = shared if let_go and self.held(tick) else self._said
            raise DeviceFaultError(first.model.name, tick, Trip.RELEASED, f"was let go: {said}")
