"""The true state of the devices in a cell, whatever sensors read: the greatest temperature, force and speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from itouch.plugin import Role
from itouch.session import Session
from itouch.world import limits, truth


@dataclass(slots=True)
class Truth:
    """Notes the extremes of the true state tick by tick, also in the safe sequence after a trip."""

    session: Session
    plate: tuple[float, float] = (math.inf, -math.inf)
    sink: float = -math.inf
    force: float = 0.0
    plate_force: float = 0.0
    finger_speed: float = 0.0
    surface_speed: float = 0.0
    _views: dict[str, np.ndarray] = field(default_factory=dict)
    _surfaces: list[np.ndarray] = field(default_factory=list)
    _before: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        state = self.session.state
        for name, device in self.session.model.devices.items():
            push = device.command(Role.FORCE_ON_OPERATOR)
            if push is not None:
                before = sum(channel.size for channel in device.commands[: device.commands.index(push)])
                self._views["arm"] = state[f"{name}.twin.fault.received"][before : before + 3]
            if device.reading(Role.SKIN_CONTACT_TEMPERATURE) is not None:
                self._views["plate"] = state[truth(self.session.model, name, Role.SKIN_CONTACT_TEMPERATURE)]
                if sink := truth(self.session.model, name, Role.HEAT_SINK_TEMPERATURE):
                    self._views["sink"] = state[sink]
        surfaces = [one for one in self.session.runners if one.model.command(Role.SURFACE_POSE) is not None]
        self._surfaces = [place for one in surfaces if (place := one.true_position()) is not None]
        probe = self.session.model.probes[0].name
        self._views["press"], self._views["finger"] = state[f"{probe}.plate_force"], state[f"{probe}.hand.velocity"]
        self.clear()

    def clear(self) -> None:
        """Forget what was noted: a new cell begins."""
        self.plate, self.sink = (math.inf, -math.inf), -math.inf
        self.force = self.plate_force = self.finger_speed = self.surface_speed = 0.0
        self._before = [place.copy() for place in self._surfaces]

    def note(self, tick: int) -> None:
        """Note the true state after a tick."""
        views = self._views
        if "plate" in views:
            plate = views["plate"].item()
            self.plate = (min(self.plate[0], plate), max(self.plate[1], plate))
        if "sink" in views:
            self.sink = max(self.sink, views["sink"].item())
        if "arm" in views:
            self.force = max(self.force, math.hypot(*views["arm"].tolist()))
        for before, place in zip(self._before, self._surfaces, strict=True):
            moved = float(np.abs(place - before).max())
            self.surface_speed = max(self.surface_speed, moved / self.session.model.period)
            before[:] = place
        self.plate_force = max(self.plate_force, views["press"].item())
        self.finger_speed = max(self.finger_speed, math.hypot(*views["finger"].tolist()))

    def broken(self) -> list[str]:
        """Return which absolute limits were passed, in words."""
        found = []
        low, high = limits.PLATE_ABSOLUTE
        if "plate" in self._views and not (low <= self.plate[0] and self.plate[1] <= high):
            found.append(f"plate {self.plate[0] - 273.15:.1f} to {self.plate[1] - 273.15:.1f} degC")
        if self.sink > limits.SINK_ABSOLUTE:
            found.append(f"heat sink {self.sink - 273.15:.1f} degC")
        if not self.plate_force <= limits.PLATE_FORCE_ABSOLUTE:
            found.append(f"plate force {self.plate_force:.1f} N")
        ceiling = self._ceiling(Role.FORCE_ON_OPERATOR)
        if not self.force <= ceiling * (1.0 + 1e-9):
            found.append(f"arm force {self.force:.1f} N")
        if not self.finger_speed <= limits.ARM_SPEED_TRIP:
            found.append(f"finger at {self.finger_speed:.2f} m/s")
        if not self.surface_speed <= limits.SPEED_TRIP * (1.0 + 1e-9):
            found.append(f"surface at {self.surface_speed:.2f} m/s on an axis")
        return found

    def _ceiling(self, command: Role) -> float:
        """Return the greatest force [N] that any device can apply by this command."""
        channels = [device.command(command) for device in self.session.model.devices.values()]
        return max((channel.magnitude or math.inf for channel in channels if channel is not None), default=math.inf)
