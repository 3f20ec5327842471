"""Where a sphere that moves along a straight line first touches a mesh."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.bvh import CHILD_COUNT, CHILD_REF, CHILD_WIDTH, Floats32, Ints32
from itouch.contact.kernel_decorators import inner
from itouch.contact.object_poses import to_local, to_local_then
from itouch.contact.scratch import Mesh
from itouch.contact.search import box_distance2
from itouch.contact.triangle import face_normal, height, nearest_of, plane_distance2
from itouch.contact.vectors import Floats, Vector, along, dot, norm, sub

Hit = tuple[float, int, Vector, float]


@inner
def off_triangle(vertices: Floats, triangles: Ints32, t: int, q: Vector) -> tuple[float, Vector]:
    """Distance from a triangle and the direction away from it.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``q`` and the distance [m], mesh's frame.
    """
    away = sub(q, nearest_of(vertices, triangles, t, q))
    distance = norm(away)
    if distance == 0.0:
        return 0.0, face_normal(vertices, triangles, t)
    return distance, (away[0] / distance, away[1] / distance, away[2] / distance)


@inner
def place_then(site: Floats, k: int) -> Vector:
    """Return the proxy's position at the end of the last step, in the frame that the object had then.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the object's; the position in [m].
    """
    c = at.END_OLD
    old = (site[at.ENDS, c], site[at.ENDS, c + 1], site[at.ENDS, c + 2])
    if site[k, at.FRAME_MOVED] > 0.0:
        return to_local_then(site, k, old)
    return to_local(site, k, old)


@inner
def counts(site: Floats, mesh: Mesh, k: int, t: int, q: Vector) -> bool:
    """Whether a triangle can hold back a probe that is at ``q``.

    One-sided surfaces let through what comes from behind: a probe behind the triangle, and a probe that is on its way
    through an open surface from behind. A probe that rolls over the rim of an open surface goes on touching it.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's; ``q`` [m], mesh's frame.
    """
    if site[k, at.FRAME_SIDES] == at.TWO_SIDED:
        return True
    in_front = height(mesh[0], mesh[1], t, q) >= 0.0
    if site[k, at.FRAME_SIDES] == at.SOLID:
        return in_front
    distance, normal = off_triangle(mesh[0], mesh[1], t, q)
    if distance < site[k, at.FRAME_REACH] - 3.0 * site[k, at.FRAME_SLACK]:
        return False
    if in_front:
        return True
    old = place_then(site, k)
    for s in range(at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])):
        if site[s, at.SEED_FRAME] == k and site[s, at.SEED_BEGAN] > 0.0:
            _, began = off_triangle(mesh[0], mesh[1], int(site[s, at.SEED_TRIANGLE]), old)
            if dot(normal, began) > 0.5:
                return True
    return False


@inner
def triangle_cast(
    vertices: Floats, triangles: Ints32, t: int, start: Vector, way: Vector, length: float, radius: float, slack: float
) -> Hit:
    """First touch of a triangle: distance travelled (inf: none), triangle, normal, and the start's gap to that plane.

    Newton's iteration on the distance as a convex function of the distance travelled; each iterate's plane has the
    whole triangle behind it, so that stopping early is safe. A triangle that is only grazed, less than ``slack`` deep,
    is no touch: a probe that slides from one triangle to the next grazes the edge between them.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH); ``start``, ``length``, ``radius`` and ``slack`` [m],
    ``way`` a unit vector.
    """
    gone, gap, rate = 0.0, 0.0, 0.0
    normal = (0.0, 0.0, 0.0)
    for _ in range(40):
        distance, normal = off_triangle(vertices, triangles, t, along(start, gone, way))
        gap, rate = distance - radius, -dot(normal, way)
        if rate <= 1e-12:
            return np.inf, -1, normal, 0.0
        if gap + slack <= 0.01 * slack:
            break
        gone += (gap + slack) / rate
        if gone > length:
            return np.inf, -1, normal, 0.0
    return gone, t, normal, gap + gone * rate


@inner
def _entry(nodes: Floats32, node: int, side: int, start: Vector, way: Vector, length: float, radius: float) -> float:
    """Distance travelled when a point enters a child's box grown by the radius; inf if not within the length."""
    low, high = 0.0, length
    for c in range(3):
        down, up = (
            nodes[node, CHILD_WIDTH * side + c] - radius - start[c],
            nodes[node, CHILD_WIDTH * side + c + 3] + radius - start[c],
        )
        if abs(way[c]) < 1e-12:
            if down > 1e-12 * length or up < -1e-12 * length:
                return np.inf
            continue
        a, b = down / way[c], up / way[c]
        low, high = max(low, min(a, b)), min(high, max(a, b))
    return low if low <= high else np.inf


@inner
def mesh_cast(site: Floats, mesh: Mesh, k: int, start: Vector, way: Vector, length: float) -> Hit:
    """First touch of a mesh by the probe, in the mesh's frame; only triangles that count for the start.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's; ``start`` and ``length`` [m], ``way`` a unit vector.
    """
    vertices, triangles, nodes = mesh
    radius, slack = site[k, at.FRAME_REACH], site[k, at.FRAME_SLACK]
    best: Hit = (np.inf, -1, way, 0.0)
    limit = length
    middle, reach = along(start, 0.5 * length, way), radius + 0.5 * length
    node, top = int(site[k, at.FRAME_ROOT]), 0
    while True:
        e0, e1 = np.inf, np.inf
        if box_distance2(nodes, node, 0, middle) <= reach * reach:
            e0 = _entry(nodes, node, 0, start, way, limit, radius)
        if box_distance2(nodes, node, 1, middle) <= reach * reach:
            e1 = _entry(nodes, node, 1, start, way, limit, radius)
        first = 0 if e0 <= e1 else 1
        following = -1
        for i in range(2):
            side = first if i == 0 else 1 - first
            entry = e0 if side == 0 else e1
            if entry > limit:
                break
            ref, count = int(nodes[node, CHILD_REF + side]), int(nodes[node, CHILD_COUNT + side])
            if count == 0:
                if following < 0:
                    following = ref
                else:
                    site[top, at.STACK_KEY], site[top, at.STACK_NODE] = entry, ref
                    top += 1
                continue
            for t in range(ref, ref + count):
                if plane_distance2(vertices, triangles, t, middle) > reach * reach:
                    continue
                hit = triangle_cast(vertices, triangles, t, start, way, limit, radius, slack)
                if hit[0] < best[0] and counts(site, mesh, k, t, start):
                    best = hit
                    limit = min(limit, hit[0])
        if following >= 0:
            node = following
            continue
        while top > 0 and site[top - 1, at.STACK_KEY] > limit:
            top -= 1
        if top == 0:
            break
        top -= 1
        node = int(site[top, at.STACK_NODE])
    return best
