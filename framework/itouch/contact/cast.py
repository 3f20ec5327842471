"""Continuous collision detection: where a sphere that moves along a straight line first touches an object.

The distance of a moving point from a convex object is a convex function of the distance travelled, so Newton's
iteration for "distance = radius" from the free side never passes the root and converges quadratically.
"""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed
from itouch.contact.distance import distance
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.layout import FRAME_FIRST, ZERO
from itouch.contact.meshcast import mesh_cast
from itouch.contact.object_poses import rotate, to_local, unrotate
from itouch.contact.reset import mesh_overlap
from itouch.contact.scratch import Mesh, empty_site, put_object, site_rows
from itouch.contact.vectors import Floats, Vector, along, dot, norm, place_of, put, sub, vector

BACK = 0.025  # a probe that has sunk in by less than this still faces the surface that it came through [m]
_CLOSE = 1e-9  # gap at which the iteration ends [m]; the root is then nearer than this over the cosine of incidence
_STEPS = 100
_NO_NORMAL = (0.0, 0.0, 0.0)


@inner
def _advance(
    site: Floats, k: int, start: Vector, way: Vector, radius: float, first: float, last: float
) -> tuple[float, Vector]:
    """Distance of the first touch of a primitive between ``first`` and ``last`` (inf: none), normal; world frame."""
    gone, normal = first, _NO_NORMAL
    for _ in range(_STEPS):
        depth, local, _ = distance(site, k, to_local(site, k, along(start, gone, way)))
        normal = rotate(site, k, local)
        gap, rate = depth - radius, -dot(normal, way)
        if gap <= _CLOSE and rate > 0.0:
            return gone + gap / max(rate, 1e-3), normal
        if rate <= 1e-12:
            break
        gone += gap / rate
        if gone > last:
            break
    return np.inf, normal


@inner
def _meet(site: Floats, k: int, start: Vector, way: Vector, radius: float, limit: float) -> tuple[float, Vector]:
    """Distance of the first touch of a primitive; negative if the probe has already sunk into the side it faces."""
    depth, _, _ = distance(site, k, to_local(site, k, start))
    if depth >= radius:
        return _advance(site, k, start, way, radius, 0.0, limit)
    depth, _, _ = distance(site, k, to_local(site, k, along(start, -BACK, way)))
    entry_way, normal = _advance(site, k, start, way, radius, -BACK, 0.0)
    if depth < radius or entry_way > 0.0:
        return np.inf, normal
    beyond = 2.0 * (site[k, at.FRAME_BOUND] + radius)
    if beyond < np.inf:
        leave, _ = _advance(site, k, start, (-way[0], -way[1], -way[2]), radius, -beyond, 0.0)
        if leave <= 0.0 and -leave < -entry_way:  # nearer to the far side than to this one: on its way out
            return np.inf, normal
    return entry_way, normal


@inner
def _meet_mesh(site: Floats, mesh: Mesh, k: int, start: Vector, way: Vector, limit: float) -> tuple[float, Vector]:
    """Distance of the first touch of a mesh; negative if the probe has already sunk into a front that it faces."""
    q, local = to_local(site, k, start), unrotate(site, k, way)
    gap, _, _ = mesh_overlap(site, mesh, k, q)
    if gap < 0.0:
        hit = mesh_cast(site, mesh, k, along(q, -BACK, local), local, BACK)
        if hit[1] >= 0 and hit[3] >= 0.0:
            return hit[3] / -dot(hit[2], local) - BACK, rotate(site, k, hit[2])
    hit = mesh_cast(site, mesh, k, q, local, limit)
    if hit[1] < 0:
        return np.inf, _NO_NORMAL
    return hit[3] / -dot(hit[2], local), rotate(site, k, hit[2])


@entry
def sphere_cast(
    world: Floats,
    mesh: Mesh | None,
    poses: Floats,
    start_at: Floats,
    direction: Floats,
    radius: float,
    max_distance: float,
    normal_out: Floats,
) -> tuple[float, int]:
    """Find where a sphere that moves from a point along a unit direction first touches an object.

    Parameters
    ----------
    world, mesh
        From ``Geometry``.
    poses
        (n, 7), as in ``step``.
    start_at, direction
        (3,) centre [m] and unit vector.
    radius, max_distance
        [m].
    normal_out
        (3,), written: the object's normal at the point of touch.

    Returns
    -------
    tuple
        Distance [m] and object; (inf, -1) if nothing is touched. The distance is negative where the sphere has
        already sunk, by less than ``BACK``, into a side that it faces; a side that it comes out of does not count.
    """
    start, way = vector(start_at, 0), vector(direction, 0)
    best, hit = np.inf, -1
    own_site = np.empty((site_rows(1), at.SITE_WIDTH))
    site, objects, now = borrowed(own_site), borrowed(world), borrowed(poses)
    empty_site(site)
    k = int(FRAME_FIRST + ZERO)
    for obj in range(objects.shape[0]):
        to_centre = sub(place_of(now, obj), start)
        middle = min(max(dot(to_centre, way), -BACK), max_distance)
        if norm(along(to_centre, -middle, way)) > objects[obj, at.WORLD_BOUND] + radius:
            continue
        put_object(site, k, objects, now, now, obj, radius)
        distance_to, normal = np.inf, way
        if objects[obj, at.WORLD_KIND] != at.KIND_MESH:
            distance_to, normal = _meet(site, k, start, way, radius, min(best, max_distance))
        elif mesh is not None:
            distance_to, normal = _meet_mesh(site, borrowed(mesh), k, start, way, min(best, max_distance))
        if distance_to < best and distance_to <= max_distance:
            best, hit = distance_to, obj
            put(normal_out, 0, normal)
    own_site[0, 0] = best  # a last use: the scratch must live until here
    return best, hit
