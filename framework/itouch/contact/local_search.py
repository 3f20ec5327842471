"""A shortcut for small moves over a mesh: guess the new position, then prove that it is right.

When the probe is large compared with the move, two free positions less than a quarter of its radius apart are joined
by a path that is free for a probe one percent smaller; so it is enough that the new position is free and that the
planes which touch there hold the goal back. Most steps then cost a single search of the hierarchy, for a triangle that
intrudes.
"""

from itouch.contact import layout as at
from itouch.contact.constraint_planes import gather
from itouch.contact.distance import distance
from itouch.contact.halfspaces import Solution, nearest_inside
from itouch.contact.kernel_decorators import inner
from itouch.contact.meshcast import counts
from itouch.contact.neighbours import NEIGHBOUR
from itouch.contact.object_poses import rotate, to_local
from itouch.contact.scratch import Mesh, add_seed
from itouch.contact.search import intruder
from itouch.contact.triangle import nearest_of
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

NEAR = 0.25  # of the radius: the longest move that the shortcut makes
ROUNDS = 12
WALK = 16  # greatest number of triangles walked over in search of the nearest one


@inner
def _walk(mesh: Mesh, first: int, q: Vector) -> tuple[int, Vector]:
    """Walk from triangle to triangle as long as they are nearer to ``q``; returns the last and its nearest point."""
    nearest = first
    foot = nearest_of(mesh[0], mesh[1], first, q)
    d = sub(q, foot)
    best = dot(d, d)
    for _ in range(WALK):
        here = nearest
        for e in range(3):
            t = int(mesh[1][here, NEIGHBOUR + e])
            if t >= 0:
                point = nearest_of(mesh[0], mesh[1], t, q)
                d = sub(q, point)
                if dot(d, d) < best:
                    best, nearest, foot = dot(d, d), t, point
        if nearest == here:
            break
    return nearest, foot


@inner
def _leads_behind(site: Floats, mesh: Mesh, k: int, t: int, p: Vector) -> bool:
    """Tell whether a triangle of a one-sided open surface lets through a probe that is at ``p``, world frame.

    A probe that is on its way through the surface from behind may touch the front of another part of it; the triangles
    next to that part are then nearer to the goal, but hold back nothing.
    """
    return bool(site[k, at.FRAME_SIDES] == at.ONE_SIDED and not counts(site, mesh, k, t, to_local(site, k, p)))


@inner
def _follow_seeds(site: Floats, mesh: Mesh, p: Vector, x: Vector) -> None:
    """Replace each triangle in view by its neighbour nearest to ``x``, if that is nearer and not in view already.

    The probe comes from ``p``: a neighbour that lets it through is left out.
    """
    first, end = at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])
    for s in range(first, end):
        k, here = int(site[s, at.SEED_FRAME]), int(site[s, at.SEED_TRIANGLE])
        q = to_local(site, k, x)
        d = sub(q, nearest_of(mesh[0], mesh[1], here, q))
        best = dot(d, d) * (1.0 - 1e-12)
        for e in range(3):
            t = int(mesh[1][here, NEIGHBOUR + e])
            known = t < 0
            for other in range(first, end):
                known = known or (site[other, at.SEED_TRIANGLE] == t and site[other, at.SEED_FRAME] == k)
            if not known:
                d = sub(q, nearest_of(mesh[0], mesh[1], t, q))
                if dot(d, d) < best and not _leads_behind(site, mesh, k, t, p):
                    best = dot(d, d)
                    site[s, at.SEED_TRIANGLE] = t


@inner
def _lead(site: Floats, mesh: Mesh, goal: Vector) -> int:
    """Return the row of the triangle in view that is nearest to the goal; -1 if none is in view."""
    best, lead = 1e300, -1
    first, end = at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])
    if end == first + 1:
        return first
    for s in range(first, end):
        k, t = int(site[s, at.SEED_FRAME]), int(site[s, at.SEED_TRIANGLE])
        q = to_local(site, k, goal)
        d = sub(q, nearest_of(mesh[0], mesh[1], t, q))
        if dot(d, d) < best:
            best, lead = dot(d, d), s
    return lead


