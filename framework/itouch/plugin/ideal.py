"""The ideal twin: made from a device's channels if the plugin has no twin of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from itouch.plugin.channel import Channel
from itouch.plugin.device import Device, Twin, TwinInputs
from itouch.plugin.quantity import Role
from itouch.plugin.record import Field, Record

#: Role of a reading -> role of the command that it follows without lag.
MIRRORS = {
    Role.TRACKED_POSE: Role.SURFACE_POSE,
    Role.CONTACT_FORCE: Role.FORCE_ON_OPERATOR,
    Role.SKIN_CONTACT_TEMPERATURE: Role.TEMPERATURE_TARGET,
}
#: Roles of readings that follow whatever command has their name, or their unit, and their size.
_BY_UNIT = (Role.SIGNAL, Role.DELIVERED_DRIVE)
#: Temperature of the room [K] of what is simulated by itself.
ROOM = 296.15


class IdealTwin(Twin):
    """Readings follow the commands that match them by role or unit; a pose without a target is that of the finger."""

    def __init__(self, params: Any, device: type[Device]) -> None:
        super().__init__(params)
        self.reads, self.commands = device.channels(params)
        self._pairs = dict(pairs(self.reads, self.commands))

    def fields(self) -> tuple[Field, ...]:
        """Return one field per reading; they are not plotted, as the readings are."""
        return tuple(Field.of(channel, show="no") for channel in self.reads)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at rest, at the origin, at room temperature."""
        for channel in self.reads:
            state[channel.name] = _rest(channel)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Take over commands without lag, and the finger's pose and twist if the device follows the finger."""
        for channel in self.reads:
            source = self._pairs.get(channel.name)
            if source is not None:
                state[channel.name] = command[source]
            elif channel.role is Role.TRACKED_POSE and touch.finger_attached:
                state[channel.name] = _without_locked(touch.finger_pose, channel.locked)
            elif channel.role is Role.TRACKED_TWIST and touch.finger_attached:
                state[channel.name] = touch.finger_twist

    def read(self, state: Record, reading: Record) -> bool | None:
        """Copy the State to the reading."""
        for channel in self.reads:
            reading[channel.name] = state[channel.name]
        return True


def pairs(reads: Sequence[Channel], commands: Sequence[Channel]) -> Iterator[tuple[str, str]]:
    """Yield the names of each reading that follows a command, and of that command.

    Roles come first; then a reading without a role of its own follows a command with its name, or else the first one
    with its unit, of its size, that no other reading follows.
    """
    left, named = list(commands), {command.name for command in commands}
    for reading in sorted(reads, key=lambda one: (one.role in _BY_UNIT, one.name not in named)):
        found = [command for command in left if _belongs(reading, command)]
        found.sort(key=lambda command: command.name != reading.name)
        if found:
            left.remove(found[0])
            yield reading.name, found[0].name


def _belongs(reading: Channel, command: Channel) -> bool:
    if reading.size != command.size:
        return False
    if reading.role in _BY_UNIT:
        return command.name == reading.name or (reading.unit == command.unit and bool(reading.unit))
    return MIRRORS.get(reading.role) is command.role


def _rest(channel: Channel) -> Any:
    if channel.role is Role.TRACKED_POSE:
        return (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return ROOM if channel.unit == "K" else 0.0


def _without_locked(pose: Any, locked: tuple[int, ...]) -> Any:
    freed = np.array(pose)
    freed[[axis for axis in locked if axis < 3]] = 0.0
    if any(axis >= 3 for axis in locked):
        freed[3:] = (1.0, 0.0, 0.0, 0.0)
    return freed
