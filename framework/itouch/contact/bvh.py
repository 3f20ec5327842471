"""Bounding-volume hierarchy over triangles, in flat arrays.

A node is one row of float32: for each of its two children a box and a slab (mean normal n, and the bounds of n . x),
then for each child a reference and a count. With count 0 the child is a node, and the reference is its row; otherwise
it is a leaf, and the reference is the first of its ``count`` consecutive triangles. Boxes and slabs are rounded
outwards, so that they never hide a triangle; references are whole numbers that float32 holds exactly (below 2**24). On
a smooth surface a slab is far thinner than a box: it shows that a patch beside the contact does not reach into a probe.

Splits minimise the surface area heuristic over bins along the widest axis of the centroids (Wald, "On fast
construction of SAH-based bounding volume hierarchies", 2007).
"""

import numpy as np
from numpy.typing import NDArray

from itouch.blocks import Block
from itouch.contact.kernel_decorators import entry, inner, making
from itouch.contact.vectors import Floats

Floats32 = NDArray[np.float32]
Ints32 = NDArray[np.int32]

LEAF = 4  # greatest number of triangles in a leaf
BINS = 16
MAX_DEPTH = 60
TRIANGLE_WIDTH = 7
MAX_TRIANGLES = 8_000_000  # so that a reference stays below 2**24
# Of a child: the corners of its box, then mean normal and bounds of its slab.
_child = Block()
_CHILD_BOX, CHILD_NORMAL, CHILD_LOW, CHILD_HIGH = _child.parts(6, 3, 1, 1)
CHILD_WIDTH = _child.width
# Of a node: both children, then references and counts of both.
_node = Block()
_NODE_CHILDREN, CHILD_REF, CHILD_COUNT = _node.parts(2 * CHILD_WIDTH, 2, 2)
NODE_WIDTH = _node.width


@entry
def triangle_boxes(vertices: Floats, faces: Ints32) -> Floats32:
    """Box of each triangle, rounded outwards: (n, 6) lower then upper corner.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3); the box's corners are in [m].
    """
    boxes = np.empty((faces.shape[0], 6), np.float32)
    for t in range(faces.shape[0]):
        i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
        for c in range(3):
            x, y, z = vertices[i, c], vertices[j, c], vertices[k, c]
            low, high = min(x, min(y, z)), max(x, max(y, z))
            down, up = np.float32(low), np.float32(high)
            if down > low:
                down -= np.float32(1.2e-7) * abs(down) + np.float32(1e-44)
            if up < high:
                up += np.float32(1.2e-7) * abs(up) + np.float32(1e-44)
            boxes[t, c], boxes[t, c + 3] = down, up
    return boxes


@inner
def _put_child(nodes: Floats32, node: int, side: int, box: Floats32, ref: int, count: int) -> None:
    for c in range(6):
        nodes[node, CHILD_WIDTH * side + c] = box[c]
    for c in range(CHILD_NORMAL, CHILD_WIDTH):
        nodes[node, CHILD_WIDTH * side + c] = 0.0
    nodes[node, CHILD_REF + side] = ref
    nodes[node, CHILD_COUNT + side] = count


@inner
def _range_box(boxes: Floats32, start: int, end: int, box: Floats32, centres: Floats32) -> None:
    """Box of a range of triangles, and twice the box of its centroids."""
    for c in range(3):
        box[c] = centres[c] = np.inf
        box[c + 3] = centres[c + 3] = -np.inf
    for t in range(start, end):
        for c in range(3):
            low, high = boxes[t, c], boxes[t, c + 3]
            middle = low + high
            box[c], box[c + 3] = min(box[c], low), max(box[c + 3], high)
            centres[c], centres[c + 3] = min(centres[c], middle), max(centres[c + 3], middle)


