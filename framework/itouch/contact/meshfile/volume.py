"""The volumes that closed parts of a mesh enclose, and whether parts reach into one another."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_MOST_PARTS = 200  # greatest number of parts that are compared with one another
_MOST_WORK = 20_000_000  # greatest number of triangles that are visited for this
_SAMPLES = 12
#: Places where two parts may both be, as shares of the sides of the box that they have in common; the middle is first.
_PLACES = np.array(sorted(itertools.product((0.5, 1 / 6, 5 / 6), repeat=3), key=lambda at: sum(x != 0.5 for x in at)))
_THIN = 1e-5  # parts whose boxes overlap by less than this share of the mesh's size only touch


def signed_volumes(vertices: Floats, faces: Ints, parts: Ints) -> Floats:
    """Return six times the volume of each part, negative if its front is inside; meaningful for closed parts.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3), ``parts`` (n,) the part of each face; the volumes (parts,) in [m3].
    """
    middle = vertices.mean(axis=0)
    a, b, c = (vertices[faces[:, k]] - middle for k in range(3))
    return np.asarray(np.bincount(parts, np.einsum("ij,ij->i", a, np.cross(b, c))), np.float64)


def parts_to_turn(vertices: Floats, faces: Ints, parts: Ints, closed: Flags, volumes: Floats) -> Flags:
    """Mark closed parts that are inside out, except the walls of cavities in other parts.

    With very many inverted parts (a foam) the smaller ones count as cavities if their box is inside another part's box.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3), ``parts`` (n,) the part of each face; ``closed``, ``volumes`` [m3]
    and what is returned (parts,).
    """
    inverted = closed & (volumes < 0.0)
    if not inverted.any():
        return inverted
    shells = _Shells(vertices, faces, parts, closed & (volumes > 0.0))
    for rank, part in enumerate(shells.largest_first(inverted)):
        holders = shells.around(part)
        if rank < _MOST_PARTS:
            inverted[part] = not any(shells.inside(other, shells.samples(part, 1))[0] for other in holders)
        else:
            inverted[part] = not holders
    return inverted


def overlapping_pairs(vertices: Floats, faces: Ints, parts: Ints, solid: Flags, cavities: Flags) -> int:
    """Count pairs of solid parts of which one has a sampled point inside the other; of very many, the largest only.

    Sampled are vertices, and, as two bars that cross have none in each other, places in the box that both have in
    common.  What lies in a cavity of a part is not inside it.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3), ``parts`` (n,) the part of each face, ``solid`` and ``cavities``
    (parts,): parts that are bodies, and those that are walls of cavities in them.
    """
    if solid.sum() < 2:
        return 0
    shells = _Shells(vertices, faces, parts, solid, cavities)
    pairs = [(part, other) for part in shells.numbers for other in shells.touching(part) if other < part]
    left = [
        (part, other)
        for part, other in pairs
        if not shells.within(other, shells.samples(part, _SAMPLES)).any()
        and not shells.within(part, shells.samples(other, _SAMPLES)).any()
    ]
    crossing = [(part, other) for part, other in left if shells.cross(part, other)]
    return len(pairs) - len(left) + len(crossing)


class _Shells:
    """The largest of the closed parts, to ask whether points are inside them."""

    def __init__(self, vertices: Floats, faces: Ints, parts: Ints, which: Flags, cavities: Flags | None = None) -> None:
        self._order = np.argsort(parts, kind="stable")
        self._ends = np.searchsorted(parts[self._order], np.arange(int(parts.max()) + 2))
        self._vertices, self._all = vertices, faces
        corners = vertices[faces[self._order]]
        self._low = np.minimum.reduceat(corners.min(axis=1), self._ends[:-1])
        self._high = np.maximum.reduceat(corners.max(axis=1), self._ends[:-1])
        self.numbers = self.largest_first(which)[:_MOST_PARTS]
        self._cavities = [] if cavities is None else self.largest_first(cavities)[:_MOST_PARTS]
        self._thin = _THIN * float((self._high.max(axis=0) - self._low.min(axis=0)).max())
        self._work = _MOST_WORK

    def largest_first(self, which: Flags) -> list[int]:
        """Return the marked parts, those with the most triangles first."""
        marked = np.flatnonzero(which)
        sizes = np.diff(self._ends)[marked]
        return [int(part) for part in marked[np.argsort(-sizes, kind="stable")]]

    def _faces(self, part: int) -> Ints:
        return self._all[self._order[self._ends[part] : self._ends[part + 1]]]

    def around(self, part: int) -> list[int]:
        """Parts whose box contains the box of ``part``."""
        low, high = self._low[self.numbers], self._high[self.numbers]
        holds = ((low <= self._low[part]) & (high >= self._high[part])).all(axis=1)
        return [self.numbers[i] for i in np.flatnonzero(holds) if self.numbers[i] != part]

    def touching(self, part: int) -> list[int]:
        """Parts whose box overlaps the box of ``part``."""
        low, high = self._low[self.numbers], self._high[self.numbers]
        meets = ((low < self._high[part]) & (high > self._low[part])).all(axis=1)
        return [self.numbers[i] for i in np.flatnonzero(meets) if self.numbers[i] != part]

    def samples(self, part: int, count: int) -> Floats:
        """Return some vertices of a part, spread over it."""
        corners = np.unique(self._faces(part))
        spread = np.linspace(0, len(corners) - 1, min(count, len(corners))).astype(np.int64)
        return np.asarray(self._vertices[corners[spread]])

    def inside(self, part: int, points: Floats) -> Flags:
        """Whether points are inside a part, by the winding number (van Oosterom and Strackee, 1983)."""
        corners = self._vertices[self._faces(part)]
        low, high = self._low[part], self._high[part]
        found = np.zeros(len(points), np.bool_)
        for i, point in enumerate(points):
            if (point <= low).any() or (point >= high).any() or self._work < len(corners):
                continue
            self._work -= len(corners)
            a, b, c = (corners[:, k] - point for k in range(3))
            la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", x, x)) for x in (a, b, c))
            volume = np.einsum("ij,ij->i", a, np.cross(b, c))
            rest = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la
            turns = np.arctan2(volume, rest + np.einsum("ij,ij->i", c, a) * lb).sum() / (2.0 * np.pi)
            found[i] = abs(turns) > 0.75
        return found

    def within(self, part: int, points: Floats) -> Flags:
        """Whether points are inside a part, and in none of its cavities."""
        found = self.inside(part, points)
        for cavity in self._cavities:
            if not found.any():
                break
            if (self._low[cavity] >= self._low[part]).all() and (self._high[cavity] <= self._high[part]).all():
                found[found] = ~self.inside(cavity, points[found])
        return found

    def cross(self, part: int, other: int) -> bool:
        """Whether one of some places in the box that two parts have in common is inside both."""
        low = np.maximum(self._low[part], self._low[other])
        size = np.minimum(self._high[part], self._high[other]) - low
        if (size <= self._thin).any():
            return False
        points = low + _PLACES * size
        return any(self.within(part, point).any() and self.within(other, point).any() for point in points[:, None])
