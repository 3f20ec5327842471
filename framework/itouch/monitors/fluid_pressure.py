"""A device that presses by a fluid and measures its force: it may press as hard as a plate (K4)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import ClassVar

from itouch.monitors import default_limits as default
from itouch.monitors.trips import Trip
from itouch.plugin import Field, Moment, Monitor, Record, Role, Rule, Watched


class Push(Monitor):
    """Watches the contact force of a device that presses by a fluid."""

    name = "push"
    trips: ClassVar[Mapping[int, str]] = {int(Trip.PLATE_FORCE): Trip.PLATE_FORCE.label}

    def __init__(self, device: Watched) -> None:
        super().__init__(device)
        self._loads = [channel.name for channel in device.readings(Role.CONTACT_FORCE)]
        self._limit = device.limits.get("plate_force") or default.PLATE_FORCE
        self._trip = device.limits.get("plate_force_trip") or default.PLATE_FORCE_TRIP

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        """Every device that presses by a fluid and reads the contact force."""
        wanted = device.commands_with(Role.PRESSURE) and device.readings(Role.CONTACT_FORCE)
        return (cls(device),) if wanted else ()

    @property
    def watches(self) -> tuple[str, ...]:
        """The pressure commands whose force it watches."""
        return tuple(channel.name for channel in self.device.commands_with(Role.PRESSURE))

    def fields(self) -> tuple[Field, ...]:
        """Return the State that it needs."""
        return (Field("figure", unit="N", doc="the force that tripped"),)

    def felt(self, reading: Record) -> float:
        """Return the force [N] with which the device presses, by its own sensor that reads most."""
        return max(math.hypot(*reading[name].ravel()[:3].tolist()) for name in self._loads)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        """Return the share of the pressure, which falls from 1 at the limit of force to 0 at the trip."""
        force = self.felt(reading)
        if force > self._trip:
            state["figure"][...] = force
            return -float(Trip.PLATE_FORCE)
        return 1.0 if force <= self._limit else 1.0 - (force - self._limit) / (self._trip - self._limit)

    def sentence(self, code: int, state: Record, reading: Record, moment: Moment) -> str:
        """Return how hard the device presses."""
        return f"presses with {state['figure'].item():.1f} N"

    def rule(self, code: int, reading: Record) -> str:
        """Return K4."""
        return "K4"

    def rules(self) -> tuple[Rule, ...]:
        """Return K4."""
        return (Rule("K4", "force on the finger", f"{self._limit:g} N", f"{self._trip:g} N",
                     f"{default.PLATE_FORCE_ABSOLUTE:g} N", self.device.source("plate_force")),)  # fmt: skip
