"""Coulomb friction of the proxy: it stays where it sticks, and slides no farther than to the edge of the cone.

With the frictionless solution N deep above the goal and a tangential distance t from the proxy to it, the proxy sticks
while t <= mu_s N, and once it slides it follows at t = mu_d N until t falls below that (Salisbury's friction cone for a
god-object; Melder and Harwin 2004 for several surfaces at once). With several contacts N is the length of the resultant
normal force and mu the mean of the contacts' coefficients, weighted by their shares.
"""

from numba import njit

from itouch.contact.halfspaces import Solution, nearest_inside, normal_of, set_loads
from itouch.contact.layout import (
    PLANE_GAP,
    PLANE_LOAD,
    PLANE_OBJECT,
    SLIP_NONE,
    SLIP_SLIDE,
    SLIP_STICK,
    WORLD_DYNAMIC_FRICTION,
    WORLD_STATIC_FRICTION,
)
from itouch.contact.slide import gather, slide
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

MAX_SLIPS = 6
_MARGIN = 1e-9  # relative slack of the cone against rounding


@njit(cache=True, error_model="numpy")
def coefficients(world: Floats, planes: Floats, count: int, goal: Vector, solution: Solution) -> tuple[float, float]:
    """Return static and dynamic friction, means over the active planes weighted by load; writes the loads."""
    total = set_loads(planes, count, goal, solution)
    static, dynamic = 0.0, 0.0
    for k in range(count):
        share = planes[k, PLANE_LOAD] / total if total > 0.0 else 0.0
        obj = int(planes[k, PLANE_OBJECT])
        static += share * world[obj, WORLD_STATIC_FRICTION]
        dynamic += share * world[obj, WORLD_DYNAMIC_FRICTION]
    return static, dynamic


@njit(cache=True, error_model="numpy")
def drag(
    world: Floats, frames: Floats, m: int, start: Vector, hip: Vector, radius: float, slip: int, planes: Floats
) -> tuple[Vector, int]:
    """Move a proxy with friction from ``start``, where it touches or is about to; returns place and slip state."""
    p, state = start, slip
    for _ in range(MAX_SLIPS):
        to_hip = sub(hip, p)
        count = gather(world, frames, m, p, radius, 2.0 * norm(to_hip) + 1e-13, planes)
        solution = nearest_inside(planes, count, to_hip)
        if solution[1] < 0 or not solution[4]:
            place, _, _ = slide(world, frames, m, p, hip, radius, planes)
            return place, SLIP_NONE
        static, dynamic = coefficients(world, planes, count, to_hip, solution)
        settle = (0.0, 0.0, 0.0)
        if solution[2] < 0:  # a proxy that hovers above a single plane comes down to it, friction or not
            i = solution[1]
            settle = along(settle, -planes[i, PLANE_GAP], normal_of(planes, i))
        tangential = sub(solution[0], settle)
        normal, wanted = norm(sub(solution[0], to_hip)), norm(tangential)
        limit = (dynamic if state == SLIP_SLIDE else static) * normal
        if wanted <= limit * (1.0 + _MARGIN) + 1e-15:
            kept = SLIP_STICK if state != SLIP_SLIDE or wanted < dynamic * normal * (1.0 - 1e-6) else SLIP_SLIDE
            return add(p, nearest_inside(planes, count, settle)[0]), kept
        state = SLIP_SLIDE
        left = dynamic * normal / wanted
        p, _, _ = slide(world, frames, m, p, along(hip, -left, tangential), radius, planes)
    return p, SLIP_SLIDE


@njit(cache=True, error_model="numpy")
def first_touch(
    world: Floats, frames: Floats, m: int, start: Vector, goal: Vector, radius: float, planes: Floats
) -> Vector:
    """Where a free probe on its straight way to the goal first meets a surface (the goal itself if it meets none)."""
    p = start
    for _ in range(32):
        way = sub(goal, p)
        length = norm(way)
        count = gather(world, frames, m, p, radius, length, planes)
        share = 1.0
        for k in range(count):
            n = normal_of(planes, k)
            rate = -dot(n, way)
            if rate > 0.0 and max(planes[k, PLANE_GAP], 0.0) < share * rate:
                share = max(planes[k, PLANE_GAP], 0.0) / rate
        p = along(p, share, way)
        if share == 1.0 or share * length <= 1e-12:
            break
    return p


@njit(cache=True, error_model="numpy")
def into_cone(force: Vector, direction: Vector, mu: float) -> Vector:
    """Cut the tangential part of a force to the cone of ``mu`` about the unit normal ``direction``."""
    push = dot(force, direction)
    tangential = along(force, -push, direction)
    size = norm(tangential)
    if size <= mu * push or size == 0.0:
        return force
    return along(along((0.0, 0.0, 0.0), push, direction), max(mu * push, 0.0) / size, tangential)
