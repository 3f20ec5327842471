"""Which triangles share an edge, so that the solver can walk over a surface without a search."""

import numpy as np

from itouch.contact.bvh import Ints32
from itouch.contact.kernel_decorators import entry

NEIGHBOUR = 4  # first of the three columns of the triangles table: across the edges 0-1, 1-2 and 2-0; -1: none


@entry
def add_neighbours(vertex_count: int, triangles: Ints32) -> None:
    """Fill in the neighbours. At an edge of more than two triangles they are paired in the order of their rows.

    ``triangles`` (n, TRIANGLE_WIDTH), filled in place: indices of triangles, -1 for none.
    """
    count = triangles.shape[0]
    start = np.zeros(vertex_count + 1, np.int32)
    for t in range(count):
        for e in range(3):
            a, b = triangles[t, e], triangles[t, (e + 1) % 3]
            start[min(a, b) + 1] += 1
            triangles[t, NEIGHBOUR + e] = -1
    for v in range(vertex_count):
        start[v + 1] += start[v]
    half_edges = np.empty(3 * count, np.int32)  # 3 t + e, grouped by the lesser end
    filled = start[:-1].copy()
    for t in range(count):
        for e in range(3):
            low = min(triangles[t, e], triangles[t, (e + 1) % 3])
            half_edges[filled[low]] = 3 * t + e
            filled[low] += 1
    waiting = np.full(vertex_count, -1, np.int32)  # by an edge's greater end: the half-edge that waits for its other
    for v in range(vertex_count):
        for i in range(start[v], start[v + 1]):
            t, e = half_edges[i] // 3, half_edges[i] % 3
            high = max(triangles[t, e], triangles[t, (e + 1) % 3])
            j = waiting[high]
            if j < start[v]:  # nothing, or left over from an edge of another vertex
                waiting[high] = i
                continue
            u, f = half_edges[j] // 3, half_edges[j] % 3
            if u != t:
                triangles[t, NEIGHBOUR + e], triangles[u, NEIGHBOUR + f] = u, t
                waiting[high] = -1
