"""Repairs of a mesh that leave its shape unchanged: duplicates, opened seams, triangles without area, wrong winding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.topology import Edges, joined
from itouch.contact.meshfile.volume import overlapping_pairs, parts_to_turn, signed_volumes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FLAT = 1e-12  # height over longest edge below which a triangle has no area that a float32 file can express

#: How far apart vertices of a seam may be, as a share of the mesh's size: the rounding error of six digits in a file.
SEAM = 2e-6
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """What was found in a mesh and what was repaired, in numbers; lengths in metres.

    Attributes
    ----------
    triangles, parts
        Triangles that are left, and the connected parts that they form.
    joined_vertices
        Duplicate vertices that were merged.
    joined_seams
        Vertices at borders that lay within SEAM times the mesh's size of others and were merged with them.
    unused_bad
        Vertices without finite coordinates that no triangle used.
    collapsed, repeated, flat
        Triangles removed: with the same corner twice, given twice, without area.
    kept_flat
        Triangles without area that were kept, because they close the surface.
    turned_faces, turned_parts
        Triangles flipped to agree with their neighbours; closed parts flipped because they were inside out.
    one_sided
        Pairs of triangles for which no winding agrees (as on a Moebius band).
    edges, open_edges, open_length, crowded_edges
        All edges; those of a single triangle, and their total length [m]; those of three or more triangles.
    closed_parts, overlapping
        Parts without open edges; pairs of these that reach into one another.
    left_out
        Primitives of points or lines that the file also has.
    low, high
        Corners of the bounding box.
    """

    triangles: int = 0
    parts: int = 0
    joined_vertices: int = 0
    joined_seams: int = 0
    unused_bad: int = 0
    collapsed: int = 0
    repeated: int = 0
    flat: int = 0
    kept_flat: int = 0
    turned_faces: int = 0
    turned_parts: int = 0
    one_sided: int = 0
    edges: int = 0
    open_edges: int = 0
    open_length: float = 0.0
    crowded_edges: int = 0
    closed_parts: int = 0
    overlapping: int = 0
    left_out: int = 0
    low: tuple[float, ...] = (0.0, 0.0, 0.0)
    high: tuple[float, ...] = (0.0, 0.0, 0.0)


def check_finite(vertices: Floats, faces: Ints, shown: str) -> None:
    """Refuse a mesh, vertices (v, 3) [m] and faces (n, 3), if a triangle has a corner that is not finite.

    Raises
    ------
    MeshError
        Naming the first such triangle.
    """
    bad = np.asarray(~np.isfinite(vertices).all(axis=1))
    if not bad.any():
        return
    broken = bad[faces].any(axis=1)
    if broken.any():
        what = f"{int(broken.sum())} of {len(faces)} triangles have a corner that is not a finite number"
        advice = f"the first is triangle {int(np.argmax(broken))}; export it again"
        raise MeshError("mesh-not-finite", f"'{shown}': {what}", advice)


def repaired(vertices: Floats, faces: Ints, shown: str, *, left_out: int = 0) -> tuple[Floats, Ints, MeshFacts]:
    """Return the mesh, repaired where that is possible, and the facts found.

    Parameters
    ----------
    vertices, faces
        (n, 3) [m] and (m, 3), each corner an existing vertex with finite coordinates.
    shown
        The file's name, for messages.
    left_out
        Number of primitives of points or lines that the file also has.

    Raises
    ------
    MeshError
        If fewer than two triangles with an area are left.
    """
    given = len(faces)
    unused_bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    vertices, faces, same = joined_vertices(vertices, faces)
    faces, collapsed, repeated = _without_repetitions(faces, len(vertices))
    faces, edges, flat, kept_flat = _without_flat(vertices, faces)
    faces, edges, close = joined_seams(vertices, faces, edges)
    if len(faces) < 2:
        what = "no triangle with an area" if not len(faces) else "a single triangle"
        sentence = f"'{shown}' holds {what} ({given} in the file); a surface has two or more"
        raise MeshError("mesh-empty", sentence, "is the file complete?")
    facts = MeshFacts(
        joined_vertices=same, joined_seams=close, unused_bad=unused_bad, collapsed=collapsed, repeated=repeated,
        flat=flat, kept_flat=kept_flat, left_out=left_out,
    )  # fmt: skip
    return vertices, *_wound(vertices, faces, edges, facts)


def _wound(vertices: Floats, faces: Ints, edges: Edges, facts: MeshFacts) -> tuple[Ints, MeshFacts]:
    """Wind the faces of each part consistently, closed parts with the front outside; complete the facts accordingly."""
    parts, turned, one_sided = joined(edges, len(faces))
    if one_sided:
        turned = np.zeros(len(faces), np.bool_)
    if turned.any():
        turned = _minority(vertices, faces, parts, turned)
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        edges = Edges.of(faces, len(vertices))
    closed = _closed(edges, parts)
    volumes = signed_volumes(vertices, faces, parts)
    inverted = parts_to_turn(vertices, faces, parts, closed, volumes)
    if inverted.any():
        faces = np.where(inverted[parts][:, None], faces[:, ::-1], faces)
    solid = closed & ((volumes > 0.0) | inverted)
    corners = vertices[faces]
    return faces, replace(
        facts, triangles=len(faces), parts=int(parts.max()) + 1, turned_faces=int(turned.sum()),
        turned_parts=int(inverted.sum()), one_sided=one_sided, edges=len(edges.first), open_edges=edges.open,
        open_length=_open_length(vertices, faces, edges), crowded_edges=edges.crowded, closed_parts=int(closed.sum()),
        overlapping=overlapping_pairs(vertices, faces, parts, solid, closed & ~solid),
        low=tuple(corners.min(axis=(0, 1)).tolist()), high=tuple(corners.max(axis=(0, 1)).tolist()),
    )  # fmt: skip


def _without(faces: Ints, drop: NDArray[np.bool_]) -> tuple[Ints, int]:
    count = int(drop.sum())
    return (faces[~drop], count) if count else (faces, 0)


def _without_repetitions(faces: Ints, vertex_count: int) -> tuple[Ints, int, int]:
    """Leave out faces with the same corner twice, and faces given twice; also return how many of each."""
    faces, collapsed = _without(faces, (faces == np.roll(faces, 1, axis=1)).any(axis=1))
    faces, repeated = _without(faces, _repeated(faces, vertex_count))
    return faces, collapsed, repeated


def _repeated(faces: Ints, vertex_count: int) -> NDArray[np.bool_]:
    """Mark faces equal to an earlier one in corners and winding; the same corners wound the other way are a back."""
    start = np.argmin(faces, axis=1)
    rows = np.arange(len(faces))
    turned = [faces[rows, (start + k) % 3] for k in range(3)]
    _, pairs = np.unique(turned[0] * vertex_count + turned[1], return_inverse=True)
    _, first = np.unique(pairs * np.int64(vertex_count) + turned[2], return_index=True)
    repeated = np.ones(len(faces), np.bool_)
    repeated[first] = False
    return repeated


def _without_flat(vertices: Floats, faces: Ints) -> tuple[Ints, Edges, int, int]:
    """Leave out faces without area, unless that would open edges."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    longest = np.maximum(np.maximum(_squares(b - a), _squares(c - b)), _squares(a - c))
    flat = np.sqrt(_squares(np.cross(b - a, c - a))) <= _FLAT * longest
    edges = Edges.of(faces, len(vertices))
    if not flat.any():
        return faces, edges, 0, 0
    rest = faces[~flat]
    thinner = Edges.of(rest, len(vertices))
    if thinner.open > edges.open:
        return faces, edges, 0, int(flat.sum())
    return rest, thinner, int(flat.sum()), 0


def _squares(rows: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", rows, rows))


def _minority(vertices: Floats, faces: Ints, parts: Ints, turned: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """In each part, mark for turning those of the two opposite windings that have the smaller area together."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.sqrt(_squares(np.cross(b - a, c - a)))
    against = np.bincount(parts, np.where(turned, area, -area)) > 0.0
    return turned ^ against[parts]


def _open_length(vertices: Floats, faces: Ints, edges: Edges) -> float:
    face, corner = np.divmod(edges.order[edges.first[edges.count == 1]], 3)
    along = vertices[faces[face, (corner + 1) % 3]] - vertices[faces[face, corner]]
    return float(np.sqrt(_squares(along)).sum())


def _closed(edges: Edges, parts: Ints) -> NDArray[np.bool_]:
    """Tell for each part whether it has no open edge."""
    closed = np.ones(int(parts.max()) + 1, np.bool_)
    single = edges.order[edges.first[edges.count == 1]] // 3
    closed[parts[single]] = False
    return closed


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
