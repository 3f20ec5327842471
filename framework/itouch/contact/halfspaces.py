"""The small quadratic programme of the god-object: the point nearest to a goal inside at most 16 half-spaces.

In three dimensions at most three planes are active at the solution. Planes are added one by one: if the solution so far
violates the new plane, that plane is active in the new solution, which is then sought on it alone (the argument of
Seidel, "Small-dimensional linear programming and convex hulls made easy", 1991, for a quadratic objective).
Coordinates are relative to an anchor, so that rounding does not grow with the distance from the world's origin.
"""

import numpy as np

from itouch.contact.kernel_decorators import inlined, inner
from itouch.contact.layout import PLANE_GAP, PLANE_LOAD, PLANE_NORMAL
from itouch.contact.vectors import Floats, Vector, along, cross, dot, norm, sub

Solution = tuple[Vector, int, int, int, bool]
_PARALLEL = 1e-20  # squared sine below which two planes count as parallel


@inner
def normal_of(planes: Floats, k: int) -> Vector:
    """Return the normal of one plane.

    ``planes`` (rows, SITE_WIDTH) as in layout.PLANE_*; the normal is a unit vector, without a unit [1].
    """
    return (planes[k, PLANE_NORMAL], planes[k, PLANE_NORMAL + 1], planes[k, PLANE_NORMAL + 2])


@inner
def _on_line(planes: Floats, i: int, j: int, goal: Vector, slack: float) -> Solution:
    """Nearest point on the line of planes i and j inside the planes before j."""
    ni, nj = normal_of(planes, i), normal_of(planes, j)
    u = cross(ni, nj)
    sine = dot(u, u)
    ri, rj = -planes[i, PLANE_GAP] - dot(ni, goal), -planes[j, PLANE_GAP] - dot(nj, goal)
    c = dot(ni, nj)
    if sine < _PARALLEL:
        if c > 0.0:
            return along(goal, max(ri, rj), ni), i, -1, -1, True
        return along(goal, ri, ni), i, -1, -1, False
    y = along(along(goal, (ri - c * rj) / sine, ni), (rj - c * ri) / sine, nj)
    low, high, at_low, at_high = -np.inf, np.inf, -1, -1
    feasible = True
    for k in range(j):
        nk = normal_of(planes, k)
        rate, room = dot(nk, u), dot(nk, y) + planes[k, PLANE_GAP]
        if rate * rate > _PARALLEL * sine:
            t = -room / rate
            if rate > 0.0 and t > low:
                low, at_low = t, k
            elif rate < 0.0 and t < high:
                high, at_high = t, k
        elif room < -slack:
            feasible = False
    if low > high:
        feasible = feasible and (low - high) * np.sqrt(sine) <= slack
    if low > 0.0:
        return along(y, low, u), i, j, at_low, feasible
    if high < 0.0:
        return along(y, high, u), i, j, at_high, feasible
    return y, i, j, -1, feasible


@inner
def nearest_inside(planes: Floats, count: int, goal: Vector) -> Solution:
    """Point nearest to ``goal`` with normal . y >= -gap for the first ``count`` planes.

    Parameters
    ----------
    planes
        (rows, SITE_WIDTH) as in layout.PLANE_*; gap is the anchor's distance from the plane [m].
    count
        Number of rows in use.
    goal
        Relative to the anchor [m].

    Returns
    -------
    tuple
        The point relative to the anchor, up to three active planes (-1: none), and whether there is any point inside
        all half-spaces. The anchor itself is inside whenever every gap is >= 0.
    """
    slack = 1e-12 * norm(goal) + 1e-16
    best: Solution = (goal, -1, -1, -1, True)
    for i in range(count):
        ni, gap = normal_of(planes, i), planes[i, PLANE_GAP]
        room = dot(ni, best[0]) + gap
        if room >= -slack:
            continue
        best = (along(goal, -gap - dot(ni, goal), ni), i, -1, -1, best[4])
        for j in range(i):
            if dot(normal_of(planes, j), best[0]) + planes[j, PLANE_GAP] < -slack:
                solution = _on_line(planes, i, j, goal, slack)
                best = (solution[0], solution[1], solution[2], solution[3], best[4] and solution[4])
    return best


@inner
def nearest_allowed(planes: Floats, count: int, goal: Vector) -> Solution:
    """Like ``nearest_inside``; an anchor that violates some planes and cannot get out of all of them may stay.

    ``planes`` (rows, SITE_WIDTH); ``goal`` relative to the anchor [m].
    """
    solution = nearest_inside(planes, count, goal)
    if not solution[4]:
        for k in range(count):
            planes[k, PLANE_GAP] = max(planes[k, PLANE_GAP], 0.0)
        solution = nearest_inside(planes, count, goal)
    return solution


@inlined
def set_loads(planes: Floats, count: int, goal: Vector, solution: Solution) -> float:
    """Write each active plane's multiplier: solution - goal = sum of load x normal. Returns the sum of the loads.

    ``planes`` (rows, SITE_WIDTH); ``goal`` relative to the anchor, and the loads, in [m].
    """
    for k in range(count):
        planes[k, PLANE_LOAD] = 0.0
    d = sub(solution[0], goal)
    i, j, k = solution[1], solution[2], solution[3]
    if i < 0:
        return 0.0
    ni = normal_of(planes, i)
    if j < 0:
        planes[i, PLANE_LOAD] = max(dot(d, ni), 0.0)
        return float(planes[i, PLANE_LOAD])
    nj = normal_of(planes, j)
    u = cross(ni, nj)
    if k < 0:
        sine = dot(u, u)
        planes[i, PLANE_LOAD] = max(dot(d, cross(nj, u)) / sine, 0.0)
        planes[j, PLANE_LOAD] = max(dot(d, cross(u, ni)) / sine, 0.0)
        return float(planes[i, PLANE_LOAD] + planes[j, PLANE_LOAD])
    nk = normal_of(planes, k)
    volume = dot(u, nk)
    planes[i, PLANE_LOAD] = max(dot(d, cross(nj, nk)) / volume, 0.0)
    planes[j, PLANE_LOAD] = max(dot(d, cross(nk, ni)) / volume, 0.0)
    planes[k, PLANE_LOAD] = max(dot(d, u) / volume, 0.0)
    return float(planes[i, PLANE_LOAD] + planes[j, PLANE_LOAD] + planes[k, PLANE_LOAD])
