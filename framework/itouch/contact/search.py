"""Searches in the hierarchy of a mesh: for the nearest triangle, and for one that reaches into the probe."""

import numpy as np

from itouch.contact.bvh import CHILD_COUNT, CHILD_HIGH, CHILD_LOW, CHILD_REF, CHILD_WIDTH, Floats32, Ints32
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.layout import SITE_WIDTH, STACK_KEY, STACK_NODE, STACK_ROWS
from itouch.contact.triangle import corner, nearest_of, plane_distance2
from itouch.contact.vectors import Floats, Vector, dot, sub


@inner
def box_distance2(nodes: Floats32, node: int, side: int, p: Vector) -> float:
    """Squared distance [m2] of a point (3,) [m] from the box of a child of a node; ``nodes`` (m, NODE_WIDTH)."""
    c = CHILD_WIDTH * side
    x = max(max(nodes[node, c] - p[0], p[0] - nodes[node, c + 3]), 0.0)
    y = max(max(nodes[node, c + 1] - p[1], p[1] - nodes[node, c + 4]), 0.0)
    z = max(max(nodes[node, c + 2] - p[2], p[2] - nodes[node, c + 5]), 0.0)
    return float(x * x + y * y + z * z)


@inner
def nearest(
    vertices: Floats, triangles: Ints32, nodes: Floats32, root: int, p: Vector, bound: float, hint: int, stack: Floats
) -> tuple[float, int, Vector]:
    """Find the triangle nearest to a point.

    Parameters
    ----------
    vertices, triangles, nodes, root
        The mesh: (v, 3) [m], (n, TRIANGLE_WIDTH), (m, NODE_WIDTH), and the row of its root.
    p
        The point, in the mesh's frame [m].
    bound
        Only triangles nearer than this count [m].
    hint
        A triangle that is probably near, or -1.
    stack
        Scratch: a site.

    Returns
    -------
    tuple
        Squared distance, triangle (-1: none within the bound) and its nearest point.
    """
    best, found, at = bound * bound, -1, p
    if hint >= 0:
        at = nearest_of(vertices, triangles, hint, p)
        d = sub(p, at)
        if dot(d, d) < best:
            best, found = dot(d, d), hint
    node, top = root, 0
    while True:
        d0, d1 = box_distance2(nodes, node, 0, p), box_distance2(nodes, node, 1, p)
        near = 0 if d0 <= d1 else 1
        following = -1
        for i in range(2):
            side = near if i == 0 else 1 - near
            away = d0 if side == 0 else d1
            if away >= best:
                break
            ref, count = int(nodes[node, CHILD_REF + side]), int(nodes[node, CHILD_COUNT + side])
            if count == 0:
                if following < 0:
                    following = ref
                else:
                    stack[top, STACK_KEY], stack[top, STACK_NODE] = away, ref
                    top += 1
                continue
            for t in range(ref, ref + count):
                if plane_distance2(vertices, triangles, t, p) >= best:
                    continue
                q = nearest_of(vertices, triangles, t, p)
                d = sub(p, q)
                square = dot(d, d)
                if square < best:
                    best, found, at = square, t, q
        if following >= 0:
            node = following
            continue
        while top > 0 and stack[top - 1, STACK_KEY] >= best:
            top -= 1
        if top == 0:
            break
        top -= 1
        node = int(stack[top, STACK_NODE])
    return best, found, at


@inner
def slab_distance(nodes: Floats32, node: int, side: int, p: Vector) -> float:
    """Distance [m] of a point (3,) [m] from a child's slab: a lower bound of its distance from the triangles.

    ``nodes`` (m, NODE_WIDTH): the hierarchy; ``node``, ``side``: the row of the parent, and which of its two children.
    """
    c = CHILD_WIDTH * side
    level = nodes[node, c + 6] * p[0] + nodes[node, c + 7] * p[1] + nodes[node, c + 8] * p[2]
    return float(max(level - nodes[node, c + CHILD_HIGH], nodes[node, c + CHILD_LOW] - level))


