"""The surfaces and the paths over them on which contact is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Surface
from itouch.contact.vectors import Floats

Faces = NDArray[np.int32]

TICK = 1e-3
DEPTH = 0.01  # amplitude of the path's depth below the surface [m]
HEIGHT_FIELD_CELLS = {"1k": 22, "10k": 71, "100k": 224, "1M": 707}
SPHERE_SUBDIVISIONS = {"1k": 3, "10k": 5, "100k": 6, "1M": 8}


@dataclass(frozen=True, slots=True)
class Work:
    """A surface with a path over it, on which the HIP is below the offset surface half of the time.

    Attributes
    ----------
    vertices, faces
        (v, 3) [m] and (m, 3).
    hips
        (n, 3) [m], one per millisecond.
    radius
        Radius of the probe [m].
    two_sided
        Whether the surface can be touched from both sides.
    """

    name: str
    vertices: Floats
    faces: Faces
    hips: Floats
    radius: float
    two_sided: bool = False


def height_field(cells: int) -> tuple[Floats, Faces]:
    """Return triangles of z = 0.05 sin(3 pi x) cos(3 pi y) over a square of side 1 m, cells split along a diagonal."""
    line = np.linspace(-0.5, 0.5, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    v00, v10 = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
    faces = np.concatenate([np.stack([v00, v10, v10 + 1], 1), np.stack([v00, v10 + 1, v00 + 1], 1)])
    return vertices, faces.astype(np.int32)


def height(x: Floats, y: Floats) -> Floats:
    """Return the height of the field at (x, y) [m]."""
    return np.asarray(0.05 * np.sin(3 * np.pi * x) * np.cos(3 * np.pi * y))


def icosphere(subdivisions: int, radius: float = 0.5) -> tuple[Floats, Faces]:
    """Return triangles of a sphere: an icosahedron whose faces are repeatedly split into four."""
    g = (1 + 5**0.5) / 2
    corners = np.array([(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)], dtype=float)
    vertices = np.concatenate([corners, np.roll(corners, 1, axis=1), np.roll(corners, 2, axis=1)])
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    away = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = (away > 0) & (away < 1.1 * away[away > 0].min())
    faces = np.array([(a, b, c) for a in range(12) for b in range(a) for c in range(b)
                      if near[a, b] and near[b, c] and near[a, c]])  # fmt: skip
    outward = np.einsum("ni,ni->n", np.cross(*(vertices[faces[:, i]] for i in (0, 1))), vertices[faces[:, 2]]) > 0
    faces = np.where(outward[:, None], faces, faces[:, ::-1])
    for _ in range(subdivisions):
        ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        keys, position = np.unique(ends[:, 0] * len(vertices) + ends[:, 1], return_inverse=True)
        middles = vertices[keys // len(vertices)] + vertices[keys % len(vertices)]
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        ab, bc, ca = (len(vertices) + position.reshape(3, -1)).astype(faces.dtype)
        a, b, c = faces.T
        vertices = np.concatenate([vertices, middles])
        faces = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return vertices * radius, faces.astype(np.int32)


def depth(steps: int) -> Floats:
    """Return the height of the HIP above the offset surface (steps,) [m], one per millisecond; below 0 it presses."""
    return np.asarray(DEPTH * np.sin(2 * np.pi * 0.5 * TICK * np.arange(steps)))


def over_height_field(steps: int, speed: float, radius: float) -> Floats:
    """Return a path over the height field (steps, 3) [m]."""
    s = speed * TICK * np.arange(steps)
    x, y = 0.4 * np.sin(2 * np.pi * 0.31 * s), 0.4 * np.sin(2 * np.pi * 0.23 * s + 0.5)
    return np.stack([x, y, height(x, y) + radius + depth(steps)], axis=1)


def directions(steps: int, speed: float) -> Floats:
    """Return the directions from a sphere's centre along a path over it (steps, 3)."""
    s = speed * TICK * np.arange(steps)
    theta, phi = np.pi / 2 + 0.9 * np.sin(2 * np.pi * 0.23 * s), 2.5 * np.sin(2 * np.pi * 0.17 * s)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def standard(kind: str, size: str, steps: int, speed: float, radius: float) -> Work:
    """Return a standard work: kind "hf" (height field) or "ico" (icosphere), size "1k" to "1M"."""
    if kind == "hf":
        vertices, faces = height_field(HEIGHT_FIELD_CELLS[size])
        return Work(f"hf {size}", vertices, faces, over_height_field(steps, speed, radius), radius)
    vertices, faces = icosphere(SPHERE_SUBDIVISIONS[size])
    hips = directions(steps, speed) * (0.5 + radius + depth(steps))[:, None]
    return Work(f"ico {size}", vertices, faces, hips, radius)


def around(name: str, vertices: Floats, faces: Faces, steps: int, speed: float) -> Work:
    """Return a work with a path over any surface: along the nearest points to a point that moves around it.

    Lengths are in proportion to the surface's size.

    A surface that is no solid is touched from both sides, because the path goes around it.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3).
    """
    middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    size = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    radius = 0.02 * size
    outside = middle + size * directions(steps, speed)
    surface = Surface(vertices, faces)
    feet, away, _ = surface.closest(outside)
    hips = feet + (outside - feet) / away[:, None] * (radius + size * depth(steps))[:, None]
    return Work(name, vertices, faces, hips, radius, two_sided=not surface.is_solid)
