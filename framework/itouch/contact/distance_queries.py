"""Distances that are asked for beside the proxy: of a point from one object, and of what lies beside a contact."""

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed, lent
from itouch.contact.distance import distance
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.meshcast import off_triangle
from itouch.contact.object_poses import rotate, to_local, to_world
from itouch.contact.scratch import Mesh, empty_site, put_object, site_rows
from itouch.contact.search import nearest, steepest
from itouch.contact.triangle import height
from itouch.contact.vectors import Floats, Vector, along, cross, dot, norm, place_of, sub, vector

#: Heights that differ by no more than this are level: it is rounding [m].
_ROUNDED = 1e-9
#: Greatest |cosine| between the surface's normal and the direction to an object that lies beside, not above.
_ASIDE = 0.35
#: How deep a step a fingertip bridges [m]: its pad is indented by about this where it is pressed.
BRIDGED = 1e-3
#: Distance [m] at which we test whether the surface continues, and that from which a point is off it.
_NEXT, _OFF = 1e-5, 1e-6
#: In how many directions it is looked where a surface ends, and how often the way there is halved.
_DIRECTIONS, _HALVED = 8, 16


@inner
def _mesh_distance(site: Floats, mesh: Mesh, k: int, q: Vector, within: float) -> tuple[float, Vector]:
    """Signed distance [m] of a point from a mesh, in its frame, and the outward direction; inf beyond ``within`` [m].

    ``site`` (rows, SITE_WIDTH), whose row ``k`` is the mesh's.
    """
    root = int(site[k, at.FRAME_ROOT])
    square, t, _ = nearest(mesh[0], mesh[1], mesh[2], root, q, within, -1, site)
    if t < 0:
        return np.inf, q
    t = steepest(mesh[0], mesh[1], mesh[2], root, q, np.sqrt(square), site)
    away, out = off_triangle(mesh[0], mesh[1], t, q)
    if site[k, at.FRAME_SIDES] != at.TWO_SIDED and height(mesh[0], mesh[1], t, q) < 0.0:
        return -away, (-out[0], -out[1], -out[2])
    return away, out


@entry
def point_distance(
    world: Floats, mesh: Mesh | None, poses: Floats, obj: int, point: Floats, within: float,
    scratch: tuple[Floats, Floats],
) -> tuple[float, Vector, Vector]:  # fmt: skip
    """Find how far a point is from the surface of an object.

    Parameters
    ----------
    world, mesh
        The shapes, from ``Geometry``.
    poses
        (n, 7): x, y, z [m], quaternion w, x, y, z of each object's frame.
    obj
        The number of the object; one that is not there is nowhere within reach.
    point
        (3,) [m], world frame.
    within
        How far to look [m]; only meshes are searched, so it matters for these alone.
    scratch
        From ``Geometry.new_scratch``.

    Returns
    -------
    tuple
        The distance [m], below 0 inside (behind the surface of an open mesh that has one side; never for one with two
        sides), infinite if there is no surface within reach; the surface's outward unit normal there, and the nearest
        point of the surface [m], both in the world frame.
    """
    if not 0 <= obj < world.shape[0]:
        return np.inf, (0.0, 0.0, 1.0), vector(point, 0)
    site, now = borrowed(scratch[0]), lent(poses)
    empty_site(site)
    k, p = int(at.FRAME_FIRST), vector(point, 0)
    put_object(site, k, borrowed(world), now, now, obj, 0.0)
    q = to_local(site, k, p)
    away, out = np.inf, q
    if site[k, at.FRAME_KIND] != at.KIND_MESH:
        away, out, _ = distance(site, k, q)
    elif mesh is not None:
        away, out = _mesh_distance(site, borrowed(mesh), k, q, within)
    normal = rotate(site, k, out)
    foot = along(p, -away, normal) if away < np.inf else p
    return away, normal, foot


