"""The arm as a device: it tracks the finger and pushes it; three translations, rotations locked or sensed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from itouch.plugin import Channel, Device, Field, Record, Touch, Twin, pose, schema, wrench

#: Greatest force [N] and stiffness [N/m] of a Novint Falcon, as CHAI3D 3.3 states them.
FORCE, STIFFNESS = 8.0, 3000.0
#: Adding and subtracting it rounds a number to an integer, and leaves NaN what it is.
_TO_INTEGER = 1.5 * 2.0**52


@dataclass(frozen=True, slots=True)
class UsbArmParams:
    """What ``<usb-arm:hardware>`` may hold."""

    rotations: str = schema.choice(
        "locked", "sensed", default="locked", doc="whether the arm's end cannot turn, or its turning is sensed"
    )
    resolution: float = schema.quantity(
        "m", low=0.0, high=1e-3, default=3e-5, doc="of the twin: step of the position that the encoders give"
    )


class UsbArmTwin(Twin):
    """The finger hangs on the arm: the twin reads its pose through encoders of finite resolution."""

    def fields(self) -> tuple[Field, ...]:
        """Return the true pose of the end."""
        return (Field("pose", "f8", 7),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Begin at the frame's origin until the finger is attached."""
        state["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Go with the finger."""
        if touch.finger_attached:
            state["pose"] = touch.finger_pose

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the pose in steps of the encoders."""
        values: list[float] = state["pose"].tolist()
        step = self.params.resolution
        if step > 0.0:
            x, y, z = values[0:3]
            values[0:3] = (
                (x / step + _TO_INTEGER - _TO_INTEGER) * step,
                (y / step + _TO_INTEGER - _TO_INTEGER) * step,
                (z / step + _TO_INTEGER - _TO_INTEGER) * step,
            )
        if self.params.rotations == "locked":
            values[3:] = (1.0, 0.0, 0.0, 0.0)
        reading["pose"] = values
        return True


class UsbArm(Device):
    """A desktop haptic arm presented with six degrees of freedom."""

    Params = UsbArmParams
    reads = (pose(),)
    commands = (wrench(force=FORCE),)
    Twin = UsbArmTwin
    twin_only: ClassVar[bool] = True
    max_stiffness: ClassVar[float | None] = STIFFNESS
    damping: ClassVar[float | None] = 0.0

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; what is not sensed is locked."""
        locked = (3, 4, 5) if params.rotations == "locked" else ()
        return (pose(locked=locked),), cls.commands
