"""A triangle mesh that can be touched and searched: vertices, triangles and hierarchy."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from itouch.contact import bvh, search
from itouch.contact.bvh import Ints32
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.neighbours import add_neighbours
from itouch.contact.scratch import Mesh as Tables
from itouch.contact.triangle import corner
from itouch.contact.vectors import Floats, cross, dot, sub

_SKIN = 1e-7  # of the mesh's size: how far a point probe stays off a surface without thickness
_FARTHEST = 1e100  # [m]; squares must not overflow
_SKIN_FAR = 1e-8  # of the greatest coordinate: rounding must stay far below the skin

_PRIME = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(29)


def checked_vertices(vertices: ArrayLike) -> Floats:
    """Vertices as a contiguous (n, 3) float array [m]; raises ValueError unless they are (n, 3) finite numbers."""
    array = checked_numbers("vertices", vertices)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"vertices has shape {array.shape}; it must be (n, 3)")
    bad = ~np.isfinite(array).all(axis=1)
    if bad.any():
        raise ValueError(f"vertices[{int(np.argmax(bad))}] is not finite ({int(bad.sum())} such vertices)")
    if array.size and (reach := max(-float(array.min()), float(array.max()))) > _FARTHEST:
        raise ValueError(f"vertices reach {reach:g} m; at most {_FARTHEST:g} m is allowed")
    return array


def checked_numbers(name: str, values: ArrayLike) -> Floats:
    """Values as a contiguous float array of their shape and unit; raises ValueError when they are not numbers."""
    try:
        if np.iscomplexobj(values):
            raise TypeError("they are complex")
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is not an array of numbers: {error}") from None


def checked_faces(faces: ArrayLike, vertex_count: int) -> NDArray[np.int32]:
    """Faces as a contiguous (m, 3) int32 array; raises ValueError when they are not faces of these vertices."""
    try:
        array = np.asarray(faces)
    except ValueError as error:
        raise ValueError(f"faces is not an array of numbers: {error}") from None
    if array.size == 0:
        raise ValueError("faces is empty; a surface needs at least one triangle")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"faces has shape {array.shape}; it must be (m, 3)")
    if array.shape[0] > bvh.MAX_TRIANGLES:
        raise ValueError(f"faces has {array.shape[0]} triangles; at most {bvh.MAX_TRIANGLES} are allowed")
    if not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"faces has type {array.dtype}; it must hold whole numbers")
    low, high = int(array.min()), int(array.max())
    if low < 0 or high >= vertex_count:
        given = low if low < 0 else high
        raise ValueError(f"faces names vertex {given}; there are vertices 0 to {vertex_count - 1}")
    return np.ascontiguousarray(array, dtype=np.int32)


@inner
def _mix(a: np.uint64, b: np.uint64) -> np.uint64:
    """Scramble two words into one; the order matters."""
    x = (a ^ (b + _PRIME + (a << np.uint64(6)) + (a >> np.uint64(2)))) * _PRIME
    x ^= x >> _SHIFT
    x *= np.uint64(0xBF58476D1CE4E5B9)
    return x ^ (x >> np.uint64(32))


@entry
def encloses(vertices: Floats, triangles: Ints32) -> bool:
    """Whether every directed edge has its opposite and the signed volume is positive.

    Edges are compared by a 64-bit sum of hashes of their ends' coordinates, so that duplicate vertices count as one;
    the chance of a wrong answer is about 1e-19.

    ``vertices`` (v, 3) [m], ``triangles`` (n, TRIANGLE_WIDTH).
    """
    words = np.empty(vertices.shape[0], np.uint64)
    bits = vertices.view(np.uint64)
    for v in range(vertices.shape[0]):
        word = _PRIME
        for c in range(3):
            word = _mix(word, bits[v, c] if vertices[v, c] != 0.0 else np.uint64(0))
        words[v] = word
    balance = np.uint64(0)
    volume = 0.0
    middle = corner(vertices, 0)
    for t in range(triangles.shape[0]):
        for c in range(3):
            a, b = words[triangles[t, c]], words[triangles[t, (c + 1) % 3]]
            balance += _mix(a, b) - _mix(b, a)
        p = sub(corner(vertices, triangles[t, 0]), middle)
        q, r = sub(corner(vertices, triangles[t, 1]), middle), sub(corner(vertices, triangles[t, 2]), middle)
        volume += dot(p, cross(q, r))
    return bool(balance == np.uint64(0) and volume > 0.0)


class Surface:
    """A triangle mesh with its bounding-volume hierarchy.

    Parameters
    ----------
    vertices
        (n, 3) [m].
    faces
        (m, 3) indices of vertices; the winding gives the front.
    two_sided
        False: contact from the front only; a probe that comes from behind is let through. A mesh that is closed and has
        its front outside is a solid: a probe inside is pushed out.

    Raises
    ------
    ValueError
        If shapes are wrong, there is no triangle or too many, or a vertex is not finite or does not exist.
    """

    __slots__ = ("_encloses", "bound", "face_count", "skin", "tables", "two_sided")

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, two_sided: bool = False) -> None:
        points = checked_vertices(vertices)
        corners = checked_faces(faces, points.shape[0])
        nodes, order = bvh.build(points, corners)
        packed, triangles = bvh.pack(points, corners, order)
        bvh.add_slabs(packed, triangles, nodes)
        add_neighbours(packed.shape[0], triangles)
        self._set((packed, triangles, nodes), bool(two_sided), bool(encloses(packed, triangles)))

    def _set(self, tables: Tables, two_sided: bool, encloses_volume: bool) -> None:
        for array in tables:
            array.flags.writeable = False
        packed = tables[0]
        self.tables: Tables = tables
        self.two_sided = two_sided
        self.face_count = int(tables[1].shape[0])
        self._encloses = encloses_volume
        self.bound = float(np.sqrt((packed**2).sum(axis=1).max()))
        size = float(np.linalg.norm(packed.max(axis=0) - packed.min(axis=0)))
        self.skin = max(_SKIN * size, _SKIN_FAR * float(np.abs(packed).max()), 1e-12)

    @classmethod
    def of_tables(cls, tables: Tables, *, is_solid: bool) -> "Surface":
        """Make a surface from the stored tables of another one; they are not checked."""
        surface = cls.__new__(cls)
        surface._set(tables, False, is_solid)  # noqa: SLF001 (its own class)
        return surface

    def seen_from(self, *, two_sided: bool) -> "Surface":
        """Return the same surface, touched from the front only or from both sides; the tables are shared."""
        if two_sided == self.two_sided:
            return self
        surface = type(self).__new__(type(self))
        surface._set(self.tables, two_sided, self._encloses)  # noqa: SLF001 (its own class)
        return surface

    @property
    def is_solid(self) -> bool:
        """Whether it encloses a volume that the probe is kept out of."""
        return self._encloses and not self.two_sided

    def closest(self, points: ArrayLike) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """Nearest points of the surface.

        Parameters
        ----------
        points
            (3,) or (n, 3) [m].

        Returns
        -------
        tuple
            Nearest points, shaped like ``points``; unsigned distances [m], () or (n,); indices of faces, () or (n,). A
            point that is not finite has no nearest point: distance inf, face -1, and the point itself.

        Raises
        ------
        ValueError
            If ``points`` has another shape, or holds no numbers.
        """
        try:
            asked = np.ascontiguousarray(points, dtype=np.float64)
        except (TypeError, ValueError):
            asked = checked_numbers("points", points)
        if asked.ndim not in (1, 2) or asked.shape[-1] != 3:
            raise ValueError(f"points has shape {asked.shape}; it must be (3,) or (n, 3)")
        rows = asked.reshape(-1, 3)
        found, distances = np.empty_like(rows), np.empty(rows.shape[0])
        faces = np.empty(rows.shape[0], np.int32)
        search.nearest_many(*self.tables, rows, found, distances, faces)
        if asked.ndim == 1:
            if distances[0] == np.inf:
                faces[0] = -1
            return found[0], distances[0], faces[0]
        faces[distances == np.inf] = -1
        return found, distances, faces

    @property
    def vertices(self) -> Floats:
        """The vertices that faces use (n, 3) [m], in the surface's own order; read-only."""
        return self.tables[0]

    @property
    def faces(self) -> NDArray[np.int32]:
        """Indices of ``vertices`` (m, 3), in the order in which the faces were given."""
        triangles = self.tables[1]
        faces = np.empty((len(triangles), 3), np.int32)
        faces[triangles[:, 3]] = triangles[:, :3]
        return faces

    @property
    def memory_bytes(self) -> int:
        """Bytes that vertices, triangles and hierarchy take."""
        return sum(array.nbytes for array in self.tables)
