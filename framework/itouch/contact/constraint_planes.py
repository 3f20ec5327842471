"""Constraint planes of the god-object: one for each near primitive, and for each mesh triangle in view."""

from itouch.contact import layout as at
from itouch.contact.distance import distance
from itouch.contact.kernel_decorators import inlined, inner
from itouch.contact.layout import ZERO
from itouch.contact.meshcast import off_triangle
from itouch.contact.object_poses import rotate, to_local
from itouch.contact.scratch import Mesh, put_plane
from itouch.contact.vectors import Floats, Vector


@inner
def gather(site: Floats, mesh: Mesh | None, p: Vector, reach: float) -> int:
    """Write the planes of everything within ``reach`` of the surface of a probe at ``p``; returns how many.

    ``site`` (rows, SITE_WIDTH); ``p`` and ``reach`` [m], world frame.
    """
    count = int(ZERO)
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            depth, normal, feature = distance(site, k, to_local(site, k, p))
            gap = depth - site[k, at.FRAME_REACH]
            if gap <= reach:
                count = put_plane(site, count, k, feature, rotate(site, k, normal), gap)
    if mesh is not None:
        for s in range(at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])):
            k, t = int(site[s, at.SEED_FRAME]), int(site[s, at.SEED_TRIANGLE])
            away, normal = off_triangle(mesh[0], mesh[1], t, to_local(site, k, p))
            gap = away - site[k, at.FRAME_REACH]
            if gap <= reach:
                count = put_plane(site, count, k, t, rotate(site, k, normal), gap)
    return count


@inlined
def touching(site: Floats, mesh: Mesh | None, p: Vector) -> int:
    """Write the planes of everything that touches a probe at ``p``; returns how many.

    A plane that does not touch yet is a safe bound for a move, but it exerts no force.

    ``site`` (rows, SITE_WIDTH); ``p`` [m], world frame.
    """
    return gather(site, mesh, p, site[at.ENDS, at.END_TOUCH])
