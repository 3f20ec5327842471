"""How far a point is from the surface of one object, inside or outside, for contact that is computed elsewhere."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed, lent
from itouch.contact.compiling import entry, inner
from itouch.contact.distance import distance
from itouch.contact.frames import rotate, to_local
from itouch.contact.meshcast import off_triangle
from itouch.contact.scratch import Mesh, empty_site, put_object
from itouch.contact.search import nearest, steepest
from itouch.contact.triangle import height
from itouch.contact.vectors import Floats, Vector, along, vector


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
