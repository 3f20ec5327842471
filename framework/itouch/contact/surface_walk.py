"""A shortcut for a point probe over a mesh: from triangle to triangle towards the goal, each straight piece checked.

A point probe has no size that would prove a guessed position right (see ``search_locally``), and at an edge, which is
rounded by its tiny skin, the general search makes many tiny moves. Walking over the triangles leads straight to the
end: inside a triangle, at the goal's foot, or in a valley between two triangles, at the goal's foot on their common
edge. Whenever the walk meets anything else - a rim, a peak, the other side, a goal in front of the surface, another
piece of surface in its way - it is left to the general search.
"""

from itouch.contact import layout as at
from itouch.contact.bvh import Ints32
from itouch.contact.kernel_decorators import inner
from itouch.contact.meshcast import mesh_cast
from itouch.contact.neighbours import NEIGHBOUR
from itouch.contact.object_poses import to_local, to_world
from itouch.contact.scratch import Mesh, add_seed
from itouch.contact.triangle import corner, face_normal
from itouch.contact.vectors import Floats, Vector, along, cross, dot, norm, sub

HOPS = 10
SHARP = 0.1  # 1 + cosine between two normals below which an edge is too sharp for a mitre


@inner
def _exit(vertices: Floats, triangles: Ints32, t: int, n: Vector, x: Vector, y: Vector) -> tuple[float, int]:
    """Share of the way from ``x`` to ``y``, in a triangle's plane, where it leaves the triangle, and by which edge."""
    best, edge = 1.0, -1
    for e in range(3):
        a = corner(vertices, triangles[t, e])
        inward = cross(n, sub(corner(vertices, triangles[t, (e + 1) % 3]), a))
        here, there = dot(inward, sub(x, a)), dot(inward, sub(y, a))
        if there < 0.0:
            share = max(here, 0.0) / (max(here, 0.0) - there)
            if share < best:
                best, edge = share, e
    return best, edge


@inner
def _mitre(n: Vector, m: Vector) -> Vector:
    """Point at distance 1 from the two planes with these normals, above their common line."""
    scale = 1.0 / (1.0 + dot(n, m))
    return (scale * (n[0] + m[0]), scale * (n[1] + m[1]), scale * (n[2] + m[2]))


@inner
def _tried(site: Floats, mesh: Mesh, k: int, p: Vector, q: Vector) -> bool:
    """Whether the straight way between two points meets nothing."""
    way = sub(q, p)
    length = norm(way)
    if length == 0.0:
        return True
    return bool(mesh_cast(site, mesh, k, p, along((0.0, 0.0, 0.0), 1.0 / length, way), length)[1] < 0)


@inner
def walk_surface(site: Floats, mesh: Mesh, lead: int, start: Vector, goal_at: Vector) -> tuple[bool, Vector]:
    """Walk from ``start`` towards a goal behind the surface; returns whether the walk succeeded, and where it ended.

    ``lead`` is the row of the triangle in view that is touched; triangles where the walk ends are brought into view.

    ``site`` (rows, SITE_WIDTH); ``start`` and ``goal_at`` [m], world frame.
    """
    vertices, triangles = mesh[0], mesh[1]
    k, t = int(site[lead, at.SEED_FRAME]), int(site[lead, at.SEED_TRIANGLE])
    reach, touch = site[k, at.FRAME_REACH], site[at.ENDS, at.END_TOUCH]
    if site[k, at.FRAME_SIDES] == at.TWO_SIDED:
        return False, start
    p, goal = to_local(site, k, start), to_local(site, k, goal_at)
    n = face_normal(vertices, triangles, t)
    height = dot(n, sub(p, corner(vertices, triangles[t, 0])))
    if abs(height - reach) > touch:
        return False, start
    x = along(p, -height, n)
    for _ in range(HOPS):
        depth = dot(n, sub(goal, x))
        if depth >= reach:
            return False, start
        y = along(goal, -depth, n)
        share, e = _exit(vertices, triangles, t, n, x, y)
        if e < 0:
            end = along(y, reach, n)
            if not _tried(site, mesh, k, p, end):
                return False, start
            add_seed(site, k, t, 0.0)
            return True, to_world(site, k, end)
        u = int(triangles[t, NEIGHBOUR + e])
        if u < 0:
            return False, start
        x = along(x, share, sub(y, x))
        a, b = corner(vertices, triangles[t, e]), corner(vertices, triangles[t, (e + 1) % 3])
        m = face_normal(vertices, triangles, u)
        if dot(n, m) + 1.0 < SHARP:
            return False, start
        corner_at = along(x, reach, _mitre(n, m))
        if not _tried(site, mesh, k, p, corner_at):
            return False, start
        p = corner_at
        inward = cross(sub(b, a), m)  # into the neighbour, whose winding runs along the edge the other way
        fall = dot(m, sub(goal, x))
        if dot(inward, sub(along(goal, -fall, m), x)) <= 0.0:
            line = sub(b, a)
            s = dot(line, sub(goal, a)) / dot(line, line)
            if fall >= reach or not 0.0 <= s <= 1.0 or dot(cross(n, m), line) > 0.0:  # a ridge: the goal is in front
                return False, start
            end = along(along(a, s, line), reach, _mitre(n, m))
            if not _tried(site, mesh, k, p, end):
                return False, start
            add_seed(site, k, t, 0.0)
            add_seed(site, k, u, 0.0)
            return True, to_world(site, k, end)
        t, n = u, m
    return False, start
