"""Turn directions between an object's frame and the world by its pose; for kernels that have no site."""

from itouch.contact.kernel_decorators import inner
from itouch.contact.vectors import Floats, Vector, add, along, cross


@inner
def _turn(poses: Floats, obj: int, sign: float, v: Vector) -> Vector:
    w, q = poses[obj, 3], (sign * poses[obj, 4], sign * poses[obj, 5], sign * poses[obj, 6])
    scale = 2.0 / (w * w + q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    once = cross(q, v)
    return add(along(v, scale * w, once), along((0.0, 0.0, 0.0), scale, cross(q, once)))


@inner
def to_space(poses: Floats, obj: int, v: Vector) -> Vector:
    """Turn a direction from the object's frame to the world's; the quaternion may have any length but zero.

    ``poses`` (objects, 7) [m; quaternion w, x, y, z]; ``v`` in any unit.
    """
    return _turn(poses, obj, 1.0, v)


@inner
def to_body(poses: Floats, obj: int, v: Vector) -> Vector:
    """Turn a direction from the world's frame to the object's.

    ``poses`` (objects, 7) [m; quaternion w, x, y, z]; ``v`` in any unit.
    """
    return _turn(poses, obj, -1.0, v)
