"""The scratch table that one step of contact works on, and the tolerances of touch; rows are in layout.py."""

from itouch.contact import layout as at
from itouch.contact.bvh import Floats32, Ints32
from itouch.contact.kernel_decorators import inner
from itouch.contact.object_poses import set_frame
from itouch.contact.vectors import Floats, Vector, norm, place_of, sub

Mesh = tuple[Floats, Ints32, Floats32]
"""Vertices, triangles and nodes of all meshes together; see :mod:`itouch.contact.bvh`."""

TOLERANCE = 2e-6  # of the radius: a triangle that reaches less than this into the probe is ignored
TOUCH = 1e-10  # nearer than this is contact, whatever the size of the probe [m]
TOLERANCE_SKIN = 1e-2  # of the skin: the same for a surface without thickness


@inner
def site_rows(objects: int) -> int:
    """Rows of the table for a number of objects; the last MAX_PLANES are spare."""
    return max(at.STACK_ROWS, at.FRAME_FIRST + objects + 1) + at.MAX_PLANES


@inner
def empty_site(site: Floats) -> None:
    """Empty the table.

    ``site`` (rows, SITE_WIDTH), its lengths in [m].
    """
    site[at.ENDS, at.END_SEEDS] = at.SEED_FIRST
    site[at.ENDS, at.END_FRAMES] = at.FRAME_FIRST


@inner
def put_object(site: Floats, k: int, world: Floats, poses: Floats, last: Floats, obj: int, radius: float) -> bool:
    """Write one object's row with its poses of this step and of the last one; returns whether they differ.

    ``site`` (rows, SITE_WIDTH), written in row ``k``; ``world`` (objects, WORLD_WIDTH), ``poses`` (objects, 7) [m;
    quaternion w, x, y, z] and ``last`` alike; ``radius`` [m].
    """
    site[k, at.FRAME_OBJECT] = obj
    site[k, at.FRAME_KIND] = world[obj, at.WORLD_KIND]
    for c in range(3):
        site[k, at.FRAME_SIZE + c] = world[obj, at.WORLD_SIZE + c]
    skin = world[obj, at.WORLD_SKIN]
    site[k, at.FRAME_REACH] = max(radius, skin)
    site[k, at.FRAME_SLACK] = max(TOLERANCE * radius, TOLERANCE_SKIN * skin)
    site[k, at.FRAME_ROOT] = world[obj, at.WORLD_MESH]
    site[k, at.FRAME_BOUND] = world[obj, at.WORLD_BOUND]
    site[k, at.FRAME_SIDES] = world[obj, at.WORLD_SIDES]
    site[k, at.FRAME_STATIC] = world[obj, at.WORLD_STATIC_FRICTION]
    site[k, at.FRAME_DYNAMIC] = world[obj, at.WORLD_DYNAMIC_FRICTION]
    site[k, at.FRAME_SHADING] = world[obj, at.WORLD_SHADING]
    site[k, at.FRAME_MOVED] = 0.0
    set_frame(site, k, int(at.ZERO), poses, obj)
    for c in range(7):
        if poses[obj, c] != last[obj, c]:
            site[k, at.FRAME_MOVED] = 1.0
            set_frame(site, k, int(at.ONE), last, obj)
            return True
    return False


@inner
def put_near_objects(
    site: Floats, world: Floats, poses: Floats, last: Floats, p: Vector, radius: float, reach: float
) -> None:
    """Write the rows of all objects that a probe at ``p`` may meet within ``reach`` of its surface.

    ``site`` (rows, SITE_WIDTH); ``world`` (objects, WORLD_WIDTH), ``poses`` (objects, 7) [m; quaternion w, x, y, z]
    and ``last`` alike; ``p``, ``radius`` and ``reach`` [m].
    """
    end, slack = int(at.FRAME_FIRST + at.ZERO), 0.0
    for obj in range(world.shape[0]):
        place, old = place_of(poses, obj), place_of(last, obj)
        if norm(sub(place, p)) - world[obj, at.WORLD_BOUND] - norm(sub(place, old)) <= radius + reach:
            put_object(site, end, world, poses, last, obj, radius)
            slack = max(slack, site[end, at.FRAME_SLACK])
            end += 1
    site[at.ENDS, at.END_FRAMES] = end
    site[at.ENDS, at.END_TOUCH] = 2.0 * slack + TOUCH


@inner
def put_plane(site: Floats, count: int, frame: int, feature: int, normal: Vector, gap: float) -> int:
    """Add a plane; in a full table it replaces the farthest one if it is nearer. Returns the count.

    ``site`` (rows, SITE_WIDTH); ``gap``, the anchor's distance from the plane, in [m].
    """
    row = count
    if count >= at.MAX_PLANES:
        row = 0
        for k in range(1, at.MAX_PLANES):
            if site[k, at.PLANE_GAP] > site[row, at.PLANE_GAP]:
                row = k
        if site[row, at.PLANE_GAP] <= gap:
            return count
    site[row, at.PLANE_OBJECT] = site[frame, at.FRAME_OBJECT]
    site[row, at.PLANE_FEATURE] = feature
    site[row, at.PLANE_NORMAL] = normal[0]
    site[row, at.PLANE_NORMAL + 1] = normal[1]
    site[row, at.PLANE_NORMAL + 2] = normal[2]
    site[row, at.PLANE_GAP] = gap
    site[row, at.PLANE_LOAD] = 0.0
    site[row, at.PLANE_FRAME] = frame
    return max(count, row + 1)


@inner
def add_seed(site: Floats, frame: int, triangle: int, began: float) -> None:
    """Keep a triangle in view; in a full table it replaces the last one.

    ``site`` (rows, SITE_WIDTH); ``frame`` is the row of the mesh, ``triangle`` its index.
    """
    end = int(site[at.ENDS, at.END_SEEDS])
    for s in range(at.SEED_FIRST, end):
        if site[s, at.SEED_FRAME] == frame and site[s, at.SEED_TRIANGLE] == triangle:
            return
    row = min(end, at.SEED_LAST - 1)
    site[at.ENDS, at.END_SEEDS] = row + 1
    site[row, at.SEED_FRAME] = frame
    site[row, at.SEED_TRIANGLE] = triangle
    site[row, at.SEED_BEGAN] = began
