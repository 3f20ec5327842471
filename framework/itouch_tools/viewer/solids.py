"""Triangle meshes of the shapes that are drawn: positions, normals and faces; needs no graphics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

#: Number of segments around a round shape.
SEGMENTS = 48


@dataclass(frozen=True, slots=True)
class Solid:
    """A triangle mesh: ``positions`` and ``normals`` (n, 3) float32, ``faces`` (m, 3) uint32, in metres."""

    positions: Floats
    normals: Floats
    faces: NDArray[np.uint32]


def _solid(positions: object, normals: object, faces: object) -> Solid:
    return Solid(
        np.ascontiguousarray(positions, np.float32),
        np.ascontiguousarray(normals, np.float32),
        np.ascontiguousarray(faces, np.uint32),
    )


def box(half: tuple[float, float, float]) -> Solid:
    """Return a box of these half extents [m] about the origin, with flat sides."""
    positions: list[list[float]] = []
    normals: list[list[float]] = []
    faces: list[tuple[int, ...]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            first = len(positions)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = [0.0, 0.0, 0.0]
                corner[axis], corner[u], corner[v] = sign * half[axis], a * half[u], b * half[v]
                positions.append(corner)
                normals.append([sign if i == axis else 0.0 for i in range(3)])
            quad = [(0, 1, 2), (0, 2, 3)] if sign > 0 else [(0, 2, 1), (0, 3, 2)]
            faces += [tuple(first + i for i in corner_of) for corner_of in quad]
    return _solid(positions, normals, faces)


def sphere(radius: float) -> Solid:
    """Return a sphere of this radius [m] about the origin."""
    return lathe(_arc(radius, 0.0, -math.pi / 2, math.pi / 2))


def capsule(radius: float, half_length: float) -> Solid:
    """Return a capsule along z: a cylinder of this half length [m] between two hemispheres."""
    lower = _arc(radius, -half_length, -math.pi / 2, 0.0)
    return lathe(lower + _arc(radius, half_length, 0.0, math.pi / 2))


def cylinder(radius: float, half_length: float) -> Solid:
    """Return a cylinder along z with flat ends."""
    side = [(radius, -half_length, 1.0, 0.0), (radius, half_length, 1.0, 0.0)]
    return join(lathe(side), disc(radius, -half_length, -1.0), disc(radius, half_length, 1.0))


def cone(radius: float, length: float) -> Solid:
    """Return a cone whose base lies in the plane z = 0 and whose tip is at z = ``length``."""
    slope = math.hypot(radius, length)
    side = [(radius, 0.0, length / slope, radius / slope), (0.0, length, length / slope, radius / slope)]
    return join(lathe(side), disc(radius, 0.0, -1.0))


def disc(radius: float, height: float, up: float) -> Solid:
    """Return a flat disc at z = ``height`` whose normal points to ``up`` along z (1 or -1)."""
    angles = np.linspace(0.0, 2 * math.pi, SEGMENTS, endpoint=False)
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(SEGMENTS, height)], 1)
    positions = np.vstack([[0.0, 0.0, height], ring])
    index = np.arange(SEGMENTS)
    following = (index + 1) % SEGMENTS
    faces = np.stack([np.zeros(SEGMENTS, int), index + 1, following + 1], 1)
    return _solid(positions, np.tile([0.0, 0.0, up], (SEGMENTS + 1, 1)), faces if up > 0 else faces[:, ::-1])


def lathe(profile: list[tuple[float, float, float, float]]) -> Solid:
    """Return the surface of revolution of a profile about z.

    The profile's points go upwards; each has a radius and a height, and the radial and the axial part of its normal.
    """
    rows = np.asarray(profile, float)
    angles = np.linspace(0.0, 2 * math.pi, SEGMENTS + 1)
    cosine, sine = np.cos(angles), np.sin(angles)
    positions = np.stack([np.outer(rows[:, 0], cosine), np.outer(rows[:, 0], sine),
                          np.repeat(rows[:, 1:2], SEGMENTS + 1, 1)], 2)  # fmt: skip
    normals = np.stack([np.outer(rows[:, 2], cosine), np.outer(rows[:, 2], sine),
                        np.repeat(rows[:, 3:4], SEGMENTS + 1, 1)], 2)  # fmt: skip
    return _solid(positions.reshape(-1, 3), normals.reshape(-1, 3), _strip(len(rows), SEGMENTS + 1))


def join(*solids: Solid) -> Solid:
    """Return several solids as one."""
    starts = np.cumsum([0, *(len(solid.positions) for solid in solids[:-1])])
    faces = [solid.faces + np.uint32(start) for solid, start in zip(solids, starts, strict=True)]
    return _solid(np.vstack([s.positions for s in solids]), np.vstack([s.normals for s in solids]), np.vstack(faces))


def from_mesh(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> Solid:
    """Return a mesh to draw: vertices are shared where its surface is smooth, and duplicated at sharp edges.

    A corner's normal is the mean of the faces about its vertex that lie within 40 degrees of its own face.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3).
    """
    corners = np.asarray(vertices, np.float64)[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit = _unit(flat)
    smooth = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(smooth, faces[:, corner], flat)
    smooth = _unit(smooth)
    bent = np.zeros(len(vertices), bool)
    agree = (smooth[faces] * unit[:, None, :]).sum(2)
    bent[np.asarray(faces)[(agree < math.cos(math.radians(20.0))) & (unit != 0.0).any(axis=1, keepdims=True)]] = True
    if not bent.any():
        return _solid(vertices, smooth, faces)
    apart = bent[faces].ravel()
    index = np.array(faces, np.int64).ravel()
    normals = _parted(index[apart], np.nonzero(apart)[0] // 3, flat, unit)
    index[apart] = len(vertices) + np.arange(len(normals))
    return _solid(np.vstack([vertices, corners.reshape(-1, 3)[apart]]), np.vstack([smooth, normals]),
                  index.reshape(-1, 3))  # fmt: skip


def _parted(
    vertex: NDArray[np.int64], face: NDArray[np.int64], flat: NDArray[np.float64], unit: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the normal of each corner, given its vertex and face, from the vertex's faces that bend little from it."""
    order = np.argsort(vertex, kind="stable")
    vertex, face = vertex[order], face[order]
    total = flat[face].copy()
    apart = 1
    while apart < len(vertex):
        same = vertex[apart:] == vertex[:-apart]
        if not same.any():
            break
        first = np.nonzero(same)[0]
        near = (unit[face[first]] * unit[face[first + apart]]).sum(1) > math.cos(math.radians(40.0))
        first = first[near]
        total[first] += flat[face[first + apart]]
        total[first + apart] += flat[face[first]]
        apart += 1
    normals = np.empty_like(total)
    normals[order] = _unit(total)
    return normals


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: NDArray[np.float64] = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return unit


