"""Where the commands that have left a wire have sent a surface: its newest reading is older than its newest command."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record, Role
from itouch.world import DeviceModel


class Departures:
    """The places a surface was last sent to, each with the tick from which on; none without a wire or a surface."""

    def __init__(self, model: DeviceModel, state: Record, out: Record) -> None:
        self._gone: NDArray[np.float64] | None = state.get(f"{model.name}.gone")
        self._count = state[f"{model.name}.goings"] if self._gone is not None else np.zeros((), np.int64)
        target = model.command(Role.SURFACE_POSE)
        self._target = out[target.name] if self._gone is not None and target is not None else np.zeros(7)

    def note(self, left: int) -> None:
        """Note where the command that left last sends the surface, and from which tick on."""
        if self._gone is not None:
            count = self._count.item()
            self._gone[count % len(self._gone)] = (left, *self._target[:3].tolist())
            self._count[...] = count + 1

    @property
    def newest(self) -> float | None:
        """The height [m] to which the newest command known to have left sends the surface; None: no wire tells that."""
        count = self._count.item()
        if self._gone is None or not count:
            return None
        return float(self._gone[(count - 1) % len(self._gone), 3])

    def acting(self, tick: int) -> list[float] | None:
        """Return where [m] the command that acted in a tick had sent the surface, (3,); None: that is not known."""
        if self._gone is None:
            return None
        known = self._gone[: min(self._count.item(), len(self._gone))]
        acted = known[known[:, 0] <= tick]
        if not len(acted):
            return None
        goal: list[float] = acted[np.argmax(acted[:, 0])][1:].tolist()
        return goal
