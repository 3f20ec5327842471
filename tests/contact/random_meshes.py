"""Surfaces by chance: terrains with noise, gyroids, tori, hulls and dented spheres, evenly and very unevenly cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from itouch_evidence.contact.contact_workload import icosphere

Floats = NDArray[np.float64]
Mesh = tuple[Floats, NDArray[np.int32]]


def marched(field: Callable[[Floats], Floats], cells: int) -> Mesh:
    """Surface field = 0 in the cube from -1 to 1 by marching tetrahedra, the front where it grows."""
    line = np.linspace(-1.0, 1.0, cells + 1)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    value = field(points)
    n = np.arange((cells + 1) ** 3).reshape((cells + 1,) * 3)
    corner = [n[i : i + cells, j : j + cells, k : k + cells].ravel() for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    paths = [(0, 4, 6, 7), (0, 6, 2, 7), (0, 2, 3, 7), (0, 3, 1, 7), (0, 1, 5, 7), (0, 5, 4, 7)]
    tetrahedra = np.concatenate([np.stack([corner[c] for c in path], 1) for path in paths])
    inside = value[tetrahedra] < 0
    ordered = np.take_along_axis(tetrahedra, np.argsort(~inside, axis=1, kind="stable"), 1)
    edges: list[NDArray[np.int64]] = []
    ways: list[Floats] = []
    for count, cuts in (
        (1, ((0, 1), (0, 2), (0, 3))),
        (2, ((0, 2), (0, 3), (1, 3))),
        (2, ((0, 2), (1, 3), (1, 2))),
        (3, ((0, 3), (1, 3), (2, 3))),
    ):
        a = ordered[inside.sum(1) == count]
        edges.append(np.stack([a[:, list(cut)] for cut in cuts], 1))
        ways.append(points[a[:, count:]].mean(axis=1) - points[a[:, :count]].mean(axis=1))
    triangles = np.sort(np.concatenate(edges), axis=2)
    keys, faces = np.unique(triangles[:, :, 0] * len(points) + triangles[:, :, 1], return_inverse=True)
    i, j = keys // len(points), keys % len(points)
    share = (value[i] / (value[i] - value[j]))[:, None]
    vertices, faces = points[i] + share * (points[j] - points[i]), faces.reshape(-1, 3)
    back = np.einsum("ni,ni->n", normals(vertices, faces), np.concatenate(ways)) < 0
    faces[back] = faces[back][:, ::-1]
    return vertices, faces.astype(np.int32)


def normals(vertices: Floats, faces: NDArray[np.int32]) -> Floats:
    """Normals of faces, not of unit length."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


def gyroid(rng: np.random.Generator) -> Mesh:
    """Part of a thick gyroid inside a ball."""
    scale, thick, shift = rng.uniform(4, 8), rng.uniform(0.3, 0.9), rng.uniform(0, 6, 3)

    def field(p: Floats) -> Floats:
        x, y, z = np.moveaxis(scale * p + shift, -1, 0)
        sheet = np.abs(np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)) - thick
        return np.asarray(np.maximum(sheet, np.linalg.norm(p, axis=-1) - 0.9))

    return marched(field, int(rng.integers(12, 26)))


def torus(rng: np.random.Generator) -> Mesh:
    """Torus, its rings and sectors at even or random angles."""
    counts, thin = (int(rng.integers(20, 120)), int(rng.integers(8, 40))), rng.uniform(0.08, 0.3)
    u, v = (np.sort(rng.random(n)) * 2 * np.pi if rng.random() < 0.5 else np.arange(n) * 2 * np.pi / n for n in counts)
    u, v = np.meshgrid(u, v, indexing="ij")
    ring = 0.7 + thin * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), thin * np.sin(v)], -1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.indices(counts))
    a, b = i * counts[1] + j, (i + 1) % counts[0] * counts[1] + j
    c, d = (i + 1) % counts[0] * counts[1] + (j + 1) % counts[1], i * counts[1] + (j + 1) % counts[1]
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def hull(rng: np.random.Generator) -> Mesh:
    """Convex hull of random points: long thin triangles."""
    points = rng.normal(size=(int(rng.integers(6, 200)), 3)) * rng.uniform(0.1, 1, 3)
    found = ConvexHull(points / np.abs(points).max())
    faces = found.simplices.copy()
    back = np.einsum("ni,ni->n", normals(found.points, faces), found.equations[:, :3]) < 0
    faces[back] = faces[back][:, ::-1]
    return found.points, faces.astype(np.int32)


def blob(rng: np.random.Generator) -> Mesh:
    """Sphere with dents and bumps."""
    vertices, faces = icosphere(int(rng.integers(2, 5)), 1.0)
    x, y, z = (rng.uniform(2, 9) * vertices + rng.uniform(0, 6, 3)).T
    return vertices * (1 + rng.uniform(0, 0.35) * np.sin(x) * np.sin(y) * np.cos(z))[:, None], faces


def terrain(rng: np.random.Generator) -> Mesh:
    """Waves of several lengths, perhaps with noise, over a grid that may be very uneven."""
    count = int(rng.integers(10, 100))
    x = y = np.linspace(-1, 1, count + 1)
    if rng.random() < 0.5:
        x, y = (
            np.sort(np.concatenate([[-1, 1], rng.uniform(-1, 1, count - 1)])),
            np.sign(y) * np.abs(y) ** rng.uniform(1, 4),
        )
    x, y = np.meshgrid(x, y, indexing="ij")
    z = np.zeros_like(x)
    for octave in range(int(rng.integers(1, 6))):
        a, b = 2.0**octave * rng.normal(size=2) * 2
        z += rng.uniform(0.03, 0.3) / 2**octave * np.sin(a * x + b * y + rng.uniform(0, 6))
    if rng.random() < 0.4:
        z += rng.normal(size=z.shape) * rng.uniform(0.002, 0.02)
    i, j = (index.ravel() for index in np.indices((count, count)))
    a, b = i * (count + 1) + j, (i + 1) * (count + 1) + j
    faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    return np.stack([x, y, z], -1).reshape(-1, 3), faces.astype(np.int32)


KINDS: dict[str, Callable[[np.random.Generator], Mesh]] = {
    "gyroid": gyroid, "torus": torus, "hull": hull, "blob": blob, "terrain": terrain,
}  # fmt: skip
