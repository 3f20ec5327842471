"""What couples the twins of one probe: the finger on the arm, the plate under it, and the force between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record, Touch
from itouch.twin.hand import Hand

Vector = tuple[float, float, float]


class Body(Protocol):
    """A frame with the maths of one; see ``itouch.loop.frames``."""

    @property
    def z(self) -> float:
        """Height of the origin."""

    @property
    def r(self) -> tuple[float, ...]:
        """Rotation matrix, row by row."""

    def point(self, p: Sequence[float]) -> Vector:
        """Take a point out of the frame."""

    def vector(self, v: Sequence[float]) -> Vector:
        """Turn a direction out of the frame."""

    def into(self, p: Sequence[float]) -> Vector:
        """Take a point into the frame."""

    def vector_into(self, v: Sequence[float]) -> Vector:
        """Turn a direction into the frame."""


class Stand(Protocol):
    """A device's runner, as the coupling sees it."""

    touch: Touch
    sent: Record

    def true_frame(self) -> Body:
        """Return the device's true frame in its carrier."""

    def true_position(self) -> Vector | None:
        """Return the true position of what a twin carries."""


class Coupling:
    """Steps the finger and tells the twins of arm, table and plate what touches them."""

    def __init__(
        self,
        hand: Hand | None,
        radius: float,
        arm: Stand | None,
        table: Stand | None,
        face: Stand | None,
        offset: Vector,
        extent: tuple[float, float] | None,
        state: Record,
        name: str,
        period: float,
    ) -> None:
        self.hand, self._radius, self._period = hand, radius, period
        self._arm, self._table, self._face = arm, table, face
        self._offset, self._extent = offset, extent
        self._hip: NDArray[np.float64] = state[f"{name}.hip"]
        self.plate_force, self.touched = state[f"{name}.plate_force"], state[f"{name}.plate_touched"]
        self.true_top, self.total = state[f"{name}.plate_true_top"], state[f"{name}.total_force"]
        self._last = state[f"{name}.plate_distance"]
        self._tick = state["tick"]
        if table is not None:
            self._load = table.touch.wrench[:3]
        if arm is not None:
            self._end, self._pace = arm.touch.finger_pose[:3], arm.touch.finger_twist[:3]
            arm.touch.finger_attached = hand is not None
        self._push = arm.sent["wrench"][:3] if arm is not None and "wrench" in arm.sent else None

    def reset(self) -> None:
        """Begin apart."""
        self._last[...] = 1.0
        self.touched[...] = -1

    def place(self) -> None:
        """Tell the arm where the finger is, before anything has moved."""
        if self.hand is not None:
            self._tell_arm(self.hand.position.tolist(), (0.0, 0.0, 0.0))

    def step(self, moving: bool) -> None:
        """Advance the finger by one period; ``moving``: the hand follows its script."""
        finger = self.hand.position.tolist() if self.hand is not None else self._hip.tolist()
        arm = self._arm_force()
        push, normal, gap = self._plate(finger)
        plate = (push * normal[0], push * normal[1], push * normal[2])
        total = (arm[0] + plate[0], arm[1] + plate[1], arm[2] + plate[2])
        self.plate_force[...] = push
        self.total[...] = (total[0] * total[0] + total[1] * total[1] + total[2] * total[2]) ** 0.5
        if push <= 0.0:
            if self.touched.item() >= 0:
                self.touched[...] = -1
        elif self.touched.item() < 0:
            self.touched[...] = self._tick
        if self.hand is not None:
            self.hand.step(total, moving)
            self._tell_arm(self.hand.position.tolist(), self.hand.velocity.tolist())
        if self._table is not None:
            back = self._table.true_frame().vector_into(plate)
            self._load[:] = (-back[0], -back[1], -back[2])
        if self._face is not None:
            self._face.touch.force, self._face.touch.gap = push, gap

    def _arm_force(self) -> Vector:
        if self._arm is None or self._push is None:
            return (0.0, 0.0, 0.0)
        return self._arm.true_frame().vector(self._push.tolist())

    def _plate(self, finger: list[float]) -> tuple[float, Vector, float]:
        """Return the plate's push on the finger [N], its normal, and the gap between them [m]."""
        position = self._table.true_position() if self._table is not None else None
        if self._table is None or position is None:
            return 0.0, (0.0, 0.0, 1.0), 1.0
        frame = self._table.true_frame()
        ox, oy, oz = self._offset
        x, y, z = frame.into(finger)
        across, along, gap = x - position[0] - ox, y - position[1] - oy, z - position[2] - oz - self._radius
        self.true_top[...] = frame.point((position[0] + ox, position[1] + oy, position[2] + oz))[2]
        beside = self._extent is not None and (abs(across) > self._extent[0] or abs(along) > self._extent[1])
        if beside:
            gap = max(gap, 1e-3)
        last = self._last.item()
        rate = (gap - last) / self._period if last < 0.5 else 0.0
        self._last[...] = gap
        normal = frame.vector((0.0, 0.0, 1.0))
        push = self.hand.pad_force(gap, rate) if self.hand is not None else 0.0
        return push, normal, gap

    def _tell_arm(self, position: Sequence[float], velocity: Sequence[float]) -> None:
        if self._arm is None:
            return
        frame = self._arm.true_frame()
        self._end[:] = frame.into(position)
        self._pace[:] = frame.vector_into(velocity)
