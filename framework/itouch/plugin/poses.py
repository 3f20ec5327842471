"""Poses: pure functions on ``(7,)`` arrays, position [m] then unit quaternion w x y z.

A name such as ``world_from_arm`` says that the pose takes arm coordinates to world coordinates:
``transform(world_from_arm, p_arm)`` is ``p_world``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IDENTITY: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def quaternion_from_rpy(rpy: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the quaternion of rotations about the fixed x, then y, then z axes [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def normalized(quaternion: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the unit quaternion of the same rotation.

    Raises
    ------
    ValueError
        If its length is zero or not finite.
    """
    w, x, y, z = quaternion
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not (math.isfinite(length) and length > 1e-9):
        raise ValueError(f"a quaternion of length {length:g} is not a rotation")
    return (w / length, x / length, y / length, z / length)


def multiply(a: Array, b: Array) -> Array:
    """Return the product, shape (4,), of two quaternions (4,): w, x, y, z, without a unit."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def rotate(quaternion: Array, vector: Array) -> Array:
    """Rotate a vector, shape (3,), in any unit, by a quaternion (4,)."""
    w, u = quaternion[0], quaternion[1:]
    t = 2.0 * np.cross(u, vector)
    rotated: Array = vector + w * t + np.cross(u, t)
    return rotated


def conjugate(quaternion: Array) -> Array:
    """Return the inverse of a rotation, a quaternion (4,) of length 1; shape (4,)."""
    inverse_rotation: Array = quaternion * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse_rotation


def compose(a: Array, b: Array) -> Array:
    """Return the pose a * b: ``compose(world_from_a, a_from_b)`` is ``world_from_b``.

    All are poses (7,): position [m], quaternion w, x, y, z.
    """
    return np.concatenate([a[:3] + rotate(a[3:], b[:3]), multiply(a[3:], b[3:])])


def inverse(pose: Array) -> Array:
    """Return the pose that undoes this one; both (7,): position [m], quaternion w, x, y, z."""
    back = conjugate(pose[3:])
    return np.concatenate([-rotate(back, pose[:3]), back])


def transform(pose: Array, point: Array) -> Array:
    """Transform a point (3,) [m] by a pose (7,): position [m], quaternion w, x, y, z."""
    return pose[:3] + rotate(pose[3:], point)


def matrix(quaternion: Sequence[float]) -> Array:
    """Return the rotation matrix, shape (3, 3), of a unit quaternion w, x, y, z."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
