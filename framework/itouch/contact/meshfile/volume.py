"""The volumes that closed parts of a mesh enclose, and whether parts reach into one another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_MOST_PARTS = 200  # greatest number of parts that are compared with one another
_MOST_WORK = 20_000_000  # greatest number of triangles that are visited for this
_SAMPLES = 12


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


def overlapping_pairs(vertices: Floats, faces: Ints, parts: Ints, solid: Flags) -> int:
    """Count pairs of solid parts of which one has a sampled vertex inside the other; of very many, the largest only.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3), ``parts`` (n,) the part of each face, ``solid`` (parts,).
    """
    if solid.sum() < 2:
        return 0
    shells = _Shells(vertices, faces, parts, solid)
    count = 0
    for part in shells.numbers:
        for other in shells.touching(part):
            if other < part:
                hit = shells.inside(other, shells.samples(part, _SAMPLES)).any()
                count += bool(hit or shells.inside(part, shells.samples(other, _SAMPLES)).any())
    return count


class _Shells:
    """The largest of the closed parts, to ask whether points are inside them."""

    def __init__(self, vertices: Floats, faces: Ints, parts: Ints, which: Flags) -> None:
        self._order = np.argsort(parts, kind="stable")
        self._ends = np.searchsorted(parts[self._order], np.arange(int(parts.max()) + 2))
        self._vertices, self._all = vertices, faces
        corners = vertices[faces[self._order]]
        self._low = np.minimum.reduceat(corners.min(axis=1), self._ends[:-1])
        self._high = np.maximum.reduceat(corners.max(axis=1), self._ends[:-1])
        self.numbers = self.largest_first(which)[:_MOST_PARTS]
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