def grid(half: float, step: float) -> tuple[Floats, Floats]:
    """Return line ends (n, 3) [m] of a square grid in the plane z = 0, ``step`` [m] apart, and their strength (n,).

    Lines fade from the middle outwards, so that no end is visible; every fifth is stronger.
    """
    count = max(1, round(half / step))
    places = np.arange(-count, count + 1)
    along = np.repeat(places, 2)[1:-1] * step  # start and end of each segment
    strong = np.where(places % 5 == 0, 0.60, 0.26)
    first = np.stack([np.repeat(places * step, len(along)), np.tile(along, len(places))], 1)
    flat = np.vstack([first, first[:, ::-1]])
    away = np.minimum((flat**2).sum(1) / (count * step) ** 2, 1.0)
    strength = np.tile(np.repeat(strong, len(along)), 2) * (1.0 - away) ** 2
    lines = np.column_stack([flat, np.zeros(len(flat))])
    return lines.astype(np.float32), strength.astype(np.float32)


def feature_edges(solid: Solid, *, most: int = 60_000) -> NDArray[np.float64]:
    """Return line ends (n, 3) [m] of the edges at which a solid bends by more than 40 degrees, or ends.

    A solid with more than ``most`` faces has none: its edges would only clutter the picture.
    """
    if not 0 < len(solid.faces) <= most:
        return np.empty((0, 3))
    size = float(np.ptp(solid.positions, axis=0).max()) or 1.0
    places, index = np.unique(np.round(solid.positions / (1e-5 * size)), axis=0, return_inverse=True)
    faces = index.reshape(-1)[solid.faces]
    corners = solid.positions.astype(np.float64)[solid.faces]
    flat = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    whole = (faces != np.roll(faces, 1, 1)).all(1)
    faces, flat = faces[whole], flat[whole]
    ends = np.sort(np.stack([faces, np.roll(faces, -1, 1)], 2).reshape(-1, 2), 1)
    edges, which, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(edges), 3))
    np.add.at(sums, which.reshape(-1), np.repeat(flat, 3, 0))
    bent = (count != 2) | (np.linalg.norm(sums, axis=1) < 2.0 * math.cos(math.radians(20.0)))
    found: NDArray[np.float64] = places[edges[bent]].reshape(-1, 3) * (1e-5 * size)
    return found


def box_edges(low: tuple[float, float, float], high: tuple[float, float, float]) -> Floats:
    """Return the line ends (24, 3) of a box's twelve edges."""
    corners = [[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    pairs = [(i, i | 1 << axis) for axis in range(3) for i in range(8) if not i >> axis & 1]
    return np.array([corners[end] for pair in pairs for end in pair], np.float32)


def _arc(radius: float, height: float, first: float, last: float) -> list[tuple[float, float, float, float]]:
    angles = np.linspace(first, last, SEGMENTS // 2 + 1)
    return [(radius * math.cos(a), height + radius * math.sin(a), math.cos(a), math.sin(a)) for a in angles]


def _strip(rows: int, columns: int) -> NDArray[np.int64]:
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (row * columns + column).ravel()
    b, c, d = a + 1, a + columns + 1, a + columns
    return np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