@making
def _best_cut(boxes: Floats32, start: int, end: int, axis: int, low: float, scale: float, bins: Floats32) -> int:
    """Bin after which to cut for the least surface area heuristic; -1 if all fall into one bin."""
    counts = np.zeros(BINS, np.int64)
    for b in range(BINS):
        for c in range(3):
            bins[b, c], bins[b, c + 3] = np.inf, -np.inf
    for t in range(start, end):
        b = min(int((boxes[t, axis] + boxes[t, axis + 3] - low) * scale), BINS - 1)
        counts[b] += 1
        for c in range(3):
            bins[b, c] = min(bins[b, c], boxes[t, c])
            bins[b, c + 3] = max(bins[b, c + 3], boxes[t, c + 3])
    right_cost = np.empty(BINS)
    box = np.empty(6, np.float32)
    for pass_ in range(2):
        for c in range(3):
            box[c], box[c + 3] = np.inf, -np.inf
        n, best, cut = 0, np.inf, -1
        for i in range(BINS - 1):
            b = BINS - 1 - i if pass_ == 0 else i
            n += counts[b]
            for c in range(3):
                box[c], box[c + 3] = min(box[c], bins[b, c]), max(box[c + 3], bins[b, c + 3])
            x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
            cost = n * (x * y + y * z + z * x) if n > 0 else 0.0
            if pass_ == 0:
                right_cost[b] = cost
            elif 0 < n < end - start and cost + right_cost[b + 1] < best:
                best, cut = cost + right_cost[b + 1], b
    return cut


@inner
def _partition(
    boxes: Floats32, order: Ints32, start: int, end: int, axis: int, low: float, scale: float, cut: int
) -> int:
    """Bring the triangles of the bins up to ``cut`` to the front; returns where the others begin."""
    i, j = start, end - 1
    while i <= j:
        if min(int((boxes[i, axis] + boxes[i, axis + 3] - low) * scale), BINS - 1) <= cut:
            i += 1
            continue
        for c in range(6):
            boxes[i, c], boxes[j, c] = boxes[j, c], boxes[i, c]
        order[i], order[j] = order[j], order[i]
        j -= 1
    return i


@entry
def build(vertices: Floats, faces: Ints32) -> tuple[Floats32, Ints32]:
    """Build the hierarchy.

    Parameters
    ----------
    vertices
        (v, 3) [m], finite.
    faces
        (n, 3), 1 <= n <= MAX_TRIANGLES.

    Returns
    -------
    tuple
        Nodes (m, NODE_WIDTH), the root first; and the order of the faces in the leaves (n,).
    """
    n = faces.shape[0]
    boxes = triangle_boxes(vertices, faces)
    order = np.arange(n).astype(np.int32)
    nodes = np.empty((max(n, 2), NODE_WIDTH), np.float32)
    box, centres = np.empty(6, np.float32), np.empty(6, np.float32)
    bins = np.empty((BINS, 6), np.float32)
    stack = np.empty((4 * MAX_DEPTH, 5), np.int64)  # start, end, parent, side, depth
    used, top = 1, 0
    empty = np.full(6, np.inf).astype(np.float32)
    for side in range(2):
        _put_child(nodes, 0, side, empty, 0, 1)
        nodes[0, CHILD_COUNT + side] = 1.0
    stack[0] = (0, n, -1, 0, 0)
    top = 1
    while top > 0:
        top -= 1
        start, end, parent, side, depth = stack[top]
        _range_box(boxes, start, end, box, centres)
        count = end - start
        if count <= LEAF:
            _put_child(nodes, max(parent, 0), side, box, start, count)
            continue
        axis = 0
        for c in range(1, 3):
            if centres[c + 3] - centres[c] > centres[axis + 3] - centres[axis]:
                axis = c
        low, width = float(centres[axis]), float(centres[axis + 3] - centres[axis])
        middle = (start + end) // 2
        if width > 0.0 and depth < MAX_DEPTH // 2:
            scale = BINS * 0.9999 / width
            cut = _best_cut(boxes, start, end, axis, low, scale, bins)
            if cut >= 0:
                middle = _partition(boxes, order, start, end, axis, low, scale, cut)
        node = 0
        if parent >= 0:
            node, used = used, used + 1
            _put_child(nodes, parent, side, box, node, 0)
        stack[top] = (start, middle, node, 0, depth + 1)
        stack[top + 1] = (middle, end, node, 1, depth + 1)
        top += 2
    return nodes[:used].copy(), order


@inner
def _leaf_slab(vertices: Floats, triangles: Ints32, nodes: Floats32, node: int, side: int, normals: Floats) -> None:
    """Slab of a leaf, and its summed normal."""
    first, count = int(nodes[node, CHILD_REF + side]), int(nodes[node, CHILD_COUNT + side])
    base = CHILD_WIDTH * side
    x, y, z = 0.0, 0.0, 0.0
    for t in range(first, first + count):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        x, y, z = x + uy * vz - uz * vy, y + uz * vx - ux * vz, z + ux * vy - uy * vx
    size = np.sqrt(x * x + y * y + z * z)
    normals[2 * node + side, 0], normals[2 * node + side, 1], normals[2 * node + side, 2] = x, y, z
    if size == 0.0:
        return
    nodes[node, base + CHILD_NORMAL] = x / size
    nodes[node, base + CHILD_NORMAL + 1] = y / size
    nodes[node, base + CHILD_NORMAL + 2] = z / size
    low, high = np.inf, -np.inf
    for t in range(first, first + count):
        for corner in range(3):
            v = triangles[t, corner]
            level = 0.0
            for c in range(3):
                level += nodes[node, base + CHILD_NORMAL + c] * vertices[v, c]
            low, high = min(low, level), max(high, level)
    nodes[node, base + CHILD_LOW] = low - 1.3e-7 * abs(low)
    nodes[node, base + CHILD_HIGH] = high + 1.3e-7 * abs(high)


