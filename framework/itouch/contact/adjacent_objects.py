"""What lies beside a contact: how far away along the surface another object begins."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed
from itouch.contact.compiling import entry, inner
from itouch.contact.distance import distance
from itouch.contact.frames import rotate, to_local, to_world
from itouch.contact.scratch import Mesh, empty_site, put_object, site_rows
from itouch.contact.search import nearest
from itouch.contact.vectors import Floats, Vector, dot, norm, place_of, sub, vector

#: An object nearer than this counts as adjacent, in whatever direction its nearest point lies [m].
_HERE = 1e-5
#: Greatest |cosine| between the surface's normal and the direction to an object that lies beside, not above or below.
_ASIDE = 0.35


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
