"""Coulomb friction of the proxy: it stays where it sticks, and slides no farther than to the edge of the cone.

Let N be the distance of the HIP below the frictionless solution, and t the tangential distance from the proxy to that
solution. The proxy sticks while t <= mu_s N; once it slides, it follows at t = mu_d N until t falls below that
(Salisbury's friction cone for a god-object; Melder and Harwin 2004 for several surfaces at once). With several contacts
N is the length of the resultant normal force and mu the mean of the contacts' coefficients, weighted by their shares.
"""

from itouch.contact import layout as at
from itouch.contact.constraint_planes import gather, touching
from itouch.contact.halfspaces import Solution, nearest_allowed, normal_of, set_loads
from itouch.contact.kernel_decorators import inlined, inner
from itouch.contact.scratch import Mesh
from itouch.contact.slide import cut, slide
from itouch.contact.vectors import Floats, Vector, along, dot, norm, sub

Pressed = tuple[int, Solution, float, float]
#: How often the proxy may slip on in one step, from one surface to another.
MAX_SLIPS = 6
_MARGIN = 1e-9  # relative slack of the cone against rounding
_MARGIN_SLIDING = 1e-3  # the same after a slide over a curved surface, whose normal has turned on the way


@inlined
def coefficients(site: Floats, count: int, goal: Vector, solution: Solution) -> tuple[float, float]:
    """Return static and dynamic friction, means over the active planes weighted by load; writes the loads.

    ``site`` (rows, SITE_WIDTH), of which the first ``count`` rows are planes; ``goal`` relative to the anchor [m].
    """
    total = set_loads(site, count, goal, solution)
    static, dynamic = 0.0, 0.0
    for k in range(count):
        share = site[k, at.PLANE_LOAD] / total if total > 0.0 else 0.0
        frame = int(site[k, at.PLANE_FRAME])
        static += share * site[frame, at.FRAME_STATIC]
        dynamic += share * site[frame, at.FRAME_DYNAMIC]
    return static, dynamic


@inner
def press(site: Floats, mesh: Mesh | None, p: Vector, hip: Vector) -> Pressed:
    """Find what holds a proxy at ``p`` back from the HIP: planes with loads, their solution, and the friction.

    ``site`` (rows, SITE_WIDTH); ``p`` and ``hip`` [m], world frame.
    """
    to_hip = sub(hip, p)
    count = touching(site, mesh, p)
    solution = nearest_allowed(site, count, to_hip)
    static, dynamic = coefficients(site, count, to_hip, solution)
    return count, solution, static, dynamic


@inner
def drag(site: Floats, mesh: Mesh | None, start: Vector, hip: Vector, slip: int) -> tuple[Vector, int, Pressed]:
    """Move a proxy with friction from ``start``, where it touches; returns place, slip state and what holds it.

    ``site`` (rows, SITE_WIDTH); ``start`` and ``hip`` [m], world frame.
    """
    p, state, margin = start, slip, _MARGIN
    pressed = press(site, mesh, p, hip)
    for _ in range(MAX_SLIPS):
        _, solution, static, dynamic = pressed
        goal, rubs = hip, static > 0.0 and solution[4]  # without friction: straight to the HIP
        if rubs:
            tangential = solution[0]
            normal, wanted = norm(sub(tangential, sub(hip, p))), norm(tangential)
            limit = (dynamic if state == at.SLIP_SLIDE else static) * normal
            if wanted <= limit * (1.0 + margin) + 1e-15:
                if state == at.SLIP_SLIDE and wanted < dynamic * normal * (1.0 - margin):
                    state = at.SLIP_STICK
                return p, max(state, at.SLIP_STICK), pressed
            state, margin = at.SLIP_SLIDE, _MARGIN_SLIDING
            goal = along(hip, -dynamic * normal / wanted, tangential)
        before = p
        p, solution = slide(site, mesh, p, goal)
        pressed = press(site, mesh, p, hip)
        if not rubs:
            return p, at.SLIP_NONE if solution[1] < 0 else at.SLIP_SLIDE, pressed
        if p[0] == before[0] and p[1] == before[1] and p[2] == before[2]:  # it would not move the next time either
            break
    return p, at.SLIP_SLIDE, pressed


@inner
def first_touch(site: Floats, mesh: Mesh | None, start: Vector, goal: Vector) -> Vector:
    """Where a free probe on its straight way to the goal first meets a surface (the goal itself if it meets none).

    ``site`` (rows, SITE_WIDTH); ``start`` and ``goal`` [m], world frame.
    """
    p = start
    for _ in range(32):
        way = sub(goal, p)
        length = norm(way)
        count = gather(site, mesh, p, length)
        share = 1.0
        for k in range(count):
            rate = -dot(normal_of(site, k), way)
            if rate > 0.0 and max(site[k, at.PLANE_GAP], 0.0) < share * rate:
                share = max(site[k, at.PLANE_GAP], 0.0) / rate
        if mesh is not None:
            _, free = cut(site, mesh, p, way, count)
            share = min(share, free)
        p = along(p, share, way)
        if share == 1.0 or share * length <= 1e-12:
            break
    return p


@inner
def into_cone(force: Vector, direction: Vector, mu: float) -> Vector:
    """Reduce the tangential part of a force to the friction cone of ``mu`` about the unit normal ``direction``."""
    push = dot(force, direction)
    tangential = along(force, -push, direction)
    size = norm(tangential)
    if size <= mu * push or size == 0.0:
        return force
    return along(along((0.0, 0.0, 0.0), push, direction), max(mu * push, 0.0) / size, tangential)
