"""Poses of the objects that are near enough to matter in a step of contact, as rows of a scratch table."""

from itouch.contact.kernel_decorators import inner
from itouch.contact.layout import FRAME_NOW, FRAME_POSE
from itouch.contact.vectors import Floats, Vector


@inner
def rotate(f: Floats, k: int, v: Vector) -> Vector:
    """Turn a direction from the object's frame to the world's, by the present pose.

    ``f``: a site, (rows, SITE_WIDTH), whose row ``k`` is the object's; ``v`` in any unit.
    """
    c = FRAME_NOW
    return (
        f[k, c + 3] * v[0] + f[k, c + 4] * v[1] + f[k, c + 5] * v[2],
        f[k, c + 6] * v[0] + f[k, c + 7] * v[1] + f[k, c + 8] * v[2],
        f[k, c + 9] * v[0] + f[k, c + 10] * v[1] + f[k, c + 11] * v[2],
    )


@inner
def unrotate(f: Floats, k: int, v: Vector) -> Vector:
    """Turn a direction from the world's frame to the object's, by the present pose.

    ``f``: a site, (rows, SITE_WIDTH), whose row ``k`` is the object's; ``v`` in any unit.
    """
    c = FRAME_NOW
    return (
        f[k, c + 3] * v[0] + f[k, c + 6] * v[1] + f[k, c + 9] * v[2],
        f[k, c + 4] * v[0] + f[k, c + 7] * v[1] + f[k, c + 10] * v[2],
        f[k, c + 5] * v[0] + f[k, c + 8] * v[1] + f[k, c + 11] * v[2],
    )


@inner
def to_world(f: Floats, k: int, q: Vector) -> Vector:
    """Transform a point from the object's frame to the world's, by the present pose.

    ``f``: a site, (rows, SITE_WIDTH), whose row ``k`` is the object's; ``q`` [m].
    """
    v = rotate(f, k, q)
    c = FRAME_NOW
    return (f[k, c] + v[0], f[k, c + 1] + v[1], f[k, c + 2] + v[2])


@inner
def to_local(f: Floats, k: int, p: Vector) -> Vector:
    """Transform a point from the world's frame to the object's, by the present pose.

    ``f``: a site, (rows, SITE_WIDTH), whose row ``k`` is the object's; ``p`` [m].
    """
    c = FRAME_NOW
    x, y, z = p[0] - f[k, c], p[1] - f[k, c + 1], p[2] - f[k, c + 2]
    return (
        f[k, c + 3] * x + f[k, c + 6] * y + f[k, c + 9] * z,
        f[k, c + 4] * x + f[k, c + 7] * y + f[k, c + 10] * z,
        f[k, c + 5] * x + f[k, c + 8] * y + f[k, c + 11] * z,
    )


@inner
def to_local_then(f: Floats, k: int, p: Vector) -> Vector:
    """Transform a point from the world's frame to the object's, by the pose of the last step.

    ``f``: a site, (rows, SITE_WIDTH), whose row ``k`` is the object's; ``p`` [m].
    """
    c = FRAME_NOW + FRAME_POSE
    x, y, z = p[0] - f[k, c], p[1] - f[k, c + 1], p[2] - f[k, c + 2]
    return (
        f[k, c + 3] * x + f[k, c + 6] * y + f[k, c + 9] * z,
        f[k, c + 4] * x + f[k, c + 7] * y + f[k, c + 10] * z,
        f[k, c + 5] * x + f[k, c + 8] * y + f[k, c + 11] * z,
    )


@inner
def set_frame(f: Floats, k: int, then: int, poses: Floats, obj: int) -> None:
    """Write one pose (x, y, z, quaternion w, x, y, z of any length but zero) as present (0) or last (1).

    ``f``: a site, (rows, SITE_WIDTH), written in row ``k``; ``poses`` (objects, 7), positions in [m].
    """
    c = FRAME_NOW + then * FRAME_POSE
    w, x, y, z = poses[obj, 3], poses[obj, 4], poses[obj, 5], poses[obj, 6]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    f[k, c], f[k, c + 1], f[k, c + 2] = poses[obj, 0], poses[obj, 1], poses[obj, 2]
    f[k, c + 3], f[k, c + 4], f[k, c + 5] = 1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
    f[k, c + 6], f[k, c + 7], f[k, c + 8] = s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)
    f[k, c + 9], f[k, c + 10], f[k, c + 11] = s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)