@inner
def _off(
    site: Floats, objects: Floats, mesh: Mesh | None, now: Floats, obj: int, p: Vector, reach: float
) -> tuple[float, Vector]:
    """Return how far a point is from an object, signed, and the direction out of it; inf beyond ``reach`` of a mesh."""
    k = int(at.FRAME_FIRST)
    put_object(site, k, objects, now, now, obj, 0.0)
    far, out, q = np.inf, p, to_local(site, k, p)
    if objects[obj, at.WORLD_KIND] != at.KIND_MESH:
        far, out, _ = distance(site, k, q)
    elif mesh is not None:
        far, out = _mesh_distance(site, borrowed(mesh), k, q, reach)
    return far, rotate(site, k, out)


@inner
def _to_its_rim(
    site: Floats, objects: Floats, mesh: Mesh | None, now: Floats, ends: tuple[int, int], p: Vector, n: Vector,
    radius: float,
) -> float:  # fmt: skip
    """Return how far away [m] a neighbour counts that begins under the touched object: beyond the rim of this, and low.

    Arguments as in `_over_a_step`.  A mesh is not looked along: that would take too long.
    """
    own, other = ends
    best = np.inf
    if objects[own, at.WORLD_KIND] == at.KIND_MESH:
        return best
    first = (0.0, n[2], -n[1]) if abs(n[0]) < 0.5 else (n[1], -n[0], 0.0)
    first = along((0.0, 0.0, 0.0), 1.0 / norm(first), first)
    second = cross(n, first)
    for i in range(_DIRECTIONS):
        turn = 2.0 * np.pi * i / _DIRECTIONS
        u = along(along((0.0, 0.0, 0.0), np.cos(turn), first), np.sin(turn), second)
        if _off(site, objects, mesh, now, own, along(p, radius, u), radius)[0] < _OFF:
            continue
        on, beyond = 0.0, radius
        for _ in range(_HALVED):
            half = 0.5 * (on + beyond)
            if _off(site, objects, mesh, now, own, along(p, half, u), radius)[0] < _OFF:
                on = half
            else:
                beyond = half
        low = max(0.0, _off(site, objects, mesh, now, other, along(p, beyond, u), 2.0 * BRIDGED)[0])
        best = min(best, beyond + radius * low / BRIDGED)
    return best


@inner
def _over_a_step(
    site: Floats, objects: Floats, mesh: Mesh | None, now: Floats, ends: tuple[int, int], p: Vector, n: Vector,
    radius: float, from_edge: Vector,
) -> float:  # fmt: skip
    """Return how far away [m] a neighbour counts that does not lie level with the touched place; see `beside`.

    ``ends``: numbers of the touched object and of the other one; ``from_edge``: the way to the touched place from the
    nearest point of the other one [m].
    """
    own, other = ends
    reach, drop = 2.0 * radius + BRIDGED, dot(from_edge, n)
    c = along(p, radius, n)
    deep, m = _off(site, objects, mesh, now, other, c, reach)
    if deep >= reach:  # it has no point that the pad could touch
        return np.inf
    t = along(c, -deep, m)
    way = sub(t, p)
    below = -dot(way, n)
    if below > _ROUNDED and _off(site, objects, mesh, now, own, along(t, 0.5 * below, n), reach)[0] < -_ROUNDED:
        # what is nearest lies hidden
        return _to_its_rim(site, objects, mesh, now, ends, p, n, radius) if drop < BRIDGED else np.inf
    away = norm(along(from_edge, -drop, n)) + radius * drop / BRIDGED if drop > 0.0 else norm(from_edge)
    flat = along(way, below, n)
    size = max(norm(flat), _ROUNDED)
    if _off(site, objects, mesh, now, own, along(p, _NEXT / size, flat), reach)[0] < _OFF:
        return away  # the touched surface goes on towards the other one
    # the finger rolls over the rim of the touched object: the boundary comes to it, as near as both are to its ball
    gap = deep - radius
    away = min(away, gap * (2.0 * radius + gap) / max(norm(way), _ROUNDED))
    flat = along(way, -dot(way, m), m)
    size = max(norm(flat), _ROUNDED)
    if abs(_off(site, objects, mesh, now, other, along(t, -_NEXT / size, flat), reach)[0]) >= _OFF:
        return away
    # it is over the other one: where the ball touches that, the touched object is beside, as far away as its rim
    high = dot(from_edge, m)
    first = np.sqrt(max(0.0, radius * radius - norm(along(from_edge, -high, m)) ** 2)) + high - radius
    left = min(1.0, max(0.0, gap) / max(first, _ROUNDED))
    behind = max(0.0, _off(site, objects, mesh, now, own, t, reach)[0])
    return float(left * away - (1.0 - left) * behind)