@inner
def _guess(site: Floats, mesh: Mesh, lead: int, p: Vector, goal: Vector) -> tuple[bool, Vector, Vector]:
    """Guess the new position from the leading triangle; returns whether it is exact for it, the guess, and the foot.

    The foot is the triangle's nearest point to the goal, in the object's frame.  The guess is the position nearest to
    the goal on the triangle grown by the radius; for a goal on the far side of the triangle, the position that the
    planes of all triangles in view allow.
    """
    if lead < 0:
        return False, goal, goal
    k = int(site[lead, at.SEED_FRAME])
    radius = site[k, at.FRAME_REACH]
    q = to_local(site, k, goal)
    seed = int(site[lead, at.SEED_TRIANGLE])
    t, foot = _walk(mesh, seed, q)
    if t != seed and _leads_behind(site, mesh, k, t, p):
        t, foot = seed, nearest_of(mesh[0], mesh[1], seed, q)
    site[lead, at.SEED_TRIANGLE] = t
    d = sub(q, foot)
    away = norm(d)
    if away >= radius:
        return False, goal, foot
    if away > 0.02 * radius and dot(d, sub(to_local(site, k, p), foot)) > 0.0:
        return True, along(goal, (radius - away) / away, rotate(site, k, d)), foot
    to_goal = sub(goal, p)
    count = gather(site, mesh, p, 2.0 * norm(to_goal))
    return False, add(p, nearest_inside(site, count, to_goal)[0]), foot


@inner
def _intrusion(site: Floats, mesh: Mesh, lead: int, foot: Vector, p: Vector, x: Vector) -> int:
    """Look for a triangle that a probe at ``x`` would cut: 0 none, 1 found and kept in view, 2 one that does not count.

    A triangle does not count if it cannot hold back the probe (``counts``).  The leading triangle and its point
    ``foot`` give a plane below which there is no need to look.
    """
    found = 0
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            continue
        radius = site[k, at.FRAME_REACH]
        q = to_local(site, k, x)
        normal, level = (0.0, 0.0, 0.0), -1.0
        if lead >= 0 and site[lead, at.SEED_FRAME] == k:
            d = sub(q, foot)
            away = norm(d)
            if away >= radius - 0.5 * site[k, at.FRAME_SLACK]:
                normal = (d[0] / away, d[1] / away, d[2] / away)
                level = dot(normal, foot)
        t = intruder(
            mesh[0],
            mesh[1],
            mesh[2],
            int(site[k, at.FRAME_ROOT]),
            q,
            radius - site[k, at.FRAME_SLACK],
            normal,
            level,
            site,
        )
        if t >= 0:
            if not counts(site, mesh, k, t, to_local(site, k, p)):
                return 2
            add_seed(site, k, t, 0.0)
            found = 1
    return found


@inner
def _primitives_allow(site: Floats, x: Vector) -> bool:
    """Whether a probe at ``x`` is outside of all primitives."""
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            depth, _, _ = distance(site, k, to_local(site, k, x))
            if depth < site[k, at.FRAME_REACH]:
                return False
    return True


@inner
def search_locally(site: Floats, mesh: Mesh, p: Vector, goal: Vector) -> tuple[bool, Vector, Solution]:
    """Try the shortcut; returns whether it succeeded, the new position, and the solution there.

    ``site`` (rows, SITE_WIDTH); ``p`` and ``goal`` [m], world frame.
    """
    solution: Solution = ((0.0, 0.0, 0.0), -1, -1, -1, True)
    smallest, slack = 1e300, 0.0
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] == at.KIND_MESH and site[k, at.FRAME_REACH] < smallest:
            smallest, slack = site[k, at.FRAME_REACH], site[k, at.FRAME_SLACK]
    if smallest == 1e300:
        return False, p, solution
    lead = _lead(site, mesh, goal)
    exact, x, foot = _guess(site, mesh, lead, p, goal)
    for _ in range(ROUNDS):
        if norm(sub(x, p)) > NEAR * smallest:
            break
        found = _intrusion(site, mesh, lead, foot, p, x)
        if found == 2:
            break
        if found == 0 and exact and _primitives_allow(site, x):
            return True, x, ((0.0, 0.0, 0.0), 0, -1, -1, True)
        to_goal = sub(goal, x)
        count = gather(site, mesh, x, 2.0 * norm(to_goal) + slack)
        solution = nearest_inside(site, count, to_goal)
        if not solution[4]:
            break
        if found == 0 and norm(solution[0]) <= slack:
            return True, goal if solution[1] < 0 else x, solution
        better = _lead(site, mesh, goal) if found > 0 else lead
        if better != lead:
            lead = better
            exact, x, foot = _guess(site, mesh, lead, p, goal)
        else:
            exact, x = False, add(x, solution[0])
            _follow_seeds(site, mesh, p, x)
            if lead >= 0:
                k = int(site[lead, at.SEED_FRAME])
                foot = nearest_of(mesh[0], mesh[1], int(site[lead, at.SEED_TRIANGLE]), to_local(site, k, x))
    return False, p, solution
