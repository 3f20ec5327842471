"""The result of a step of contact: contacts, force, penetration, velocity of the surface, and what is near."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.distance import distance
from itouch.contact.force_shading import NORMAL, shaded, turned
from itouch.contact.friction import Pressed, into_cone
from itouch.contact.halfspaces import normal_of
from itouch.contact.kernel_decorators import inner
from itouch.contact.object_poses import rotate, to_local
from itouch.contact.scratch import Mesh
from itouch.contact.search import nearest
from itouch.contact.triangle import height
from itouch.contact.vectors import Floats, Vector, add, along, cross, dot, norm, place_of, put, sub, vector

_PRESSED = 1e-12  # a touching plane that the HIP lies deeper behind than this is a contact [m]


@inner
def report_near(site: Floats, mesh: Mesh | None, p: Vector, radius: float, near: float, result: Floats) -> None:
    """Write the nearest object within ``near`` of the probe's surface at ``p``; in contact the one that is touched.

    ``site`` (rows, SITE_WIDTH), ``result`` (RESULT_SIZE,); ``p``, ``radius`` and ``near`` [m].
    """
    best = np.inf
    if result[at.RESULT_COUNT] > 0.0:
        best = 0.0
        first = at.RESULT_CONTACTS
        result[at.RESULT_NEAREST] = result[at.RESULT_PRIMARY]
        put(result, at.RESULT_NEAREST_POINT, vector(result, first + at.CONTACT_POINT))
        put(result, at.RESULT_NEAREST_NORMAL, vector(result, first + at.CONTACT_NORMAL))
    elif near > 0.0:
        for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
            obj = int(site[k, at.FRAME_OBJECT])
            q = to_local(site, k, p)
            depth, normal = np.inf, q
            if site[k, at.FRAME_KIND] != at.KIND_MESH:
                depth, normal, _ = distance(site, k, q)
            elif mesh is not None:
                bound = min(near + site[k, at.FRAME_REACH], best + site[k, at.FRAME_REACH])
                root = int(site[k, at.FRAME_ROOT])
                square, t, foot = nearest(mesh[0], mesh[1], mesh[2], root, q, bound, -1, site)
                behind = site[k, at.FRAME_SIDES] != at.TWO_SIDED and height(mesh[0], mesh[1], t, q) < 0.0
                if t >= 0 and not behind and square > 0.0:
                    depth = np.sqrt(square)
                    normal = along((0.0, 0.0, 0.0), 1.0 / depth, sub(q, foot))
            gap = depth - radius
            if gap <= near and gap < best:
                best = gap
                normal = rotate(site, k, normal)
                result[at.RESULT_NEAREST] = obj
                put(result, at.RESULT_NEAREST_POINT, along(p, -depth, normal))
                put(result, at.RESULT_NEAREST_NORMAL, normal)
    result[at.RESULT_DISTANCE] = max(best, 0.0)


@inner
def _reported(site: Floats, k: int, filled: int, result: Floats) -> bool:
    """Whether a contact with the same object and normal is reported already (of a neighbour in a flat face)."""
    for c in range(filled):
        row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
        same = result[row + at.CONTACT_OBJECT] == site[k, at.PLANE_OBJECT]
        if same and dot(vector(result, row + at.CONTACT_NORMAL), normal_of(site, k)) > 1.0 - 1e-9:
            return True
    return False


@inner
def report_contacts(site: Floats, count: int, p: Vector, hip: Vector, total: float, result: Floats) -> int:
    """Write up to four contacts, largest share first; returns how many.

    ``site`` (rows, SITE_WIDTH), of which the first ``count`` rows are planes, ``result`` (RESULT_SIZE,); ``p``,
    ``hip`` and the loads' ``total`` [m].
    """
    filled = int(at.ZERO)
    for _ in range(count):
        best, load = int(at.ZERO) - 1, -1.0
        for k in range(count):
            pressed = dot(normal_of(site, k), sub(p, hip)) > _PRESSED
            if (pressed or site[k, at.PLANE_LOAD] > 0.0) and site[k, at.PLANE_LOAD] > load:
                best, load = k, site[k, at.PLANE_LOAD]
        if best < 0 or filled == at.MAX_CONTACTS:
            break
        n, gap = normal_of(site, best), site[best, at.PLANE_GAP]
        reach = site[int(site[best, at.PLANE_FRAME]), at.FRAME_REACH]
        site[best, at.PLANE_LOAD] = -2.0
        site[best, at.PLANE_GAP] = np.inf
        if load == 0.0 and _reported(site, best, filled, result):
            continue
        to = at.RESULT_CONTACTS + filled * at.CONTACT_WIDTH
        result[to + at.CONTACT_OBJECT] = site[best, at.PLANE_OBJECT]
        result[to + at.CONTACT_FEATURE] = site[best, at.PLANE_FEATURE]
        put(result, to + at.CONTACT_NORMAL, n)
        put(result, to + at.CONTACT_POINT, along(p, -reach - gap, n))
        result[to + at.CONTACT_PENETRATION] = max(dot(n, sub(p, hip)) - gap, 0.0)
        result[to + at.CONTACT_SHARE] = load / total
        filled += 1
    return filled


@inner
def surface_velocity(poses: Floats, twists: Floats, obj: int, point: Vector) -> Vector:
    """Velocity of an object's material point; a twist is (v of the frame's origin, w), world frame.

    ``poses`` (objects, 7) [m; quaternion w, x, y, z], ``twists`` (objects, 6) [m/s, rad/s]; ``point`` [m], the
    velocity [m/s].
    """
    spin = (twists[obj, 3], twists[obj, 4], twists[obj, 5])
    return add(place_of(twists, obj), cross(spin, sub(point, place_of(poses, obj))))


@inner
def report(
    site: Floats,
    mesh: Mesh | None,
    poses: Floats,
    twists: Floats,
    stiffness: Floats,
    p: Vector,
    hip: Vector,
    pressed: Pressed,
    result: Floats,
) -> bool:
    """Write force, normal, contacts and velocity of the surface for a proxy at ``p``; returns whether it touches.

    ``site`` (rows, SITE_WIDTH), ``poses`` (objects, 7) [m; quaternion w, x, y, z], ``twists`` (objects, 6) [m/s,
    rad/s], ``stiffness`` (objects,) [N/m], ``result`` (RESULT_SIZE,); ``p`` and ``hip`` [m].
    """
    count, solution, static, _ = pressed
    to_hip = sub(hip, p)
    lift = sub(solution[0], to_hip)
    size = norm(lift)
    if solution[1] < 0 or size == 0.0:
        return False
    total, k_mean = 0.0, 0.0
    for k in range(count):
        total += site[k, at.PLANE_LOAD]
        k_mean += site[k, at.PLANE_LOAD] * stiffness[int(site[k, at.PLANE_OBJECT])]
    if total == 0.0:
        return False
    k_mean /= total
    direction = (lift[0] / size, lift[1] / size, lift[2] / size)
    force = into_cone(along((0.0, 0.0, 0.0), -k_mean, to_hip), direction, static)
    if mesh is not None and mesh[0].shape[1] > NORMAL:
        smooth = shaded(site, mesh, count, p, direction)
        force, direction = turned(force, direction, smooth), smooth
    put(result, at.RESULT_FORCE, force)
    put(result, at.RESULT_NORMAL, direction)
    result[at.RESULT_STIFFNESS] = k_mean
    result[at.RESULT_COUNT] = report_contacts(site, count, p, hip, total, result)
    first = at.RESULT_CONTACTS
    obj = int(result[first + at.CONTACT_OBJECT])
    result[at.RESULT_PRIMARY] = obj
    result[at.RESULT_PENETRATION] = result[first + at.CONTACT_PENETRATION]
    point = vector(result, first + at.CONTACT_POINT)
    put(result, at.RESULT_SURFACE_VELOCITY, surface_velocity(poses, twists, obj, point))
    return True


@inner
def clear(result: Floats) -> None:
    """Write the result of a probe that is far from everything.

    ``result`` (RESULT_SIZE,): forces [N], lengths [m], velocities [m/s].
    """
    for i in range(at.RESULT_SIZE):
        result[i] = 0.0
    result[at.RESULT_PRIMARY] = -1.0
    result[at.RESULT_NEAREST] = -1.0
    result[at.RESULT_DISTANCE] = np.inf
