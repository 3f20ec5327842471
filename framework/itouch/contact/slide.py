"""Move a god-object towards a goal without friction and without ever entering an object.

The probe's centre is a point; every object grown by the probe's radius is an obstacle. At the present position each
convex obstacle gives one half-space that is surely free of it: the plane through its nearest point. The best point of
all these half-spaces is reached along a straight line that meets nothing, whatever its length, so nothing can be
jumped over; then the planes are taken anew. Each move brings the centre nearer to the goal; where no move is left,
the goal is held back by exactly the surfaces that touch (Zilles and Salisbury 1995, Ruspini 1997, with all
constraints at once in place of one after the other).
"""

import numpy as np
from numba import njit

from itouch.contact.distance import distance
from itouch.contact.frames import rotate, to_local
from itouch.contact.halfspaces import Solution, nearest_inside, normal_of
from itouch.contact.layout import (
    FRAME_OBJECT,
    KIND_MESH,
    MAX_PLANES,
    PLANE_FEATURE,
    PLANE_FRAME,
    PLANE_GAP,
    PLANE_LOAD,
    PLANE_NORMAL,
    PLANE_OBJECT,
    PLANE_WIDTH,
    WORLD_KIND,
    ZERO,
)
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, sub

MAX_MOVES = 64
_RELATIVE, _ABSOLUTE = 1e-10, 1e-13  # a shorter move ends the search; of the distance to the goal, and [m]


@njit(cache=True, error_model="numpy")
def put_plane(planes: Floats, at: int, frame: int, obj: int, feature: int, normal: Vector, gap: float) -> None:
    """Fill one row of the scratch table of planes."""
    planes[at, PLANE_OBJECT] = obj
    planes[at, PLANE_FEATURE] = feature
    planes[at, PLANE_NORMAL] = normal[0]
    planes[at, PLANE_NORMAL + 1] = normal[1]
    planes[at, PLANE_NORMAL + 2] = normal[2]
    planes[at, PLANE_GAP] = gap
    planes[at, PLANE_LOAD] = 0.0
    planes[at, PLANE_FRAME] = frame


@njit(cache=True, error_model="numpy")
def place_for(planes: Floats, count: int, gap: float) -> int:
    """Row for one more plane: the next one, or in a full table that of the farthest plane if this one is nearer."""
    if count < MAX_PLANES:
        return count
    worst = 0
    for k in range(1, MAX_PLANES):
        if planes[k, PLANE_GAP] > planes[worst, PLANE_GAP]:
            worst = k
    return worst if planes[worst, PLANE_GAP] > gap else -1


@njit(cache=True, error_model="numpy")
def gather(world: Floats, frames: Floats, m: int, p: Vector, radius: float, reach: float, planes: Floats) -> int:
    """Planes of all primitives within ``reach`` of the probe's surface at ``p``; returns how many."""
    count = int(ZERO)
    for k in range(m):
        obj = int(frames[k, FRAME_OBJECT])
        if world[obj, WORLD_KIND] == KIND_MESH:
            continue
        depth, normal, feature = distance(world, obj, to_local(frames, k, p))
        gap = depth - radius
        if gap <= reach:
            at = place_for(planes, count, gap)
            if at >= 0:
                put_plane(planes, at, k, obj, feature, rotate(frames, k, normal), gap)
                count = max(count, at + 1)
    return count


@njit(cache=True, error_model="numpy")
def _onto_surface(
    world: Floats, frames: Floats, planes: Floats, count: int, active: int, p: Vector, goal: Vector, radius: float
) -> tuple[bool, Vector]:
    """Exact nearest point to the goal on one grown primitive, when it lies on the same side and all planes allow it."""
    k, obj = int(planes[active, PLANE_FRAME]), int(planes[active, PLANE_OBJECT])
    depth, normal, _ = distance(world, obj, to_local(frames, k, add(p, goal)))
    normal = rotate(frames, k, normal)
    if dot(normal, normal_of(planes, active)) < 0.5:
        return False, goal
    y = along(goal, radius - depth, normal)
    for q in range(count):
        if q != active and dot(normal_of(planes, q), y) + planes[q, PLANE_GAP] < 0.0:
            return False, goal
    return True, y


@njit(cache=True, error_model="numpy")
def slide(
    world: Floats, frames: Floats, m: int, start: Vector, goal: Vector, radius: float, planes: Floats
) -> tuple[Vector, int, Solution]:
    """Slide from ``start`` towards ``goal``; returns the place, and the planes there with their solution."""
    p = start
    count = int(ZERO)
    solution: Solution = ((0.0, 0.0, 0.0), -1, -1, -1, True)
    jumped = False
    for _ in range(MAX_MOVES):
        to_goal = sub(goal, p)
        length = norm(to_goal)
        count = gather(world, frames, m, p, radius, 2.0 * length + _ABSOLUTE, planes)
        solution = nearest_inside(planes, count, to_goal)
        y = solution[0]
        if not solution[4]:
            break
        if solution[1] < 0:
            return goal, count, solution
        if norm(y) <= _RELATIVE * length + _ABSOLUTE:
            break
        if solution[2] < 0 and not jumped:
            jumped, exact = _onto_surface(world, frames, planes, count, solution[1], p, to_goal, radius)
            p = add(p, exact if jumped else y)
        else:
            jumped = False
            p = add(p, y)
    return p, count, solution


@njit(cache=True, error_model="numpy")
def nearest_free(world: Floats, frames: Floats, m: int, hip: Vector, radius: float, planes: Floats) -> Vector:
    """Nearest place to ``hip`` where the probe touches no solid: ``hip`` itself, or pushed out of what it is in."""
    p, anchor, count = hip, hip, int(ZERO)
    found = np.empty(planes.shape)
    for _ in range(MAX_MOVES):
        fresh = gather(world, frames, m, p, radius, -_ABSOLUTE, found)
        if fresh == 0:
            break
        offset = sub(p, anchor)
        if count + fresh > MAX_PLANES:
            count, anchor, offset = int(ZERO), p, (0.0, 0.0, 0.0)
        for k in range(fresh):
            for c in range(PLANE_WIDTH):
                planes[count, c] = found[k, c]
            planes[count, PLANE_GAP] += -dot(normal_of(found, k), offset)
            count += 1
        solution = nearest_inside(planes, count, (0.0, 0.0, 0.0))
        if not solution[4]:  # opposed walls: leave by the newest planes alone
            count, anchor = int(ZERO), p
            worst = 0
            for k in range(fresh):
                if found[k, PLANE_GAP] < found[worst, PLANE_GAP]:
                    worst = k
            p = along(p, -found[worst, PLANE_GAP], normal_of(found, worst))
        else:
            p = add(anchor, solution[0])
    return p
