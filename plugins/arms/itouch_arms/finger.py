"""What the arms have in common: the twin that a finger hangs on, and how a force is read from a command."""

from __future__ import annotations

import numpy as np

from itouch.plugin import Bound, Field, Record, Touch, Twin

Vector = tuple[float, float, float]
#: Adding and subtracting it rounds a number to an integer, and leaves NaN what it is.
_TO_INTEGER = 1.5 * 2.0**52


class FingerTwin(Twin):
    """The finger hangs on the arm: its position in steps of the arm's resolution; rotations are not sensed."""

    def fields(self) -> tuple[Field, ...]:
        """Return the true pose of the end."""
        return (Field("pose", "f8", 7, unit="m", doc="true pose of the end: position, quaternion w x y z"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Begin at the frame's origin until the finger is attached."""
        state["pose"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def bound_step(self, state: Record, command: Record, touch: Touch, period: float) -> Bound | None:
        """Return the step on these views as one compiled call."""
        from itouch.plugin.kernels import copied  # the compiler is loaded when an arm runs, not when it is listed

        return Bound(copied, touch.finger_pose, state["pose"]) if touch.finger_attached else None

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Go with the finger."""
        if touch.finger_attached:
            state["pose"] = touch.finger_pose

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the position in steps of the resolution; the operator of a twin holds the switch."""
        x, y, z = state["pose"].tolist()[:3]
        step = self.params.resolution
        if step > 0.0:
            x, y, z = ((part / step + _TO_INTEGER - _TO_INTEGER) * step for part in (x, y, z))
        reading["pose"] = (x, y, z, 1.0, 0.0, 0.0, 0.0)
        if "deadman" in reading:
            reading["deadman"] = 1.0
        return True


def force_of(command: Record) -> Vector:
    """Return the force [N] of a command.

    Raises
    ------
    ValueError
        If a torque is asked for: the arm's rotations are locked.
    """
    x, y, z, *torque = command["wrench"].tolist()
    if any(torque):
        raise ValueError(f"the arm's rotations are locked: no torque {torque} N m can be given")
    return x, y, z


def put_pose(reading: Record, position: Vector, offset: Vector) -> None:
    """Write a pose with locked rotations: the position [m] of the arm's end and what is held in front of it."""
    x, y, z = (a + b for a, b in zip(position, offset, strict=True))
    reading["pose"] = (x, y, z, 1.0, 0.0, 0.0, 0.0)
