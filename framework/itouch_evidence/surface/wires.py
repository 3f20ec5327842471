"""Wires for random scenes of a carried surface: the table's readings and commands are late, and not in every tick."""

from __future__ import annotations

import random
from typing import NamedTuple

from itouch.plugin import Device
from itouch.plugin.discovery import DEVICES, Catalog, Found, find

#: The plugin that brings the surface.
TABLE = "xyz-table"
#: Range of the period of the table's exchanges [s]: servos on a fast bus exchange in every tick, others less often.
SHORTEST, LONGEST = 1e-3, 10e-3


class Wire(NamedTuple):
    """Period of a device's exchanges, and the time that one takes [s], as in `itouch.plugin.Timing`."""

    period: float
    delay: float

    def __str__(self) -> str:
        return f"an exchange every {1e3 * self.period:.1f} ms that takes {1e3 * self.delay:.1f} ms"

    def catalog(self) -> Catalog:
        """Return the plugins of this environment, with the table behind this wire."""
        found = dict(find(DEVICES))
        own = found[TABLE]
        wired = type("WiredTable", (own.load(),), {"blocking": True, "period": self.period, "delay": self.delay})
        found[TABLE] = Found(own.name, own.distribution, own.version, _Entry(wired))  # type: ignore[arg-type]
        return Catalog(lambda group: found if group == DEVICES else find(group))


class _Entry:
    value = "a table behind a wire"

    def __init__(self, loaded: type[Device]) -> None:
        self._loaded = loaded

    def load(self) -> type[Device]:
        """Return the device's class."""
        return self._loaded


def draw_wire(number: int, seed: int) -> Wire:
    """Return the wire of a scene's number; the scene itself is the same as without one."""
    rng = random.Random(f"surface wire {seed} {number}")
    period = rng.uniform(SHORTEST, LONGEST)
    return Wire(period, rng.uniform(0.0, period))
