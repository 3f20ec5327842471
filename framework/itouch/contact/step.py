"""One step of one probe: moving objects, proxy, friction, contacts, force, and what is near."""

import numpy as np
from numba import njit

from itouch.contact import layout as at
from itouch.contact.distance import distance
from itouch.contact.frames import rotate, set_frame, to_local, to_local_then, to_world
from itouch.contact.friction import coefficients, drag, first_touch, into_cone
from itouch.contact.halfspaces import nearest_inside, normal_of
from itouch.contact.slide import gather, nearest_free, place_for, put_plane, slide
from itouch.contact.vectors import Floats, Vector, add, along, cross, dot, norm, place_of, put, sub, vector

_TOUCH = 1e-7  # a plane nearer than this that the HIP presses on is reported as a contact [m]


@njit(cache=True, error_model="numpy")
def fill_frame(poses: Floats, last: Floats, obj: int, frames: Floats, k: int) -> bool:
    """Write an object's poses of this step and of the last one; returns whether they differ."""
    frames[k, at.FRAME_OBJECT] = obj
    frames[k, at.FRAME_MOVED] = 0.0
    set_frame(frames, k, 0, poses, obj)
    for c in range(7):
        if poses[obj, c] != last[obj, c]:
            frames[k, at.FRAME_MOVED] = 1.0
            set_frame(frames, k, 1, last, obj)
            return True
    return False


@njit(cache=True, error_model="numpy")
def near_frames(world: Floats, poses: Floats, last: Floats, p: Vector, reach: float, frames: Floats) -> int:
    """Fill the poses of all objects that a probe at ``p`` may meet within ``reach``; returns how many."""
    m = int(at.ZERO)
    for obj in range(world.shape[0]):
        place, old = place_of(poses, obj), place_of(last, obj)
        if norm(sub(place, p)) - world[obj, at.WORLD_BOUND] - norm(sub(place, old)) <= reach:
            fill_frame(poses, last, obj, frames, m)
            m += 1
    return m


@njit(cache=True, error_model="numpy")
def pushed(world: Floats, frames: Floats, m: int, old: Vector, p: Vector, radius: float, planes: Floats) -> Vector:
    """Place of the proxy after the objects have moved: out of the way of those that came, not through the others.

    In each object's own frame the proxy was at the old place; the plane that held it back there moves with the object.
    """
    count = int(at.ZERO)
    for k in range(m):
        obj = int(frames[k, at.FRAME_OBJECT])
        if world[obj, at.WORLD_KIND] == at.KIND_MESH:
            continue
        q = to_local_then(frames, k, old) if frames[k, at.FRAME_MOVED] > 0.0 else to_local(frames, k, old)
        depth, normal, feature = distance(world, obj, q)
        normal = rotate(frames, k, normal)
        gap = depth - radius + dot(normal, sub(p, to_world(frames, k, q)))
        place = place_for(planes, count, gap)
        if place >= 0:
            put_plane(planes, place, k, obj, feature, normal, gap)
            count = max(count, place + 1)
    solution = nearest_inside(planes, count, (0.0, 0.0, 0.0))
    return add(p, solution[0])


@njit(cache=True, error_model="numpy")
def report_near(world: Floats, frames: Floats, m: int, p: Vector, radius: float, near: float, result: Floats) -> None:
    """Write the nearest object within ``near`` of the probe's surface at ``p``."""
    best = np.inf
    result[at.RESULT_NEAREST] = -1.0
    for k in range(m):
        obj = int(frames[k, at.FRAME_OBJECT])
        if world[obj, at.WORLD_KIND] == at.KIND_MESH:
            continue
        depth, normal, _ = distance(world, obj, to_local(frames, k, p))
        gap = depth - radius
        if gap <= near and gap < best:
            best = gap
            normal = rotate(frames, k, normal)
            result[at.RESULT_NEAREST] = obj
            put(result, at.RESULT_NEAREST_POINT, along(p, -depth, normal))
            put(result, at.RESULT_NEAREST_NORMAL, normal)
    result[at.RESULT_DISTANCE] = max(best, 0.0)


