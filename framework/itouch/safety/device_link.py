"""What the two ways through a gate share: the device or its twin, and whether it may act."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from itouch.plugin import Channel, Device, Record, Twin
from itouch.plugin.bound_twin import BoundTwin
from itouch.safety.latch import Latch
from itouch.world import DeviceModel


class DeviceLink:
    """One device, or the twin that stands in for it, with its latch."""

    def __init__(self, model: DeviceModel, state: Record, device: Device | None, twin: Twin | None) -> None:
        self.model, self.device, self._twin = model, device, twin
        #: The twin as Python steps and reads it, in ticks that are not compiled: each tick of a stop.
        self.bound = None if twin is None else BoundTwin(twin)
        #: 1 once the twin was replaced by another one, so that what was compiled for the first is not used, shape (1,).
        self.replaced = np.zeros(1, np.int64)
        #: What the device may do now: unless it is enabled, only safe commands pass.
        self.latch = Latch(state, model.name)
        prefix = f"{model.name}.twin."
        has_twin_state = twin is not None and any(name.startswith(prefix) for name in state)
        self.twin_state = state.part(prefix) if has_twin_state else Record(np.dtype([]))

    @property
    def twin(self) -> Twin | None:
        """The twin that stands in for the device, if one does."""
        return self._twin

    @twin.setter
    def twin(self, other: Twin | None) -> None:
        self._twin = other
        self.bound = None if other is None else BoundTwin(other)
        self.replaced[0] = 1

    @property
    def source(self) -> object:
        """What readings come from; None: a device that is not there."""
        return self.device if self._twin is None else self._twin


def part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    """Return the views of some channels in State."""
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
