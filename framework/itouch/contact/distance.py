"""Signed distance of a point from a primitive, in the primitive's own frame.

Each function returns ``(distance, normal, feature)``: metres, negative inside; the unit normal out of the object at
the nearest point of its surface (the gradient of the distance); and a small code of the face, edge or vertex.
All primitives are convex, so the plane through the nearest point with this normal has the whole object behind it:
that property carries the whole solver.
"""

import numpy as np

from itouch.contact.kernel_decorators import inner
from itouch.contact.layout import (
    FRAME_KIND,
    FRAME_SIZE,
    KIND_BOX,
    KIND_CAPSULE,
    KIND_CYLINDER,
    KIND_PLANE,
    KIND_SPHERE,
)
from itouch.contact.vectors import Floats, Vector

Answer = tuple[float, Vector, int]


@inner
def sphere_distance(q: Vector, radius: float) -> Answer:
    """Sphere about the origin."""
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if length == 0.0:
        return -radius, (0.0, 0.0, 1.0), 0
    return length - radius, (q[0] / length, q[1] / length, q[2] / length), 0


@inner
def box_distance(q: Vector, x: float, y: float, z: float) -> Answer:
    """Box of half extents x, y, z. Feature: 9 (sx + 1) + 3 (sy + 1) + sz + 1 of the sides that touch (-1, 0, 1)."""
    ex, ey, ez = abs(q[0]) - x, abs(q[1]) - y, abs(q[2]) - z
    sx = 1.0 if q[0] > 0.0 else -1.0
    sy = 1.0 if q[1] > 0.0 else -1.0
    sz = 1.0 if q[2] > 0.0 else -1.0
    if ex <= 0.0 and ey <= 0.0 and ez <= 0.0:
        if ez >= ex and ez >= ey:
            return ez, (0.0, 0.0, sz), 12 + int(sz) + 1
        if ex >= ey:
            return ex, (sx, 0.0, 0.0), 9 * (int(sx) + 1) + 4
        return ey, (0.0, sy, 0.0), 9 + 3 * (int(sy) + 1) + 1
    ex, ey, ez = max(ex, 0.0), max(ey, 0.0), max(ez, 0.0)
    length = np.sqrt(ex * ex + ey * ey + ez * ez)
    code = 13
    code += 9 * int(sx) if ex > 0.0 else 0
    code += 3 * int(sy) if ey > 0.0 else 0
    code += int(sz) if ez > 0.0 else 0
    return length, (sx * ex / length, sy * ey / length, sz * ez / length), code


@inner
def capsule_distance(q: Vector, radius: float, half: float) -> Answer:
    """Capsule along z. Feature: 0 side, 1 upper, 2 lower end."""
    z = min(max(q[2], -half), half)
    distance, normal, _ = sphere_distance((q[0], q[1], q[2] - z), radius)
    if q[0] == 0.0 and q[1] == 0.0 and abs(q[2]) <= half:
        return distance, (1.0, 0.0, 0.0), 0
    return distance, normal, 1 if q[2] > half else (2 if q[2] < -half else 0)


@inner
def cylinder_distance(q: Vector, radius: float, half: float) -> Answer:
    """Cylinder along z. Feature: 0 side, 1 upper, 2 lower end, 3 upper, 4 lower rim."""
    rho = np.sqrt(q[0] * q[0] + q[1] * q[1])
    cx, cy = (q[0] / rho, q[1] / rho) if rho > 0.0 else (1.0, 0.0)
    sz = 1.0 if q[2] > 0.0 else -1.0
    side, end = rho - radius, abs(q[2]) - half
    upper = sz > 0.0
    if side > 0.0 and end > 0.0:
        length = np.sqrt(side * side + end * end)
        return length, (cx * side / length, cy * side / length, sz * end / length), 3 if upper else 4
    if end >= side:
        return end, (0.0, 0.0, sz), 1 if upper else 2
    return side, (cx, cy, 0.0), 0


@inner
def distance(site: Floats, k: int, q: Vector) -> Answer:
    """Signed distance from the primitive of one of the site's objects.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the object's; ``q`` and the distance [m],
    object's frame.
    """
    kind = int(site[k, FRAME_KIND])
    x, y, z = site[k, FRAME_SIZE], site[k, FRAME_SIZE + 1], site[k, FRAME_SIZE + 2]
    if kind == KIND_BOX:
        return box_distance(q, x, y, z)
    if kind == KIND_PLANE:
        return q[2], (0.0, 0.0, 1.0), 0
    if kind == KIND_SPHERE:
        return sphere_distance(q, x)
    if kind == KIND_CAPSULE:
        return capsule_distance(q, x, y)
    if kind == KIND_CYLINDER:
        return cylinder_distance(q, x, y)
    return np.inf, (0.0, 0.0, 1.0), 0