@njit(cache=True, error_model="numpy")
def report_contacts(
    planes: Floats, count: int, p: Vector, hip: Vector, radius: float, total: float, result: Floats
) -> int:
    """Write up to four contacts, largest share first; returns how many."""
    filled = 0
    while filled < at.MAX_CONTACTS:
        best, load = -1, -1.0
        for k in range(count):
            pressed = dot(normal_of(planes, k), sub(p, hip)) > _TOUCH
            touching = planes[k, at.PLANE_LOAD] > 0.0 or (pressed and planes[k, at.PLANE_GAP] <= _TOUCH)
            if touching and planes[k, at.PLANE_LOAD] > load:
                best, load = k, planes[k, at.PLANE_LOAD]
        if best < 0:
            break
        to = at.RESULT_CONTACTS + filled * at.CONTACT_WIDTH
        n, gap = normal_of(planes, best), planes[best, at.PLANE_GAP]
        result[to + at.CONTACT_OBJECT] = planes[best, at.PLANE_OBJECT]
        result[to + at.CONTACT_FEATURE] = planes[best, at.PLANE_FEATURE]
        put(result, to + at.CONTACT_NORMAL, n)
        put(result, to + at.CONTACT_POINT, along(p, -radius - gap, n))
        result[to + at.CONTACT_PENETRATION] = max(dot(n, sub(p, hip)) - gap, 0.0)
        result[to + at.CONTACT_SHARE] = load / total
        planes[best, at.PLANE_LOAD] = -2.0
        planes[best, at.PLANE_GAP] = np.inf
        filled += 1
    return filled


@njit(cache=True, error_model="numpy")
def surface_velocity(poses: Floats, twists: Floats, obj: int, point: Vector) -> Vector:
    """Velocity of an object's material point; a twist is (v of the frame's origin, w), world frame."""
    spin = (twists[obj, 3], twists[obj, 4], twists[obj, 5])
    return add(place_of(twists, obj), cross(spin, sub(point, place_of(poses, obj))))


@njit(cache=True, error_model="numpy")
def report(
    world: Floats, frames: Floats, m: int, poses: Floats, twists: Floats, stiffness: Floats, p: Vector, hip: Vector,
    radius: float, planes: Floats, result: Floats,
) -> bool:
    """Write force, normal, contacts and velocity of the surface for a proxy at ``p``; returns whether it touches."""
    to_hip = sub(hip, p)
    count = gather(world, frames, m, p, radius, 2.0 * norm(to_hip) + _TOUCH, planes)
    solution = nearest_inside(planes, count, to_hip)
    lift = sub(solution[0], to_hip)
    size = norm(lift)
    if solution[1] < 0 or size == 0.0:
        return False
    static, _ = coefficients(world, planes, count, to_hip, solution)
    total, k_mean = 0.0, 0.0
    for k in range(count):
        total += planes[k, at.PLANE_LOAD]
        k_mean += planes[k, at.PLANE_LOAD] * stiffness[int(planes[k, at.PLANE_OBJECT])]
    if total == 0.0:
        return False
    k_mean /= total
    direction = (lift[0] / size, lift[1] / size, lift[2] / size)
    force = into_cone(along((0.0, 0.0, 0.0), -k_mean, to_hip), direction, static)
    put(result, at.RESULT_FORCE, force)
    put(result, at.RESULT_NORMAL, direction)
    result[at.RESULT_STIFFNESS] = k_mean
    result[at.RESULT_COUNT] = report_contacts(planes, count, p, hip, radius, total, result)
    first = at.RESULT_CONTACTS
    obj = int(result[first + at.CONTACT_OBJECT])
    result[at.RESULT_PRIMARY] = obj
    result[at.RESULT_PENETRATION] = result[first + at.CONTACT_PENETRATION]
    point = vector(result, first + at.CONTACT_POINT)
    put(result, at.RESULT_SURFACE_VELOCITY, surface_velocity(poses, twists, obj, point))
    return True


@njit(cache=True, error_model="numpy")
def clear(result: Floats) -> None:
    """Write what a probe far from everything feels."""
    result[:] = 0.0
    result[at.RESULT_PRIMARY] = -1.0
    result[at.RESULT_NEAREST] = -1.0
    result[at.RESULT_DISTANCE] = np.inf


