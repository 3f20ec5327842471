"""Where the proxy starts in a probe's first step: at the HIP, or at the nearest free point outside of solids."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.distance import distance
from itouch.contact.halfspaces import nearest_inside, normal_of
from itouch.contact.kernel_decorators import inner
from itouch.contact.layout import ZERO
from itouch.contact.meshcast import off_triangle
from itouch.contact.object_poses import rotate, to_local
from itouch.contact.scratch import Mesh, add_seed, put_plane
from itouch.contact.search import nearest, steepest
from itouch.contact.triangle import height
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

_ROUNDS = 64
_ABSOLUTE = 1e-13


@inner
def mesh_overlap(site: Floats, mesh: Mesh, k: int, q: Vector) -> tuple[float, Vector, int]:
    """Gap (negative: overlap), outward direction and triangle of a mesh at ``q``, in its frame; inf: certainly free.

    Inside a solid the way out leads through the nearest surface. Behind an open one-sided surface a probe is free.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's; ``q`` and the gap [m].
    """
    root = int(site[k, at.FRAME_ROOT])
    solid = site[k, at.FRAME_SIDES] == at.SOLID
    bound = np.inf if solid and norm(q) <= site[k, at.FRAME_BOUND] else site[k, at.FRAME_REACH]
    square, t, _ = nearest(mesh[0], mesh[1], mesh[2], root, q, bound, -1, site)
    if t < 0:
        return np.inf, q, t
    t = steepest(mesh[0], mesh[1], mesh[2], root, q, np.sqrt(square), site)
    away, out = off_triangle(mesh[0], mesh[1], t, q)
    if site[k, at.FRAME_SIDES] != at.TWO_SIDED and height(mesh[0], mesh[1], t, q) < 0.0:
        if not solid:
            return np.inf, out, t
        return -away - site[k, at.FRAME_REACH], (-out[0], -out[1], -out[2]), t
    return away - site[k, at.FRAME_REACH], out, t


@inner
def overlaps(site: Floats, mesh: Mesh | None, p: Vector) -> int:
    """Write the planes of all objects that a probe at ``p`` overlaps; returns how many.

    ``site`` (rows, SITE_WIDTH); ``p`` [m], world frame.
    """
    count = int(ZERO)
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            depth, normal, feature = distance(site, k, to_local(site, k, p))
            gap = depth - site[k, at.FRAME_REACH]
            if gap < -_ABSOLUTE:
                count = put_plane(site, count, k, feature, rotate(site, k, normal), gap)
        elif mesh is not None:
            gap, normal, t = mesh_overlap(site, mesh, k, to_local(site, k, p))
            if gap < -_ABSOLUTE:
                add_seed(site, k, t, 0.0)
                count = put_plane(site, count, k, t, rotate(site, k, normal), gap)
    return count


@inner
def nearest_free(site: Floats, mesh: Mesh | None, hip: Vector) -> Vector:
    """Find the position nearest to ``hip`` at which the probe overlaps no solid and no front of a surface.

    ``site`` (rows, SITE_WIDTH); ``hip`` [m], world frame.
    """
    p, anchor, count = hip, hip, int(ZERO)
    kept = site[site.shape[0] - at.MAX_PLANES :]
    for _ in range(_ROUNDS):
        fresh = overlaps(site, mesh, p)
        if fresh == 0:
            break
        if count + fresh > at.MAX_PLANES:
            count, anchor = int(ZERO), p
        offset = sub(p, anchor)
        worst = int(ZERO)
        for k in range(fresh):
            if site[k, at.PLANE_GAP] < site[worst, at.PLANE_GAP]:
                worst = k
            n = normal_of(site, k)
            for c in range(3):
                kept[count, at.PLANE_NORMAL + c] = n[c]
            kept[count, at.PLANE_GAP] = site[k, at.PLANE_GAP] - dot(n, offset)
            count += 1
        solution = nearest_inside(kept, count, (0.0, 0.0, 0.0))
        if solution[4]:
            p = add(anchor, solution[0])
        else:  # opposed walls: move out of the deepest overlap alone
            p = along(p, -site[worst, at.PLANE_GAP], normal_of(site, worst))
            count, anchor = int(ZERO), p
    return p
