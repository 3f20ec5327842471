"""Mends of a mesh that leave its shape as it is: what is given twice, what has no area, what is wound the wrong way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.topology import Edges, joined
from itouch.contact.meshfile.volume import overlapping_pairs, parts_to_turn, signed_volumes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FLAT = 1e-12  # height over longest edge below which a triangle has no area that a float32 file can mean
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """What was found in a mesh and what was mended, in numbers; lengths in metres.

    Attributes
    ----------
    triangles, parts
        How many are left, and in how many pieces they hang together.
    joined_vertices
        Vertices given more than once, which were made one.
    unused_bad
        Vertices without finite coordinates that no triangle used.
    collapsed, repeated, flat
        Triangles removed: with a corner twice, given twice, without area.
    kept_flat
        Triangles without area that were kept, because they close the surface.
    turned_faces, turned_parts
        Triangles turned round to agree with their neighbours; closed parts turned because they were inside out.
    one_sided
        Places where no winding agrees (as on a Moebius band).
    edges, open_edges, open_length, crowded_edges
        All; those with one triangle, and how long they are together; those with three triangles and more.
    closed_parts, overlapping
        Parts without open edges; pairs of them that reach into one another.
    low, high
        Corners of the box that holds it.
    """

    triangles: int = 0
    parts: int = 0
    joined_vertices: int = 0
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
    """Refuse a mesh of which a triangle has a corner that is no finite number.

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


def mended(vertices: Floats, faces: Ints, shown: str, *, left_out: int = 0) -> tuple[Floats, Ints, MeshFacts]:
    """Return the mesh with what could be mended mended, and what was found.

    Parameters
    ----------
    vertices, faces
        (n, 3) [m] and (m, 3), each corner an existing vertex with finite coordinates.
    shown
        The file's name, for messages.
    left_out
        Points and lines that the file also has.

    Raises
    ------
    MeshError
        If fewer than two triangles with an area are left.
    """
    given = len(faces)
    unused_bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    vertices, faces, joined_vertices = _joined_vertices(vertices, faces)
    faces, collapsed = _without(faces, (faces == np.roll(faces, 1, axis=1)).any(axis=1))
    faces, repeated = _without(faces, _repeated(faces, len(vertices)))
    faces, edges, flat, kept_flat = _without_flat(vertices, faces)
    if len(faces) < 2:
        what = "no triangle with an area" if not len(faces) else "a single triangle"
        sentence = f"'{shown}' holds {what} ({given} in the file); a surface has two or more"
        raise MeshError("mesh-empty", sentence, "is the file complete?")
    parts, turned, one_sided = joined(edges, len(faces))
    turned_faces = 0
    if turned.any() and not one_sided:
        turned = _minority(vertices, faces, parts, turned)
        turned_faces = int(turned.sum())
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        edges = Edges.of(faces, len(vertices))
    closed = _closed(edges, parts)
    volumes = signed_volumes(vertices, faces, parts)
    turn = parts_to_turn(vertices, faces, parts, closed, volumes)
    if turn.any():
        faces = np.where(turn[parts][:, None], faces[:, ::-1], faces)
        volumes = np.where(turn, -volumes, volumes)
    used = vertices[faces]
    facts = MeshFacts(
        triangles=len(faces), parts=int(parts.max()) + 1, joined_vertices=joined_vertices, unused_bad=unused_bad,
        collapsed=collapsed, repeated=repeated, flat=flat, kept_flat=kept_flat, turned_faces=turned_faces,
        turned_parts=int(turn.sum()), one_sided=one_sided, edges=len(edges.first), open_edges=edges.open,
        open_length=_open_length(vertices, faces, edges), crowded_edges=edges.crowded, closed_parts=int(closed.sum()),
        overlapping=overlapping_pairs(vertices, faces, parts, closed & (volumes > 0)), left_out=left_out,
        low=tuple(used.min(axis=(0, 1)).tolist()), high=tuple(used.max(axis=(0, 1)).tolist()),
    )  # fmt: skip
    return vertices, faces, facts


def _joined_vertices(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, int]:
    """Make vertices with equal coordinates one, and leave out those that no face uses."""
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
        return vertices, faces, 0  # nothing to join; or, once in 10^5 years, two words that agree by chance
    keep = np.sort(first)  # in the order of the file
    rank = np.searchsorted(keep, first)
    return vertices[keep], rank[inverse][faces], len(vertices) - len(first)


def _without(faces: Ints, drop: NDArray[np.bool_]) -> tuple[Ints, int]:
    count = int(drop.sum())
    return (faces[~drop], count) if count else (faces, 0)


def _repeated(faces: Ints, vertex_count: int) -> NDArray[np.bool_]:
    """Mark faces that an earlier one equals, corners and winding; the same corners the other way round are a back."""
    start = np.argmin(faces, axis=1)
    rows = np.arange(len(faces))
    turned = [faces[rows, (start + k) % 3] for k in range(3)]
    _, pairs = np.unique(turned[0] * vertex_count + turned[1], return_inverse=True)
    _, first = np.unique(pairs * np.int64(vertex_count) + turned[2], return_index=True)
    repeated = np.ones(len(faces), np.bool_)
    repeated[first] = False
    return repeated


def _without_flat(vertices: Floats, faces: Ints) -> tuple[Ints, Edges, int, int]:
    """Leave out faces without area, unless a closed surface would open."""
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
    """In each part, mark the side of the quarrel over winding that has less area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.sqrt(_squares(np.cross(b - a, c - a)))
    against = np.bincount(parts, np.where(turned, area, -area)) > 0.0
    return turned ^ against[parts]


def _open_length(vertices: Floats, faces: Ints, edges: Edges) -> float:
    face, corner = np.divmod(edges.order[edges.first[edges.count == 1]], 3)
    along = vertices[faces[face, (corner + 1) % 3]] - vertices[faces[face, corner]]
    return float(np.sqrt(_squares(along)).sum())


def _closed(edges: Edges, parts: Ints) -> NDArray[np.bool_]:
    """Tell of each part whether it has no open edge."""
    closed = np.ones(int(parts.max()) + 1, np.bool_)
    single = edges.order[edges.first[edges.count == 1]] // 3
    closed[parts[single]] = False
    return closed