@inner
def intruder(
    vertices: Floats,
    triangles: Ints32,
    nodes: Floats32,
    root: int,
    p: Vector,
    radius: float,
    n: Vector,
    level: float,
    stack: Floats,
) -> int:
    """Nearest triangle within ``radius`` of ``p`` among those that reach above the plane n . x = level; -1 if none.

    If the plane touches the sphere from below, nothing under it can be within the radius; on a smooth surface that
    leaves next to nothing to search. With ``n`` = 0 and level -1 everything is searched.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH), ``nodes`` (m, NODE_WIDTH) [m], ``stack`` (rows,
    SITE_WIDTH) scratch; ``p``, ``radius`` and ``level`` [m].
    """
    best, found = radius * radius, -1
    node, top = root, 0
    while True:
        following = -1
        for side in range(2):
            away = box_distance2(nodes, node, side, p)
            if away >= best or slab_distance(nodes, node, side, p) >= radius:
                continue
            ref, count = int(nodes[node, CHILD_REF + side]), int(nodes[node, CHILD_COUNT + side])
            if count == 0:
                if following < 0:
                    following = ref
                else:
                    stack[top, STACK_KEY], stack[top, STACK_NODE] = away, ref
                    top += 1
                continue
            for t in range(ref, ref + count):
                if (
                    dot(n, corner(vertices, triangles[t, 0])) <= level
                    and dot(n, corner(vertices, triangles[t, 1])) <= level
                    and dot(n, corner(vertices, triangles[t, 2])) <= level
                ) or plane_distance2(vertices, triangles, t, p) >= best:
                    continue
                q = nearest_of(vertices, triangles, t, p)
                d = sub(p, q)
                square = dot(d, d)
                if square < best:
                    best, found = square, t
        if following >= 0:
            node = following
            continue
        while top > 0 and stack[top - 1, STACK_KEY] >= best:
            top -= 1
        if top == 0:
            break
        top -= 1
        node = int(stack[top, STACK_NODE])
    return found


@inner
def steepest(
    vertices: Floats, triangles: Ints32, nodes: Floats32, root: int, p: Vector, distance: float, stack: Floats
) -> int:
    """Find, of all triangles at the least ``distance`` from ``p``, the one whose plane is farthest from it.

    Where the nearest point is on an edge or a vertex, only this triangle tells the inside from the outside.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH), ``nodes`` (m, NODE_WIDTH) [m], ``stack`` (rows,
    SITE_WIDTH) scratch; ``p`` and ``distance`` [m].
    """
    limit = distance * (1.0 + 1e-9) + 1e-15
    limit *= limit
    best, found = -1.0, -1
    node, top = root, 0
    while True:
        for side in range(2):
            if box_distance2(nodes, node, side, p) > limit:
                continue
            ref, count = int(nodes[node, CHILD_REF + side]), int(nodes[node, CHILD_COUNT + side])
            if count == 0:
                stack[top, STACK_NODE] = ref
                top += 1
                continue
            for t in range(ref, ref + count):
                d = sub(p, nearest_of(vertices, triangles, t, p))
                if dot(d, d) <= limit:
                    up = plane_distance2(vertices, triangles, t, p)
                    if up > best:
                        best, found = up, t
        if top == 0:
            return found
        top -= 1
        node = int(stack[top, STACK_NODE])


@entry
def nearest_many(
    vertices: Floats,
    triangles: Ints32,
    nodes: Floats32,
    points: Floats,
    out_points: Floats,
    out_distances: Floats,
    out_faces: Ints32,
) -> None:
    """Nearest point, distance and face (as given) for each row of ``points``.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH), ``nodes`` (m, NODE_WIDTH) [m]; ``points`` and
    ``out_points`` (k, 3) [m], ``out_distances`` (k,) [m], ``out_faces`` (k,).
    """
    stack = np.empty((STACK_ROWS, SITE_WIDTH))
    for i in range(points.shape[0]):
        p = (points[i, 0], points[i, 1], points[i, 2])
        square, t, q = nearest(vertices, triangles, nodes, 0, p, np.inf, -1, stack)
        out_points[i, 0], out_points[i, 1], out_points[i, 2] = q
        out_distances[i] = np.sqrt(square)
        out_faces[i] = triangles[t, 3]
