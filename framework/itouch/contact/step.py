"""One step of one probe: moving objects, proxy, friction, force, and what to remember."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.borrow import borrowed
from itouch.contact.compiling import entry, inner
from itouch.contact.distance import distance
from itouch.contact.frames import to_local, to_local_then, to_world
from itouch.contact.friction import coefficients, drag, first_touch
from itouch.contact.gather import touching
from itouch.contact.meshcast import off_triangle
from itouch.contact.push import pushed
from itouch.contact.report import clear, report, report_near
from itouch.contact.reset import nearest_free
from itouch.contact.site import Mesh, add_seed, empty_site, put_near_objects, put_object, site_rows
from itouch.contact.slide import slide
from itouch.contact.triangle import nearest_of
from itouch.contact.vectors import Floats, Vector, norm, put, sub, vector


@inner
def last_poses(memory: Floats, poses: Floats, last: Floats) -> None:
    """Unpack the poses of the last step; for a probe without a past, the present ones."""
    ready = memory[at.MEMORY_READY] > 0.0
    for obj in range(poses.shape[0]):
        for c in range(7):
            last[obj, c] = memory[at.MEMORY_POSES + 7 * obj + c] if ready else poses[obj, c]


@inner
def recall(site: Floats, mesh: Mesh | None, memory: Floats, old: Vector) -> None:
    """Take the triangles that were touched in the last step into view, with their normals as they were then."""
    if mesh is not None:
        for c in range(int(memory[at.MEMORY_COUNT])):
            obj, t = memory[at.MEMORY_CONTACTS + 2 * c], int(memory[at.MEMORY_CONTACTS + 2 * c + 1])
            for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
                if site[k, at.FRAME_OBJECT] == obj and site[k, at.FRAME_KIND] == at.KIND_MESH:
                    moved = site[k, at.FRAME_MOVED] > 0.0
                    q = to_local_then(site, k, old) if moved else to_local(site, k, old)
                    _, normal = off_triangle(mesh[0], mesh[1], t, q)
                    add_seed(site, k, t, normal)


@inner
def is_covered(site: Floats, mesh: Mesh | None, hip: Vector) -> bool:
    """Whether the HIP is plainly not free: inside a primitive, or nearer than the radius to a triangle in view."""
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            depth, _, _ = distance(site, k, to_local(site, k, hip))
            if depth < site[k, at.FRAME_REACH]:
                return True
    if mesh is not None:
        for s in range(at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])):
            k, t = int(site[s, at.SEED_FRAME]), int(site[s, at.SEED_TRIANGLE])
            q = to_local(site, k, hip)
            if norm(sub(q, nearest_of(mesh[0], mesh[1], t, q))) < site[k, at.FRAME_REACH]:
                return True
    return False


@inner
def rubs(site: Floats) -> bool:
    """Whether any near object has friction."""
    rough = False
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        rough = rough or site[k, at.FRAME_STATIC] > 0.0
    return rough


@inner
def follow(
    site: Floats,
    mesh: Mesh | None,
    world: Floats,
    poses: Floats,
    last: Floats,
    memory: Floats,
    hip: Vector,
    radius: float,
    near: float,
) -> tuple[Vector, int]:
    """Place of the proxy and its slip state, from the memory of the last step."""
    if memory[at.MEMORY_READY] == 0.0:
        put_near_objects(site, world, poses, last, hip, radius, np.inf)
        place, _, _ = slide(site, mesh, nearest_free(site, mesh, hip), hip)
        return place, at.SLIP_STICK
    old = vector(memory, at.MEMORY_PROXY)
    p = old
    in_contact = memory[at.MEMORY_COUNT] > 0.0
    if in_contact:
        k = int(at.FRAME_FIRST + at.ZERO)
        if put_object(site, k, world, poses, last, int(memory[at.MEMORY_CONTACTS]), radius):
            p = to_world(site, k, to_local_then(site, k, old))
    put_near_objects(site, world, poses, last, old, radius, norm(sub(p, old)) + max(2.0 * norm(sub(hip, p)), near))
    recall(site, mesh, memory, old)
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_MOVED] > 0.0:
            p = pushed(site, mesh, old, p)
            break
    if not (in_contact and rubs(site) and is_covered(site, mesh, hip)):
        place, count, solution = slide(site, mesh, p, hip)
        if solution[1] < 0:
            return place, at.SLIP_NONE
        static, _ = coefficients(site, count, sub(hip, place), solution)
        if static == 0.0:
            return place, at.SLIP_SLIDE
    if rubs(site) and touching(site, mesh, p) == 0:
        p = first_touch(site, mesh, p, hip)
    return drag(site, mesh, p, hip, int(memory[at.MEMORY_SLIP]))


@inner
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


@inner
def name_faces(world: Floats, mesh: Mesh | None, result: Floats) -> None:
    """Turn the triangles of mesh contacts into the numbers of the faces as they were given."""
    if mesh is not None:
        for c in range(int(result[at.RESULT_COUNT])):
            row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
            if world[int(result[row + at.CONTACT_OBJECT]), at.WORLD_KIND] == at.KIND_MESH:
                t = int(result[row + at.CONTACT_FEATURE])
                result[row + at.CONTACT_FEATURE] = mesh[1][t, 3]


@entry
def step(
    world: Floats,
    mesh: Mesh | None,
    poses: Floats,
    twists: Floats,
    stiffness: Floats,
    hip_at: Floats,
    radius: float,
    near: float,
    memory: Floats,
    result: Floats,
) -> None:
    """Move one probe by one step.

    Parameters
    ----------
    world, mesh
        From ``Geometry``.
    poses
        (n, 7): x, y, z, quaternion w, x, y, z of each object's frame.
    twists
        (n, 6): velocity of the frame's origin [m/s], angular velocity [rad/s], world frame.
    stiffness
        (n,) of each object as it is to be rendered now [N/m].
    hip_at
        (3,) centre of the probe's sphere as the device has it [m].
    radius
        Of the probe's sphere [m].
    near
        Objects within this distance of the probe's surface are looked for [m].
    memory
        From ``Geometry.new_memory``; all zero: this step is a reset.
    result
        (layout.RESULT_SIZE,), rewritten. For a HIP that is not finite it says "no contact", and the memory stays.
    """
    hip = vector(hip_at, 0)
    clear(result)
    put(result, at.RESULT_PROXY, vector(memory, at.MEMORY_PROXY))
    if not (np.isfinite(hip[0]) and np.isfinite(hip[1]) and np.isfinite(hip[2])):
        return
    own_site, own_last = np.empty((site_rows(world.shape[0]), at.SITE_WIDTH)), np.empty(poses.shape)
    site, last, meshes = borrowed(own_site), borrowed(own_last), borrowed(mesh)
    objects, now, past = borrowed(world), borrowed(poses), borrowed(memory)
    empty_site(site)
    last_poses(past, now, last)
    p, slip = follow(site, meshes, objects, now, last, past, hip, radius, near)
    answer = borrowed(result)
    put(answer, at.RESULT_PROXY, p)
    if report(site, meshes, now, borrowed(twists), borrowed(stiffness), p, hip, answer):
        answer[at.RESULT_SLIP] = slip
    report_near(site, meshes, p, radius, near, answer)
    remember(now, past, answer)
    name_faces(objects, meshes, answer)
    own_site[0, 0] = own_last[0, 0]  # a last use: the scratch must live until here
