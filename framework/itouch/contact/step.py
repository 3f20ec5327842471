"""One step of contact of one probe: moving objects, proxy, friction, force, and the memory for the next step."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed, lent
from itouch.contact.constraint_planes import touching
from itouch.contact.distance import distance
from itouch.contact.friction import Pressed, drag, first_touch, press
from itouch.contact.halfspaces import nearest_inside
from itouch.contact.kernel_decorators import entry, inlined, inner
from itouch.contact.layout import ZERO
from itouch.contact.meshcast import mesh_cast, place_then
from itouch.contact.object_poses import rotate, to_local, to_local_then, to_world
from itouch.contact.outcome import clear, report, report_near
from itouch.contact.reset import mesh_overlap, nearest_free
from itouch.contact.scratch import Mesh, add_seed, empty_site, put_near_objects, put_object, put_plane, site_rows
from itouch.contact.slide import slide
from itouch.contact.triangle import beneath, nearest_of, pierced
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, put, sub, vector

_PUSH_ROUNDS = 12


@inlined
def last_poses(memory: Floats, poses: Floats, last: Floats) -> None:
    """Unpack the poses of the last step into ``last``; in a probe's first step, the present poses.

    ``memory`` from `Geometry.new_memory`, (MEMORY_POSES + 7 objects,); ``poses`` and ``last`` (objects, 7) [m;
    quaternion].
    """
    ready = memory[at.MEMORY_READY] > 0.0
    for obj in range(poses.shape[0]):
        for c in range(7):
            last[obj, c] = memory[at.MEMORY_POSES + 7 * obj + c] if ready else poses[obj, c]


@inlined
def recall(site: Floats, mesh: Mesh | None, memory: Floats) -> None:
    """Bring the triangles that were touched in the last step into view.

    ``site`` (rows, SITE_WIDTH); ``memory`` (MEMORY_POSES + 7 objects,) [m].
    """
    for c in range(3):
        site[at.ENDS, at.END_OLD + c] = memory[at.MEMORY_PROXY + c]
    if mesh is not None:
        for c in range(int(memory[at.MEMORY_COUNT])):
            obj, t = memory[at.MEMORY_CONTACTS + 2 * c], int(memory[at.MEMORY_CONTACTS + 2 * c + 1])
            there = 0 <= t < mesh[1].shape[0]  # the memory may come from a file
            for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
                if there and site[k, at.FRAME_OBJECT] == obj and site[k, at.FRAME_KIND] == at.KIND_MESH:
                    add_seed(site, k, t, 1.0)


@inner
def _behind(site: Floats, mesh: Mesh, k: int, t: int, q: Vector) -> bool:
    """Whether a place that the straight way from the proxy reaches through a triangle cannot be reached round it.

    That the way leads through a triangle is not enough: a HIP that was pressed deep and left sideways is in free
    space, and a proxy that slid without friction would come to it over the edge.  A place straight behind the triangle
    is below the proxy wherever it slides, and one inside a solid is not free.

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's; ``q`` [m], mesh's frame.
    """
    if beneath(mesh[0], mesh[1], t, q):
        return True
    return bool(site[k, at.FRAME_SIDES] == at.SOLID and mesh_overlap(site, mesh, k, q)[0] < 0.0)


@inner
def is_covered(site: Floats, mesh: Mesh | None, p: Vector, hip: Vector) -> bool:
    """Whether the HIP is certainly not free, for a proxy at ``p``.

    That is: inside a primitive, nearer than the radius to a triangle in view, or on the other side of one that the way
    from the proxy leads through, where there is no way round it (`_behind`).

    ``site`` (rows, SITE_WIDTH); ``p`` and ``hip`` [m], world frame.
    """
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] != at.KIND_MESH:
            depth, _, _ = distance(site, k, to_local(site, k, hip))
            if depth < site[k, at.FRAME_REACH]:
                return True
    if mesh is not None:
        for s in range(at.SEED_FIRST, int(site[at.ENDS, at.END_SEEDS])):
            k, t = int(site[s, at.SEED_FRAME]), int(site[s, at.SEED_TRIANGLE])
            q = to_local(site, k, hip)
            foot = nearest_of(mesh[0], mesh[1], t, q)
            if norm(sub(q, foot)) < site[k, at.FRAME_REACH]:
                return True
            if pierced(mesh[0], mesh[1], t, to_local(site, k, p), q) and _behind(site, mesh, k, t, q):
                return True
    return False


@inner
def pushed(site: Floats, mesh: Mesh | None, p: Vector) -> Vector:
    """Position of the proxy after the objects have moved: pushed by those that came its way, not through the others.

    In each object's own frame the proxy is still at its old position; the plane that held it back there moves with the
    object.

    ``site`` (rows, SITE_WIDTH); ``p``, the position before, in [m], world frame.
    """
    count = int(ZERO)
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        if site[k, at.FRAME_KIND] == at.KIND_MESH:
            continue
        q = place_then(site, k)
        depth, normal, feature = distance(site, k, q)
        normal = rotate(site, k, normal)
        gap = depth - site[k, at.FRAME_REACH] + dot(normal, sub(p, to_world(site, k, q)))
        count = put_plane(site, count, k, feature, normal, gap)
    y = nearest_inside(site, count, (0.0, 0.0, 0.0))[0]
    if mesh is not None:
        for _ in range(_PUSH_ROUNDS):
            before = count
            for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
                if site[k, at.FRAME_KIND] == at.KIND_MESH:
                    q = place_then(site, k)
                    step = sub(to_local(site, k, add(p, y)), q)
                    length = norm(step)
                    if length < 1e-14:
                        continue
                    way = along((0.0, 0.0, 0.0), 1.0 / length, step)
                    hit = mesh_cast(site, mesh, k, q, way, length)
                    if hit[1] >= 0:
                        normal = rotate(site, k, hit[2])
                        gap = hit[3] + dot(normal, sub(p, to_world(site, k, q)))
                        add_seed(site, k, hit[1], 0.0)
                        count = put_plane(site, count, k, hit[1], normal, gap)
            if count == before:
                break
            y = nearest_inside(site, count, (0.0, 0.0, 0.0))[0]
    return add(p, y)


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
) -> tuple[Vector, int, Pressed]:
    """Return the proxy's new position, its slip state and what holds it, from the memory of the last step.

    ``site`` (rows, SITE_WIDTH); other arrays as in `step`; ``hip``, ``radius`` and ``near`` [m].
    """
    if memory[at.MEMORY_READY] == 0.0:
        put_near_objects(site, world, poses, last, hip, radius, np.inf)
        place, _ = slide(site, mesh, nearest_free(site, mesh, hip), hip)
        return place, at.SLIP_STICK, press(site, mesh, place, hip)
    old = vector(memory, at.MEMORY_PROXY)
    p = old
    in_contact = memory[at.MEMORY_COUNT] > 0.0
    if in_contact:
        k = int(at.FRAME_FIRST + at.ZERO)
        if put_object(site, k, world, poses, last, int(memory[at.MEMORY_CONTACTS]), radius):
            p = to_world(site, k, to_local_then(site, k, old))
    way = norm(sub(hip, p))
    put_near_objects(site, world, poses, last, old, radius, norm(sub(p, old)) + way + max(way, near))
    recall(site, mesh, memory)
    rough = False
    for k in range(at.FRAME_FIRST, int(site[at.ENDS, at.END_FRAMES])):
        rough = rough or site[k, at.FRAME_STATIC] > 0.0
        if site[k, at.FRAME_MOVED] > 0.0:
            p = pushed(site, mesh, p)
            break
    if not (in_contact and rough and is_covered(site, mesh, p, hip)):
        place, solution = slide(site, mesh, p, hip)
        if solution[1] < 0:
            return place, at.SLIP_NONE, (0, solution, 0.0, 0.0)
        if not rough:
            return place, at.SLIP_SLIDE, press(site, mesh, place, hip)
        if touching(site, mesh, p) == 0:
            p = first_touch(site, mesh, p, hip)
    return drag(site, mesh, p, hip, int(memory[at.MEMORY_SLIP]))


@inlined
def remember(poses: Floats, memory: Floats, result: Floats) -> None:
    """Write to the memory what the next step starts from.

    ``poses`` (objects, 7) [m; quaternion w, x, y, z]; ``memory`` (MEMORY_POSES + 7 objects,) is written, ``result``
    (RESULT_SIZE,) read.
    """
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
    """Replace the triangles of mesh contacts by the indices of the faces as they were given.

    ``world`` (objects, WORLD_WIDTH), ``result`` (RESULT_SIZE,): the index of a triangle becomes that of its face.
    """
    if mesh is not None:
        for c in range(int(result[at.RESULT_COUNT])):
            row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
            if world[int(result[row + at.CONTACT_OBJECT]), at.WORLD_KIND] == at.KIND_MESH:
                t = int(result[row + at.CONTACT_FEATURE])
                result[row + at.CONTACT_FEATURE] = mesh[1][t, 3]


@inner
def advance(
    site: Floats,
    mesh: Mesh | None,
    world: Floats,
    poses: Floats,
    last: Floats,
    twists: Floats,
    stiffness: Floats,
    hip: Vector,
    radius: float,
    near: float,
    memory: Floats,
    result: Floats,
) -> None:
    """Move one probe by one step; like ``step``, but the caller provides the scratch: a site and room for last poses.

    ``site`` (rows, SITE_WIDTH), ``last`` (objects, 7) scratch; other arrays as in `step`; ``hip``, ``radius`` and
    ``near`` [m].
    """
    clear(result)
    put(result, at.RESULT_PROXY, vector(memory, at.MEMORY_PROXY))
    if not (np.isfinite(hip[0]) and np.isfinite(hip[1]) and np.isfinite(hip[2])):
        return
    empty_site(site)
    last_poses(memory, poses, last)
    p, slip, pressed = follow(site, mesh, world, poses, last, memory, hip, radius, near)
    put(result, at.RESULT_PROXY, p)
    if report(site, mesh, poses, twists, stiffness, p, hip, pressed, result):
        result[at.RESULT_SLIP] = slip
    report_near(site, mesh, p, radius, near, result)
    remember(poses, memory, result)
    name_faces(world, mesh, result)


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
) -> int:
    """Move one probe by one step; return 0.

    Parameters
    ----------
    world, mesh
        From ``Geometry``.
    poses
        (n, 7): x, y, z, quaternion w, x, y, z of each object's frame.
    twists
        (n, 6): velocity of the frame's origin [m/s], angular velocity [rad/s], world frame.
    stiffness
        (n,) stiffness with which each object is rendered now [N/m].
    hip_at
        (3,) centre of the probe's sphere as the device reports it [m].
    radius
        Radius of the probe's sphere [m].
    near
        Objects within this distance of the probe's surface are looked for [m].
    memory
        From ``Geometry.new_memory``; if it is all zero, this step is a reset.
    result
        (layout.RESULT_SIZE,), rewritten. For a HIP that is not finite it says "no contact", and the memory is left
        unchanged.
    """
    own_site, own_last = np.empty((site_rows(world.shape[0]), at.SITE_WIDTH)), np.empty(poses.shape)
    advance(
        borrowed(own_site),
        borrowed(mesh),
        borrowed(world),
        borrowed(poses),
        borrowed(own_last),
        borrowed(twists),
        borrowed(stiffness),
        vector(hip_at, 0),
        radius,
        near,
        borrowed(memory),
        borrowed(result),
    )
    own_site[0, 0] = own_last.size  # a last use: the scratch must live until here
    return 0


@inner
def _fits(world: Floats, memory: Floats) -> bool:
    """Whether a memory can be one of a step among these objects: one from a file may have any numbers.

    ``world`` (objects, WORLD_WIDTH), ``memory`` (MEMORY_POSES + 7 objects,) [m].
    """
    count = memory[at.MEMORY_COUNT]
    if not (0.0 <= count <= at.MAX_CONTACTS and count == np.floor(count)):
        return False
    for c in range(int(count)):
        if not 0.0 <= memory[at.MEMORY_CONTACTS + 2 * c] < world.shape[0]:
            return False
    return bool(at.SLIP_NONE <= memory[at.MEMORY_SLIP] <= at.SLIP_SLIDE)


@inlined
def _check_sizes(
    world: Floats, poses: Floats, twists: Floats, stiffness: Floats, hip_at: Floats, memory: Floats, result: Floats,
    scratch: tuple[Floats, Floats],
) -> None:  # fmt: skip
    """Refuse arrays that are smaller than a step writes or reads, whoever made them; sizes as in `step_within`."""
    n = world.shape[0]
    if memory.shape[0] < at.MEMORY_POSES + 7 * n:
        raise ValueError("the proxy's memory is too small: it takes Geometry.memory_size() numbers")
    if result.shape[0] < at.RESULT_SIZE:
        raise ValueError("the result of a step is too small: it takes FOUND numbers")
    if hip_at.shape[0] < 3:
        raise ValueError("a place is 3 numbers")
    if poses.shape[0] < n or poses.shape[1] < 7 or twists.shape[0] < n or twists.shape[1] < 6 or stiffness.shape[0] < n:
        raise ValueError("poses (n, 7), twists (n, 6) and stiffness (n,) are those of all objects")
    site, last = scratch
    if site.shape[0] < site_rows(n) or site.shape[1] != at.SITE_WIDTH or last.shape[0] < n or last.shape[1] < 7:
        raise ValueError("the scratch is that of another geometry: it comes from Geometry.new_scratch()")


@entry
def step_within(
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
    scratch: tuple[Floats, Floats],
) -> int:
    """Move one probe by one step, as ``step`` does, and return 0; it makes no arrays.

    A memory that no step has written, with a number of an object that is not there, is taken as one that is all zero.
    ``scratch`` from ``Geometry.new_scratch``; all other arguments as in ``step``: arrays (objects, ...), (3,),
    (MEMORY_POSES + 7 objects,) and (RESULT_SIZE,), ``radius`` and ``near`` [m].

    Raises
    ------
    ValueError
        If an array is smaller than that: compiled code would write beyond its end.
    """
    _check_sizes(world, poses, twists, stiffness, hip_at, memory, result, scratch)
    if not _fits(world, memory):
        memory[at.MEMORY_READY] = 0.0
    advance(
        borrowed(scratch[0]),
        borrowed(mesh),
        borrowed(world),
        lent(poses),
        borrowed(scratch[1]),
        lent(twists),
        lent(stiffness),
        vector(hip_at, 0),
        radius,
        near,
        borrowed(memory),
        borrowed(result),
    )
    return 0


@entry
def follow_path(
    world: Floats,
    mesh: Mesh | None,
    poses: Floats,
    twists: Floats,
    stiffness: Floats,
    hips: Floats,
    radius: float,
    memory: Floats,
    result: Floats,
    forces: Floats,
) -> None:
    """Step along the rows of ``hips`` (n, 3) with stationary objects, and write the forces (n, 3).

    Positions and ``radius`` [m], forces [N]; other arrays as in `step`.
    """
    own_site, own_last = np.empty((site_rows(world.shape[0]), at.SITE_WIDTH)), np.empty(poses.shape)
    site, last, meshes, objects = borrowed(own_site), borrowed(own_last), borrowed(mesh), borrowed(world)
    now, turns, springs, past = borrowed(poses), borrowed(twists), borrowed(stiffness), borrowed(memory)
    answer, path, out = borrowed(result), borrowed(hips), borrowed(forces)
    for i in range(path.shape[0]):
        hip = (path[i, 0], path[i, 1], path[i, 2])
        advance(site, meshes, objects, now, last, turns, springs, hip, radius, 0.0, past, answer)
        out[i, 0], out[i, 1], out[i, 2] = vector(answer, at.RESULT_FORCE)
    own_site[0, 0] = own_last.size  # a last use: the scratch must live until here
