"""How the triangles of a mesh are connected: which edges they share, which parts they form, and how they are wound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact.kernel_decorators import entry

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Edges:
    """The edges of a list of triangles; edge 3 t + e is that from corner e of triangle t to the next.

    Attributes
    ----------
    order
        (3 m,) the edges, sorted so that equal ones are adjacent.
    first
        Where each group of equal edges begins in ``order``.
    count
        How many edges each group has: 1 at a border, 2 inside a surface.
    forward
        (3 m,) whether an edge goes from its lesser vertex to the greater.
    """

    order: Ints
    first: Ints
    count: Ints
    forward: Flags

    @classmethod
    def of(cls, faces: Ints, vertex_count: int) -> Edges:
        """Find the edges of triangles (n, 3), whose corners are indices of vertices, all below ``vertex_count``."""
        ends = np.roll(faces, -1, axis=1)
        keys = (np.minimum(faces, ends) * vertex_count + np.maximum(faces, ends)).ravel()
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])) if len(keys) else order
        count = np.diff(np.append(first, len(keys)))
        return cls(order, first, count, (faces < ends).ravel())

    @property
    def open(self) -> int:
        """Number of edges that belong to a single triangle."""
        return int((self.count == 1).sum())

    @property
    def crowded(self) -> int:
        """Number of edges that three or more triangles share."""
        return int((self.count > 2).sum())

    def pairs(self) -> tuple[Ints, Ints, Flags]:
        """Return the two edges at which triangles of a pair meet, and whether both run the same way: one is turned."""
        first = self.first[self.count == 2]
        one, other = self.order[first], self.order[first + 1]
        return one, other, self.forward[one] == self.forward[other]


@entry
def _join(one: Ints, other: Ints, same_way: Flags, parent: Ints, turned: Flags) -> int:
    """Join triangles by pairs (union-find), tracking whether each is wound against its root; returns contradictions."""
    contradictions = 0
    for i in range(one.shape[0]):
        a, b, odd = one[i], other[i], same_way[i]
        while parent[a] != a:
            up = parent[a]
            if parent[up] != up:
                turned[a] ^= turned[up]
                parent[a] = parent[up]
            odd ^= turned[a]
            a = parent[a]
        while parent[b] != b:
            up = parent[b]
            if parent[up] != up:
                turned[b] ^= turned[up]
                parent[b] = parent[up]
            odd ^= turned[b]
            b = parent[b]
        if a != b:
            parent[max(a, b)] = min(a, b)
            turned[max(a, b)] = odd
        elif odd:
            contradictions += 1
    return contradictions


@entry
def _flatten(parent: Ints, turned: Flags) -> None:
    """Let every triangle point at its root; roots have the lowest indices, so that one pass is enough."""
    for t in range(parent.shape[0]):
        up = parent[t]
        if parent[up] != up:
            turned[t] ^= turned[up]
            parent[t] = parent[up]


def joined(edges: Edges, face_count: int) -> tuple[Ints, Flags, int]:
    """Find the parts of a mesh.

    Returns
    -------
    tuple
        For each triangle the index of its part, and whether it is wound against the first triangle of its part; and how
        many pairs contradict that (as on a surface with only one side).
    """
    one, other, same_way = edges.pairs()
    parent, turned = np.arange(face_count), np.zeros(face_count, np.bool_)
    contradictions = _join(one // 3, other // 3, same_way, parent, turned)
    _flatten(parent, turned)
    _, parts = np.unique(parent, return_inverse=True)
    return parts, turned, int(contradictions)
