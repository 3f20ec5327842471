"""Distances that are asked for beside the proxy: of a point from one object, and of what lies beside a contact."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed, lent
from itouch.contact.distance import distance
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.meshcast import off_triangle
from itouch.contact.object_poses import rotate, to_local, to_world
from itouch.contact.scratch import Mesh, empty_site, put_object, site_rows
from itouch.contact.search import nearest, steepest
from itouch.contact.triangle import height
from itouch.contact.vectors import Floats, Vector, along, dot, norm, place_of, sub, vector

#: An object nearer than this counts as adjacent, in whatever direction its nearest point lies [m].
_HERE = 1e-5
#: Greatest |cosine| between the surface's normal and the direction to an object that lies beside, not above or below.
_ASIDE = 0.35


@inner
def _mesh_distance(site: Floats, mesh: Mesh, k: int, q: Vector, within: float) -> tuple[float, Vector]:
    """Signed distance [m] of a point from a mesh, in its frame, and the outward direction; inf beyond ``within`` [m].

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's.
    """
    root = int(site[k, at.FRAME_ROOT])
    square, t, _ = nearest(mesh[0], mesh[1], mesh[2], root, q, within, -1, site)
    if t < 0:
        return np.inf, q
    t = steepest(mesh[0], mesh[1], mesh[2], root, q, np.sqrt(square), site)
    away, out = off_triangle(mesh[0], mesh[1], t, q)
    if site[k, at.FRAME_SIDES] != at.TWO_SIDED and height(mesh[0], mesh[1], t, q) < 0.0:
        return -away, (-out[0], -out[1], -out[2])
    return away, out


@entry
def point_distance(
    world: Floats, mesh: Mesh | None, poses: Floats, obj: int, point: Floats, within: float,
    scratch: tuple[Floats, Floats],
) -> tuple[float, Vector, Vector]:  # fmt: skip
    """Find how far a point is from the surface of an object.

    Parameters
    ----------
    world, mesh
        The shapes, from ``Geometry``.
    poses
        (n, 7): x, y, z [m], quaternion w, x, y, z of each object's frame.
    obj
        The number of the object; one that is not there is nowhere within reach.
    point
        (3,) [m], world frame.
    within
        How far to look [m]; only meshes are searched, so it matters for these alone.
    scratch
        From ``Geometry.new_scratch``.

    Returns
    -------
    tuple
        The distance [m], below 0 inside (behind the surface of an open mesh that has one side; never for one with two
        sides), infinite if there is no surface within reach; the surface's outward unit normal there, and the nearest
        point of the surface [m], both in the world frame.
    """
    if not 0 <= obj < world.shape[0]:
        return np.inf, (0.0, 0.0, 1.0), vector(point, 0)
    site, now = borrowed(scratch[0]), lent(poses)
    empty_site(site)
    k, p = int(at.FRAME_FIRST), vector(point, 0)
    put_object(site, k, borrowed(world), now, now, obj, 0.0)
    q = to_local(site, k, p)
    away, out = np.inf, q
    if site[k, at.FRAME_KIND] != at.KIND_MESH:
        away, out, _ = distance(site, k, q)
    elif mesh is not None:
        away, out = _mesh_distance(site, borrowed(mesh), k, q, within)
    normal = rotate(site, k, out)
    foot = along(p, -away, normal) if away < np.inf else p
    return away, normal, foot


@inner
def _away(site: Floats, k: int, mesh: Mesh, p: Vector, reach: float) -> tuple[float, Vector]:
    """Distance [m] of a point from a mesh, and the vector to it from the mesh's nearest point; inf beyond ``reach``."""
    square, found, q = nearest(*mesh, int(site[k, at.FRAME_ROOT]), to_local(site, k, p), reach, -1, site)
    way = sub(p, to_world(site, k, q))
    return (np.sqrt(square), way) if found >= 0 else (np.inf, way)


@entry
def beside(
    world: Floats, mesh: Mesh | None, poses: Floats, primary: int, point: Floats, normal: Floats, reach: float
) -> tuple[int, float]:
    """Find the object that lies beside a contact, with its nearest point in a direction along the surface.

    Parameters
    ----------
    world, mesh, poses
        The objects; see ``itouch.contact``.
    primary
        The object that is touched.
    point, normal
        The touched point of its surface and the normal there, world frame, shape (3,).
    reach
        How far to look [m].

    Returns
    -------
    tuple
        Object (-1: none) and its distance from the point [m], at least 0.
    """
    own_site = np.empty((site_rows(1), at.SITE_WIDTH))
    site, objects, now = borrowed(own_site), borrowed(world), borrowed(poses)
    empty_site(site)
    p, n, k = vector(point, 0), vector(normal, 0), int(at.FRAME_FIRST)
    best, found = reach, -1
    for obj in range(objects.shape[0]):
        if obj == primary or norm(sub(place_of(now, obj), p)) - objects[obj, at.WORLD_BOUND] >= best:
            continue
        put_object(site, k, objects, now, now, obj, 0.0)
        far, way = np.inf, n
        if objects[obj, at.WORLD_KIND] != at.KIND_MESH:
            depth, local, _ = distance(site, k, to_local(site, k, p))
            far, way = max(0.0, depth), rotate(site, k, local)
        elif mesh is not None:
            far, way = _away(site, k, borrowed(mesh), p, best)
        if far < best and (far < _HERE or abs(dot(way, n)) <= _ASIDE * norm(way)):
            best, found = far, obj
    own_site[0, 0] = best  # a last use: the scratch must live until here
    return found, best
