"""Hold-to-run: somebody holds a switch while devices may act; letting go makes everything safe (W3).

The switch is a ``deadman`` reading of any device, or a key in the window, which repeats its signal while the key is
held.  Hardware always needs it; twins only if the scene says ``hold-to-run="yes"``.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

from itouch.monitors import DeviceFaultError, Trip
from itouch.plugin import Record, Role
from itouch.safety.gate import Gate
from itouch.world import limits as default


class HoldToRun:
    """The dead-man's switch of a session; the tick until which the last signal of holding it is good is State."""

    def __init__(self, state: Record, gates: Sequence[Gate], period: float, *, asked: bool) -> None:
        self._until, self._gates = state["hold"], tuple(gates)
        self._ticks = math.ceil(default.HOLD / period)
        self._switches = [
            (g, index, g.device_monitors.seen[channel.name])
            for g in gates
            for index, channel in enumerate(g.model.reads)
            if channel.role is Role.DEADMAN
        ]
        self._said = "nobody holds the switch"
        #: Which of the devices' switches were held in the tick before, by number; ``recall`` finds it from readings.
        self._pressed: frozenset[int] = frozenset()
        #: Whether nothing may act unless the switch is held.
        self.required = asked or any(not g.model.twin for g in gates)

    def press(self, tick: int, held: bool, *, shared: bool = False) -> None:
        """Take a signal that the switch is held, which is good for `HOLD`, or let go; ``shared``: another holds on."""
        self._said = "one of those who held the switch let it go" if shared else "nobody holds the switch"
        self._until[...] = tick + self._ticks if held else tick

    def held(self, tick: int) -> bool:
        """Tell whether the switch is held, by a device or by ``press``; neither is good for longer than `HOLD`.

        So a device that was lost while somebody pressed its switch soon counts no more.
        """
        return self.word(tick) or bool(self._pressed_at(tick))

    def word(self, tick: int) -> bool:
        """Tell whether the last signal by ``press`` still holds the switch, whatever devices read."""
        return 0 < int(self._until.item()) - tick <= self._ticks

    def _pressed_at(self, tick: int) -> frozenset[int]:
        """Return which of the devices' switches are held."""
        oldest = tick - self._ticks
        listed = enumerate(self._switches)
        return frozenset(
            n for n, (one, index, view) in listed if view.item() > 0.5 and one.acquisition.knows(index, oldest)
        )

    def recall(self, tick: int) -> None:
        """Take the devices' switches as they are now for the state before: one that is not held now is not let go."""
        self._pressed = self._pressed_at(tick)

    def ask(self, tick: int) -> None:
        """Read the switches of hardware anew: no tick does while it is stopped, and somebody may have let go since.

        A fault of such a device is not raised here; re-arming tells it.
        """
        for one in {id(one): one for one, _, _ in self._switches if not one.model.twin}.values():
            with contextlib.suppress(DeviceFaultError):
                one.read(tick)
        self.recall(tick)

    def check(self, tick: int) -> None:
        """Stop enabled devices if nobody holds the switch, or one of those who hold it lets go, whoever else holds on.

        Raises
        ------
        DeviceFaultError
            Naming the first enabled device that carries a surface, else the first enabled one.
        """
        if not self.required:
            return
        before, self._pressed = self._pressed, self._pressed_at(tick)
        let_go = before - self._pressed
        if self.held(tick) and not let_go:
            return
        acting = [g for g in self._gates if g.latch.enabled]
        if acting:
            first = next((g for g in acting if any(c.role is Role.SURFACE_POSE for c in g.model.commands)), acting[0])
            shared = "one of those who held the switch let it go"
            said = shared if let_go and self.held(tick) else self._said
            raise DeviceFaultError(first.model.name, tick, Trip.RELEASED, f"was let go: {said}")
