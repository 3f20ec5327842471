"""The monitors that ship with the framework: readings, watchdog, force, carried surface, pressure, heat."""

from __future__ import annotations

from collections.abc import Iterator

from itouch.monitors.arm import Arm
from itouch.monitors.carried_surface import Surface
from itouch.monitors.every_device import Ordinary
from itouch.monitors.fluid_pressure import Push
from itouch.monitors.heat import Heat
from itouch.monitors.readings import Readings
from itouch.monitors.trips import DOUBTS, LOSSES, DeviceFaultError, Trip, TripError
from itouch.plugin import Monitor, Watched

__all__ = [
    "DOUBTS", "LOSSES", "OWN", "Arm", "DeviceFaultError", "Heat", "Ordinary", "Push", "Readings", "Surface", "Trip",
    "TripError", "own_monitors",
]  # fmt: skip

#: In the order in which they are asked, and in which their rules are printed.
OWN: tuple[type[Monitor], ...] = (Readings, Heat, Surface, Arm, Push, Ordinary)


def own_monitors(device: Watched) -> Iterator[Monitor]:
    """Yield the framework's monitors that a device needs, by the roles of its channels."""
    for kind in OWN:
        yield from kind.of(device)
