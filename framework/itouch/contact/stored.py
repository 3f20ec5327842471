"""Whether tables of a mesh that were stored can be searched: the kernels that follow their references do not check."""

import numpy as np

from itouch.contact import bvh
from itouch.contact.bvh import CHILD_COUNT, CHILD_REF, CHILD_WIDTH, Floats32, Ints32
from itouch.contact.kernel_decorators import entry, inner, making
from itouch.contact.neighbours import NEIGHBOUR
from itouch.contact.vectors import Floats


@inner
def _holds_triangle(vertices: Floats, triangles: Ints32, t: int, nodes: Floats32, node: int, side: int) -> bool:
    """Whether all corners of a triangle lie in the box of a child; NaN lies nowhere."""
    for corner in range(3):
        for c in range(3):
            x, at = vertices[triangles[t, corner], c], CHILD_WIDTH * side + c
            if not (nodes[node, at] <= x and x <= nodes[node, at + 3]):
                return False
    return True


@inner
def _holds_node(nodes: Floats32, node: int, side: int, child: int) -> bool:
    """Whether the box of a child holds the two boxes of the node that it refers to."""
    for other in range(2):
        for c in range(3):
            at, below = CHILD_WIDTH * side + c, CHILD_WIDTH * other + c
            if not (nodes[node, at] <= nodes[child, below] and nodes[child, below + 3] <= nodes[node, at + 3]):
                return False
    return True


@making
def _are_rows(vertices: Floats, triangles: Ints32) -> bool:
    """Whether all indices of the triangles are of rows that exist, and each face is that of one triangle."""
    count = triangles.shape[0]
    seen = np.zeros(count, np.bool_)
    for t in range(count):
        for corner in range(3):
            if not 0 <= triangles[t, corner] < vertices.shape[0]:
                return False
        for other in range(NEIGHBOUR, bvh.TRIANGLE_WIDTH):
            if not -1 <= triangles[t, other] < count:
                return False
        face = triangles[t, 3]
        if not 0 <= face < count or seen[face]:
            return False
        seen[face] = True
    return True


@making
def _is_tree(vertices: Floats, triangles: Ints32, nodes: Floats32) -> bool:
    """Whether the nodes are a tree with the root first, with each triangle in one leaf and inside the boxes above it.

    The tree is no deeper than one that is built, for which the searches' stack is deep enough.
    """
    rows, count = nodes.shape[0], triangles.shape[0]
    depth = np.full(rows, -1, np.int32)
    seen = np.zeros(count, np.bool_)
    depth[0], held = 0, 0
    for node in range(rows):
        if depth[node] < 0:  # nothing refers to it: rows of children come after those of their parents
            return False
        for side in range(2):
            given, size = nodes[node, CHILD_REF + side], nodes[node, CHILD_COUNT + side]
            if not (0.0 <= given <= bvh.MAX_TRIANGLES and 0.0 <= size <= bvh.LEAF):  # NaN neither
                return False
            ref, leaf = int(given), int(size)
            if ref != given or leaf != size:
                return False
            if leaf == 0:
                if not node < ref < rows or depth[ref] >= 0 or depth[node] == bvh.MAX_DEPTH:
                    return False
                if not _holds_node(nodes, node, side, ref):
                    return False
                depth[ref] = depth[node] + 1
                continue
            if ref + leaf > count:
                return False
            if rows == 1 and side == 1 and nodes[0, CHILD_WIDTH] == np.inf:  # one leaf holds all: this side is empty
                continue
            for t in range(ref, ref + leaf):
                if seen[t] or not _holds_triangle(vertices, triangles, t, nodes, node, side):
                    return False
                seen[t] = True
            held += leaf
    return bool(held == count)


@entry
def can_be_searched(vertices: Floats, triangles: Ints32, nodes: Floats32) -> bool:
    """Whether all indices lead somewhere, and the searches end and find all triangles; slabs are not looked at.

    ``vertices`` (v, 3) [m], finite; ``triangles`` (n, TRIANGLE_WIDTH); ``nodes`` (m, NODE_WIDTH) [m].
    """
    return bool(_are_rows(vertices, triangles) and _is_tree(vertices, triangles, nodes))
