"""The ideal twin: made from a device's channels when the plugin brings no twin of its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from itouch.plugin.channel import Channel
from itouch.plugin.device import Device, Touch, Twin
from itouch.plugin.record import Field, Record

#: Reading -> the command that it mirrors without lag.
MIRRORS = {"pose": "pose_target", "temperature": "temperature_target"}
_ROOM = 296.15


class IdealTwin(Twin):
    """Readings mirror the commands of the same name or meaning; a pose without a target is the finger's."""

    def __init__(self, params: Any, device: type[Device]) -> None:
        super().__init__(params)
        self.reads, self.commands = device.channels(params)

    def fields(self) -> tuple[Field, ...]:
        """Return one field a reading."""
        return tuple(Field.of(channel) for channel in self.reads)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at rest, at the origin, at room temperature."""
        for channel in self.reads:
            state[channel.name] = _rest(channel)

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Take over commands without lag, and the finger's pose where the device follows the finger."""
        names = {channel.name for channel in self.commands}
        for channel in self.reads:
            source = channel.name if channel.name in names else MIRRORS.get(channel.name, "")
            if source in names and command[source].shape == state[channel.name].shape:
                state[channel.name] = command[source]
            elif channel.name == "pose" and touch.finger_attached:
                state["pose"] = _without_locked(touch.finger_pose, channel.locked)
            elif channel.name == "twist" and touch.finger_attached:
                state["twist"] = touch.finger_twist

    def read(self, state: Record, reading: Record) -> bool | None:
        """Copy the State to the reading."""
        for channel in self.reads:
            reading[channel.name] = state[channel.name]
        return True


def _rest(channel: Channel) -> Any:
    if channel.name == "pose":
        return (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return _ROOM if channel.unit == "K" else 0.0


def _without_locked(pose: Any, locked: tuple[int, ...]) -> Any:
    freed = np.array(pose)
    freed[[axis for axis in locked if axis < 3]] = 0.0
    if any(axis >= 3 for axis in locked):
        freed[3:] = (1.0, 0.0, 0.0, 0.0)
    return freed
