"""Where a sphere that is moved along a straight line first touches an object.

The distance of a moving point from a convex object is a convex function of the way it has gone, so Newton's iteration
for "distance = radius" from the free side never passes the root and converges quadratically.
"""

import numpy as np
from numba import njit

from itouch.contact.distance import distance
from itouch.contact.frames import rotate, set_frame, to_local
from itouch.contact.layout import FRAME_WIDTH, KIND_MESH, WORLD_BOUND, WORLD_KIND, ZERO
from itouch.contact.vectors import Floats, Vector, along, dot, norm, place_of, put, sub, vector

BACK = 0.025  # a probe that has sunk in by less than this still faces the surface that it came through [m]
_CLOSE = 1e-9  # [m]; the root is then nearer than this over the cosine of the incidence
_STEPS = 100


@njit(cache=True, error_model="numpy")
def _advance(
    world: Floats, obj: int, frame: Floats, start: Vector, way: Vector, radius: float, first: float, last: float
) -> tuple[float, Vector]:
    """First touch of one primitive between ``first`` and ``last`` along the way, or infinity; all world frame."""
    at = first
    normal = (0.0, 0.0, 0.0)
    for _ in range(_STEPS):
        depth, local, _ = distance(world, obj, to_local(frame, int(ZERO), along(start, at, way)))
        normal = rotate(frame, int(ZERO), local)
        gap, rate = depth - radius, -dot(normal, way)
        if gap <= _CLOSE and rate > 0.0:
            return at + gap / max(rate, 1e-3), normal
        if rate <= 1e-12:
            break
        at += gap / rate
        if at > last:
            break
    return np.inf, normal


@njit(cache=True, error_model="numpy")
def _meet(
    world: Floats, obj: int, frame: Floats, start: Vector, way: Vector, radius: float, limit: float
) -> tuple[float, Vector]:
    """First touch of one primitive; negative where the probe has already sunk into the side that it faces."""
    depth, _, _ = distance(world, obj, to_local(frame, int(ZERO), start))
    if depth >= radius:
        return _advance(world, obj, frame, start, way, radius, 0.0, limit)
    entry, normal = _advance(world, obj, frame, start, way, radius, -BACK, 0.0)
    if entry > 0.0:
        return np.inf, normal
    back = (-way[0], -way[1], -way[2])
    beyond = 2.0 * (world[obj, WORLD_BOUND] + radius)
    if beyond < np.inf:
        leave, _ = _advance(world, obj, frame, start, back, radius, -beyond, 0.0)
        if leave <= 0.0 and -leave < -entry:  # nearer to the far side than to this one: it is on its way out
            return np.inf, normal
    return entry, normal


@njit(cache=True, error_model="numpy")
def sphere_cast(
    world: Floats, mesh: Floats | None, poses: Floats, start_at: Floats, direction: Floats, radius: float,
    max_distance: float, normal_out: Floats,
) -> tuple[float, int]:
    """First touch of all objects; documented in docs/reference/contact-api.md."""
    start, way = vector(start_at, 0), vector(direction, 0)
    best, hit = np.inf, -1
    frame = np.empty((1, FRAME_WIDTH))
    for obj in range(world.shape[0]):
        if world[obj, WORLD_KIND] == KIND_MESH:
            continue
        to_centre = sub(place_of(poses, obj), start)
        middle = min(max(dot(to_centre, way), -BACK), max_distance)
        if norm(along(to_centre, -middle, way)) > world[obj, WORLD_BOUND] + radius:
            continue
        set_frame(frame, int(ZERO), int(ZERO), poses, obj)
        at, normal = _meet(world, obj, frame, start, way, radius, min(best, max_distance))
        if at < best and at <= max_distance:
            best, hit = at, obj
            put(normal_out, 0, normal)
    return best, hit
