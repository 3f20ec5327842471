"""Move a god-object towards a goal without friction and without ever entering an object.

The probe's centre is a point; every object grown by the probe's radius is an obstacle. At the present position each
convex obstacle gives one half-space that is surely free of it, bounded by the plane through its nearest point. The
point of all these half-spaces that is nearest to the goal is reached along a straight line that meets nothing,
whatever its length, so nothing can be jumped over; then new planes are taken at that point. Each move brings the centre
nearer to the goal; when no move is left, it is exactly the touching surfaces that hold the centre back (Zilles and
Salisbury 1995, Ruspini 1997, with all constraints at once in place of one after the other).

A mesh has too many triangles to take a plane from each. Its planes are found when they are needed: the straight line to
the nearest point is tried, the first triangle that it touches gives a plane, and the nearest point is sought again.
"""

from itouch.contact import layout as at
from itouch.contact.constraint_planes import gather
from itouch.contact.distance import distance
from itouch.contact.halfspaces import Solution, nearest_allowed, normal_of
from itouch.contact.kernel_decorators import inner
from itouch.contact.layout import ZERO
from itouch.contact.local_search import search_locally
from itouch.contact.meshcast import mesh_cast
from itouch.contact.object_poses import rotate, to_local, unrotate
from itouch.contact.scratch import Mesh, add_seed, put_plane
from itouch.contact.surface_walk import walk_surface
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

#: How many straight moves the god-object may make in one step.
MAX_MOVES = 64
SMALL = 0.2  # a probe is small if its radius is below this share of the distance to the goal
MAX_CUTS = 24
RELATIVE, ABSOLUTE = 1e-10, 1e-13  # a shorter move ends the search: of the distance to the goal, plus [m]
ROUNDED = 1e-2  # with a mesh, plus this share of the gap that counts as contact
Slid = tuple[Vector, Solution]


@inner
def _onto_surface(site: Floats, count: int, active: int, p: Vector, goal: Vector) -> tuple[bool, Vector]:
    """Exact nearest point to the goal on one grown primitive, when it is on the same side and all planes allow it."""
    k = int(site[active, at.PLANE_FRAME])
    depth, normal, _ = distance(site, k, to_local(site, k, add(p, goal)))
    normal = rotate(site, k, normal)
    if dot(normal, normal_of(site, active)) < 0.5:
        return False, goal
    y = along(goal, site[k, at.FRAME_REACH] - depth, normal)
    for q in range(count):
        if q != active and dot(normal_of(site, q), y) + site[q, at.PLANE_GAP] < 0.0:
            return False, goal
    return True, y


@inner
def cut(site: Floats, mesh: Mesh, p: Vector, y: Vector, count: int) -> tuple[int, float]:
    """Add the plane of the first triangle that a move from ``p`` by ``y`` touches; returns count and free share of y.

    ``site`` (rows, SITE_WIDTH), of which the first ``count`` rows are planes; ``p`` and ``y`` [m], world frame.
    """
    length = norm(y)
    if length == 0.0:
        return count, 1.0
    way = (y[0] / length, y[1] / length, y[2] / length)
    best, which = length, -1
    triangle, normal, gap = -1, way, 0.0
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] == at.KIND_MESH:
            hit = mesh_cast(site, mesh, k, to_local(site, k, p), unrotate(site, k, way), best)
            if hit[1] >= 0:
                best, which, triangle, normal, gap = hit[0], k, hit[1], hit[2], hit[3]
    if which < 0:
        return count, 1.0
    add_seed(site, which, triangle, 0.0)
    return put_plane(site, count, which, triangle, rotate(site, which, normal), gap), best / length


@inner
def creep(site: Floats, mesh: Mesh | None, start: Vector, goal: Vector) -> Slid:
    """Slide by safe straight moves, each as far as the planes allow.

    ``site`` (rows, SITE_WIDTH); ``start`` and ``goal`` [m], world frame.
    """
    p = start
    count = int(ZERO)
    solution: Solution = ((0.0, 0.0, 0.0), -1, -1, -1, True)
    jumped, fine = mesh is not None, ABSOLUTE
    if mesh is not None:  # a direction away from a triangle has an error of the rounding error divided by the reach
        fine += ROUNDED * site[at.ENDS, at.END_TOUCH]
    for move in range(MAX_MOVES):
        to_goal = sub(goal, p)
        length = norm(to_goal)
        if mesh is not None and move == 1:
            done, place, solution = search_locally(site, mesh, p, goal)
            if done:
                return place, solution
        count = gather(site, mesh, p, 2.0 * length + ABSOLUTE)
        solution = nearest_allowed(site, count, to_goal)
        y = solution[0]
        if solution[1] >= 0 and norm(y) <= RELATIVE * length + fine:
            break
        if mesh is not None:
            for i in range(MAX_CUTS):
                count, free = cut(site, mesh, p, y, count)
                if free == 1.0:
                    break
                if i == MAX_CUTS - 1:
                    y = along((0.0, 0.0, 0.0), free, y)
                    break
                solution = nearest_allowed(site, count, to_goal)
                y = solution[0]
        if not solution[4]:
            break
        if solution[1] < 0:
            return goal, solution
        if norm(y) <= RELATIVE * length + fine:
            break
        if solution[2] < 0 and not jumped:
            jumped, exact = _onto_surface(site, count, solution[1], p, to_goal)
            p = add(p, exact if jumped else y)
        else:
            jumped = mesh is not None
            p = add(p, y)
    return p, solution


@inner
def is_small(site: Floats, length: float) -> bool:
    """Whether the probe is small compared with the way to its goal, so that guessing a nearby position is of no use.

    ``site`` (rows, SITE_WIDTH); ``length`` of the way [m].
    """
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_REACH] > SMALL * length:
            return False
    return True


@inner
def slide(site: Floats, mesh: Mesh | None, start: Vector, goal: Vector) -> Slid:
    """Slide from ``start`` towards ``goal``; returns the position reached and the solution there.

    ``site`` (rows, SITE_WIDTH); ``start`` and ``goal`` [m], world frame.
    """
    if mesh is not None:
        small = is_small(site, norm(sub(goal, start)))
        if not small:
            done, place, solution = search_locally(site, mesh, start, goal)
            if done:
                return place, solution
        if int(site[at.ENDS, at.END_FRAMES]) == at.FRAME_FIRST + 1:
            for s in range(at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])):
                done, place = walk_surface(site, mesh, s, start, goal)
                if done:
                    return place, ((0.0, 0.0, 0.0), 0, -1, -1, True)
    return creep(site, mesh, start, goal)