@njit(cache=True, error_model="numpy")
def remember(poses: Floats, memory: Floats, result: Floats) -> None:
    """Keep what the next step starts from."""
    memory[at.MEMORY_READY] = 1.0
    put(memory, at.MEMORY_PROXY, vector(result, at.RESULT_PROXY))
    memory[at.MEMORY_SLIP] = result[at.RESULT_SLIP]
    memory[at.MEMORY_COUNT] = result[at.RESULT_COUNT]
    for c in range(at.MAX_CONTACTS):
        source, to = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH, at.MEMORY_CONTACTS + 2 * c
        memory[to] = result[source + at.CONTACT_OBJECT]
        memory[to + 1] = result[source + at.CONTACT_FEATURE]
    for obj in range(poses.shape[0]):
        for c in range(7):
            memory[at.MEMORY_POSES + 7 * obj + c] = poses[obj, c]


@njit(cache=True, error_model="numpy")
def last_poses(memory: Floats, poses: Floats) -> Floats:
    """Unpack the poses of the last step; for a probe without a past, the present ones."""
    last = np.empty(poses.shape)
    for obj in range(poses.shape[0]):
        for c in range(7):
            ready = memory[at.MEMORY_READY] > 0.0
            last[obj, c] = memory[at.MEMORY_POSES + 7 * obj + c] if ready else poses[obj, c]
    return last


@njit(cache=True, error_model="numpy")
def follow(
    world: Floats, poses: Floats, memory: Floats, hip: Vector, radius: float, near: float, frames: Floats,
    planes: Floats,
) -> tuple[Vector, int, int]:
    """Place of the proxy, its slip state and the number of near objects, from the memory of the last step."""
    last = last_poses(memory, poses)
    if memory[at.MEMORY_READY] == 0.0:
        m = near_frames(world, poses, last, hip, np.inf, frames)
        return nearest_free(world, frames, m, hip, radius, planes), at.SLIP_STICK, m
    old = vector(memory, at.MEMORY_PROXY)
    p = old
    touching = memory[at.MEMORY_COUNT] > 0.0
    if touching and fill_frame(poses, last, int(memory[at.MEMORY_CONTACTS]), frames, int(at.ZERO)):
        p = to_world(frames, int(at.ZERO), to_local_then(frames, int(at.ZERO), old))
    reach = radius + norm(sub(p, old)) + max(2.0 * norm(sub(hip, p)), near)
    m = near_frames(world, poses, last, old, reach, frames)
    for k in range(m):
        if frames[k, at.FRAME_MOVED] > 0.0:
            p = pushed(world, frames, m, old, p, radius, planes)
            break
    place, count, solution = slide(world, frames, m, p, hip, radius, planes)
    if solution[1] < 0:
        return place, at.SLIP_NONE, m
    static, _ = coefficients(world, planes, count, sub(hip, place), solution)
    if static == 0.0:
        return place, at.SLIP_SLIDE, m
    if not touching:
        p = first_touch(world, frames, m, p, hip, radius, planes)
    place, slip = drag(world, frames, m, p, hip, radius, int(memory[at.MEMORY_SLIP]), planes)
    return place, slip, m


@njit(cache=True, error_model="numpy")
def step(
    world: Floats, mesh: Floats | None, poses: Floats, twists: Floats, stiffness: Floats, hip_at: Floats,
    radius: float, near: float, memory: Floats, result: Floats,
) -> None:
    """One step of one probe; documented in docs/reference/contact-api.md."""
    hip = vector(hip_at, 0)
    clear(result)
    put(result, at.RESULT_PROXY, vector(memory, at.MEMORY_PROXY))
    if not (np.isfinite(hip[0]) and np.isfinite(hip[1]) and np.isfinite(hip[2])):
        return
    frames = np.empty((max(world.shape[0], 1), at.FRAME_WIDTH))
    planes = np.empty((at.MAX_PLANES, at.PLANE_WIDTH))
    p, slip, m = follow(world, poses, memory, hip, radius, near, frames, planes)
    put(result, at.RESULT_PROXY, p)
    if report(world, frames, m, poses, twists, stiffness, p, hip, radius, planes, result):
        result[at.RESULT_SLIP] = slip
    report_near(world, frames, m, p, radius, near, result)
    remember(poses, memory, result)
