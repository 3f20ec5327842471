"""Vertices that are meant to be one: with equal coordinates, or on the two sides of a seam that rounding has opened."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.topology import Edges

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: How far apart vertices of a seam may be, as a share of the mesh's size: the rounding error of six digits in a file.
SEAM = 2e-6
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))


def joined_vertices(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, int]:
    """Merge vertices with equal coordinates, and leave out those that no face uses.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3); returns both, and how many vertices were merged into others.
    """
    used = np.zeros(len(vertices), np.bool_)
    used[faces.ravel()] = True
    number = np.cumsum(used) - 1
    vertices, faces = vertices[used] + 0.0, number[faces]  # + 0.0: -0.0 is 0.0
    bits = vertices.view(np.uint64).reshape(-1, 3)
    words = np.zeros(len(vertices), np.uint64)
    for column, factor in enumerate(_MIX):
        words = (words ^ bits[:, column]) * factor
        words ^= words >> np.uint64(29)
    _, first, inverse = np.unique(words, return_index=True, return_inverse=True)
    if len(first) == len(vertices) or not np.array_equal(vertices[first][inverse], vertices):
        return vertices, faces, 0  # nothing to merge; or, once in 10^5 years, two hashes that agree by chance
    keep = np.sort(first)  # in the order of the file
    rank = np.searchsorted(keep, first)
    return vertices[keep], rank[inverse][faces], len(vertices) - len(first)


def joined_seams(vertices: Floats, faces: Ints, edges: Edges) -> tuple[Ints, Edges, int]:
    """Sew borders together whose vertices lie within SEAM of one another, if that leaves fewer open edges.

    Vertices are not moved: of vertices close together, faces use a single one. Returns the faces, their edges, and how
    many vertices were merged into others.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3).
    """
    if edges.open == 0:
        return faces, edges, 0
    face, corner = np.divmod(edges.order[edges.first[edges.count == 1]], 3)
    border = np.unique(np.concatenate([faces[face, corner], faces[face, (corner + 1) % 3]]))
    stand_in = np.arange(len(vertices))
    stand_in[border] = border[_groups(vertices[border], SEAM * float(np.ptp(vertices[faces], axis=(0, 1)).max()))]
    given_up = int((stand_in != np.arange(len(vertices))).sum())
    if given_up == 0:
        return faces, edges, 0
    sewn = stand_in[faces]
    sewn = sewn[(sewn != np.roll(sewn, 1, axis=1)).all(axis=1)]
    closer = Edges.of(sewn, len(vertices))
    if closer.open >= edges.open or closer.crowded > edges.crowded:
        return faces, edges, 0
    return sewn, closer, given_up


def _groups(points: Floats, reach: float) -> Ints:
    """For each point, the first of the points that share a cell with it, in one of eight grids half a cell apart."""
    first = np.arange(len(points))
    if reach <= 0.0:
        return first
    scaled = (points - points.min(axis=0)) / (2.0 * reach)
    for shift in product((0.0, 0.5), repeat=3):
        cells = np.floor(scaled + shift).astype(np.int64)
        _, start, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        first = first[np.minimum(start[inverse.reshape(-1)], first)]
    while not np.array_equal(first[first], first):
        first = first[first]
    return first