@inner
def _away(site: Floats, k: int, mesh: Mesh, p: Vector, reach: float) -> tuple[float, Vector]:
    """Distance [m] of a point from a mesh, and the vector to it from the mesh's nearest point; inf beyond ``reach``."""
    square, found, q = nearest(*mesh, int(site[k, at.FRAME_ROOT]), to_local(site, k, p), reach, -1, site)
    way = sub(p, to_world(site, k, q))
    return (np.sqrt(square), way) if found >= 0 else (np.inf, way)


@entry
def beside(
    world: Floats, mesh: Mesh | None, poses: Floats, primary: int, point: Floats, normal: Floats, reach: float
) -> tuple[int, float]:
    """Find the object that lies beside a contact, and how far along the surface it begins.

    A fingertip is soft: where it is pressed its pad is indented by about `BRIDGED`, so that it bridges a low step.  A
    neighbour whose top is lower counts as farther away by ``reach`` for each `BRIDGED` that it is lower: one that is as
    low as that is not touched at all, whatever the contact's area, and one a few micrometres lower is as on level tops.
    A higher one is touched at its side, so that its height does not matter.  Where the finger rolls over the rim of the
    touched object, what counts is the way between its ball and the other object, which ends as both are touched; there
    the boundary is as far behind the ball's lowest place as it is before it once the other is the one that is touched.
    So nothing jumps when the contact goes from one to the other.  What lies under the touched object is not beside.

    Parameters
    ----------
    world, mesh, poses
        The objects; see ``itouch.contact``.
    primary
        The object that is touched.
    point, normal
        The touched point of its surface and the normal there, world frame, shape (3,).
    reach
        How far to look, the radius of the fingertip's ball [m].

    Returns
    -------
    tuple
        Object (-1: none) and its distance from the point [m]; below 0 where more of the finger is over it than over the
        one that is touched.
    """
    own_site = np.empty((site_rows(1), at.SITE_WIDTH))
    site, objects, now = borrowed(own_site), borrowed(world), borrowed(poses)
    empty_site(site)
    p, n, k = vector(point, 0), vector(normal, 0), int(at.FRAME_FIRST)
    best, found = reach, -1
    for obj in range(objects.shape[0]):
        if obj == primary or norm(sub(place_of(now, obj), p)) - objects[obj, at.WORLD_BOUND] >= reach:
            continue
        put_object(site, k, objects, now, now, obj, 0.0)
        far, way = np.inf, n
        if objects[obj, at.WORLD_KIND] != at.KIND_MESH:
            depth, local, _ = distance(site, k, to_local(site, k, p))
            far = max(0.0, depth)
            way = along((0.0, 0.0, 0.0), far, rotate(site, k, local))
        elif mesh is not None:
            far, way = _away(site, k, borrowed(mesh), p, reach)
        if far >= reach:
            continue
        drop = dot(way, n)
        if drop < -_ASIDE * far:
            continue
        if abs(drop) > _ROUNDED:
            far = _over_a_step(site, objects, mesh, now, (primary, obj), p, n, reach, way)
        if far < best:
            best, found = far, obj
    own_site[0, 0] = best  # a last use: the scratch must live until here
    return found, best
