"""Rigid transforms on plain floats, for the tick: a few products of Python floats are faster than NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Vector = tuple[float, float, float]


class Frame(NamedTuple):
    """A pose as origin and rotation matrix, row by row."""

    x: float
    y: float
    z: float
    r: tuple[float, ...]

    @property
    def origin(self) -> Vector:
        """The frame's origin in its parent."""
        return self.x, self.y, self.z

    def point(self, p: Sequence[float]) -> Vector:
        """Return a point of this frame in the parent's coordinates."""
        a, b, c = p
        r = self.r
        return (
            self.x + r[0] * a + r[1] * b + r[2] * c,
            self.y + r[3] * a + r[4] * b + r[5] * c,
            self.z + r[6] * a + r[7] * b + r[8] * c,
        )

    def vector(self, v: Sequence[float]) -> Vector:
        """Return a direction of this frame in the parent's coordinates."""
        a, b, c = v
        r = self.r
        return (
            r[0] * a + r[1] * b + r[2] * c,
            r[3] * a + r[4] * b + r[5] * c,
            r[6] * a + r[7] * b + r[8] * c,
        )

    def into(self, p: Sequence[float]) -> Vector:
        """Return a point of the parent in this frame's coordinates."""
        return self.vector_into((p[0] - self.x, p[1] - self.y, p[2] - self.z))

    def vector_into(self, v: Sequence[float]) -> Vector:
        """Return a direction of the parent in this frame's coordinates."""
        a, b, c = v
        r = self.r
        return (
            r[0] * a + r[3] * b + r[6] * c,
            r[1] * a + r[4] * b + r[7] * c,
            r[2] * a + r[5] * b + r[8] * c,
        )

    def compose(self, other: Frame) -> Frame:
        """Return ``other``, which is given in this frame, as a frame in this one's parent."""
        x, y, z = self.point((other.x, other.y, other.z))
        a, b = self.r, other.r
        product = tuple(
            a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j] for i in range(3) for j in range(3)
        )
        return Frame(x, y, z, product)

    def moved(self, offset: Sequence[float]) -> Frame:
        """Return the frame moved by an offset given in its parent."""
        return Frame(self.x + offset[0], self.y + offset[1], self.z + offset[2], self.r)


def quaternion(r: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the unit quaternion w x y z of a rotation matrix, row by row (Shepperd 1978)."""
    trace = r[0] + r[4] + r[8]
    largest = max(trace, r[0], r[4], r[8])
    if largest == trace:
        q = (1.0 + trace, r[7] - r[5], r[2] - r[6], r[3] - r[1])
    elif largest == r[0]:
        q = (r[7] - r[5], 1.0 + r[0] - r[4] - r[8], r[1] + r[3], r[2] + r[6])
    elif largest == r[4]:
        q = (r[2] - r[6], r[1] + r[3], 1.0 - r[0] + r[4] - r[8], r[5] + r[7])
    else:
        q = (r[3] - r[1], r[2] + r[6], r[5] + r[7], 1.0 - r[0] - r[4] + r[8])
    size = math.sqrt(sum(x * x for x in q))
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)


UPRIGHT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def frame(pose: Sequence[float]) -> Frame:
    """Return the frame of a pose: position, quaternion w x y z."""
    px, py, pz, w, x, y, z = pose
    if w == 1.0:
        return Frame(px, py, pz, UPRIGHT)
    return Frame(
        px, py, pz,
        (
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ),
    )  # fmt: skip
