"""Objects that move: the proxy rides on what it touches and is pushed by what comes its way."""

from itouch.contact import layout as at
from itouch.contact.compiling import inner
from itouch.contact.distance import distance
from itouch.contact.frames import rotate, to_local, to_world
from itouch.contact.halfspaces import nearest_inside
from itouch.contact.layout import ZERO
from itouch.contact.meshcast import mesh_cast, place_then
from itouch.contact.scratch import Mesh, add_seed, put_plane
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

_ROUNDS = 12


@inner
def pushed(site: Floats, mesh: Mesh | None, p: Vector) -> Vector:
    """Position of the proxy after the objects have moved: pushed by those that came its way, not through the others.

    In each object's own frame the proxy is still at its old position; the plane that held it back there moves with the
    object.

    ``site`` (rows, SITE_WIDTH); ``p``, the position before, in [m], world frame.
    """
    count = int(ZERO)
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] == at.KIND_MESH:
            continue
        q = place_then(site, k)
        depth, normal, feature = distance(site, k, q)
        normal = rotate(site, k, normal)
        gap = depth - site[k, at.FRAME_REACH] + dot(normal, sub(p, to_world(site, k, q)))
        count = put_plane(site, count, k, feature, normal, gap)
    y = nearest_inside(site, count, (0.0, 0.0, 0.0))[0]
    if mesh is not None:
        for _ in range(_ROUNDS):
            before = count
            for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
                if site[k, at.FRAME_KIND] == at.KIND_MESH:
                    q = place_then(site, k)
                    step = sub(to_local(site, k, add(p, y)), q)
                    length = norm(step)
                    if length < 1e-14:
                        continue
                    way = along((0.0, 0.0, 0.0), 1.0 / length, step)
                    hit = mesh_cast(site, mesh, k, q, way, length)
                    if hit[1] >= 0:
                        normal = rotate(site, k, hit[2])
                        gap = hit[3] + dot(normal, sub(p, to_world(site, k, q)))
                        add_seed(site, k, hit[1], 0.0)
                        count = put_plane(site, count, k, hit[1], normal, gap)
            if count == before:
                break
            y = nearest_inside(site, count, (0.0, 0.0, 0.0))[0]
    return add(p, y)