@inner
def _reach(nodes: Floats32, node: int, side: int, x: float, y: float, z: float, sign: float) -> float:
    """Greatest value (sign 1) or least (-1) of (x, y, z) . p over what a child holds, from its slab and box."""
    base = CHILD_WIDTH * side
    value = float(nodes[node, base + (CHILD_HIGH if sign > 0.0 else CHILD_LOW)])
    x -= nodes[node, base + CHILD_NORMAL]
    y -= nodes[node, base + CHILD_NORMAL + 1]
    z -= nodes[node, base + CHILD_NORMAL + 2]
    value += x * nodes[node, base + (3 if sign * x > 0.0 else 0)]
    value += y * nodes[node, base + (4 if sign * y > 0.0 else 1)]
    return float(value + z * nodes[node, base + (5 if sign * z > 0.0 else 2)])


@entry
def add_slabs(vertices: Floats, triangles: Ints32, nodes: Floats32) -> None:
    """Fill in the slabs, from the leaves up; the rows of children come after those of their parents.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH), ``nodes`` (m, NODE_WIDTH) [m] as `build` leaves
    them, filled in place.
    """
    normals = np.zeros((2 * nodes.shape[0], 3))
    for i in range(nodes.shape[0]):
        node = nodes.shape[0] - 1 - i
        for side in range(2):
            if nodes[node, CHILD_WIDTH * side] == np.inf:
                continue
            if nodes[node, CHILD_COUNT + side] > 0.0:
                _leaf_slab(vertices, triangles, nodes, node, side, normals)
                continue
            child, base = int(nodes[node, CHILD_REF + side]), CHILD_WIDTH * side
            size = 0.0
            for c in range(3):
                normals[2 * node + side, c] = normals[2 * child, c] + normals[2 * child + 1, c]
                size += normals[2 * node + side, c] ** 2
            if size == 0.0:
                continue
            for c in range(3):
                nodes[node, base + CHILD_NORMAL + c] = normals[2 * node + side, c] / np.sqrt(size)
            x, y, z = (
                nodes[node, base + CHILD_NORMAL],
                nodes[node, base + CHILD_NORMAL + 1],
                nodes[node, base + CHILD_NORMAL + 2],
            )
            low = min(_reach(nodes, child, 0, x, y, z, -1.0), _reach(nodes, child, 1, x, y, z, -1.0))
            high = max(_reach(nodes, child, 0, x, y, z, 1.0), _reach(nodes, child, 1, x, y, z, 1.0))
            nodes[node, base + CHILD_LOW] = low - 1.3e-7 * abs(low)
            nodes[node, base + CHILD_HIGH] = high + 1.3e-7 * abs(high)


@entry
def pack(vertices: Floats, faces: Ints32, order: Ints32) -> tuple[Floats, Ints32]:
    """Vertices and triangles in the order of the leaves, so that what is near in space is near in memory.

    Returns the vertices in use, (v, 3) [m], and the triangles, (n, TRIANGLE_WIDTH): three vertices, the index of the
    face as given, and room for the neighbours.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3), ``order`` (n,) the indices of the faces in the order of the leaves.
    """
    number = np.full(vertices.shape[0], -1, np.int32)
    packed = np.empty_like(vertices)
    triangles = np.empty((faces.shape[0], TRIANGLE_WIDTH), np.int32)
    used = 0
    for t in range(order.shape[0]):
        face = order[t]
        for c in range(3):
            v = faces[face, c]
            if number[v] < 0:
                number[v] = used
                for x in range(3):
                    packed[used, x] = vertices[v, x]
                used += 1
            triangles[t, c] = number[v]
        triangles[t, 3] = face
        for c in range(4, TRIANGLE_WIDTH):
            triangles[t, c] = -1
    return packed[:used].copy(), triangles
