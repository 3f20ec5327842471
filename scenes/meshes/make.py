"""Make the meshes of ``scenes/mesh.xml``: ``python scenes/meshes/make.py``.  They are of our own making, as the rest.

Coordinates are in millimetres, rounded to a thousandth, so that every machine writes the same bytes.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent


def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) of length 1 and faces (m, 3), fronts outside."""
    g = (1 + 5**0.5) / 2
    vertices = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g),
                (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]  # fmt: skip
    vertices = [tuple(np.array(v) / np.linalg.norm(v)) for v in vertices]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
             (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
             (8, 6, 7), (9, 8, 1)]  # fmt: skip
    for _ in range(subdivisions):
        middle: dict[tuple[int, int], int] = {}

        def between(a: int, b: int, known: dict[tuple[int, int], int] = middle) -> int:
            key = (min(a, b), max(a, b))
            if key not in known:
                known[key] = len(vertices)
                point = np.array(vertices[a]) + np.array(vertices[b])
                vertices.append(tuple(point / np.linalg.norm(point)))
            return known[key]

        split = []
        for a, b, c in faces:
            ab, bc, ca = between(a, b), between(b, c), between(c, a)
            split += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = split
    return np.array(vertices), np.array(faces)


def pebble() -> tuple[np.ndarray, np.ndarray]:
    """Return a closed, smooth pebble of about 52 x 38 x 22 mm with a shallow hollow on top for the fingertip [mm]."""
    directions, faces = icosphere(3)
    x, y, z = directions.T
    lumps = 1 + 0.04 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.03 * np.sin(4 * y + 2 * z)
    hollow = 1 - 0.22 * np.exp(-((x - 0.1) ** 2 + y**2) / 0.08) * (z > 0)
    return directions * (lumps * hollow)[:, None] * (26.0, 19.0, 11.0), faces


def relief() -> tuple[np.ndarray, np.ndarray]:
    """Return an open tile of 48 x 48 mm with ridges that run into rings, front up [mm]."""
    cells = 24
    line = np.linspace(-24.0, 24.0, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    z = 1.2 * np.cos(2 * np.pi * np.hypot(x, y) / 12.0) * np.exp(-((np.hypot(x, y) / 18.0) ** 4))
    i, j = (index.ravel() for index in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    a, b = i * (cells + 1) + j, (i + 1) * (cells + 1) + j
    faces = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    return np.stack([x, y, z], -1).reshape(-1, 3), faces


def stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a binary STL; the normals, which nobody needs, are zero."""
    corners = np.round(vertices, 3).astype("<f4")[faces].reshape(-1, 9)
    rows = b"".join(struct.pack("<3f", 0, 0, 0) + corner.tobytes() + b"\0\0" for corner in corners)
    return b"pebble, in millimetres".ljust(80) + struct.pack("<I", len(faces)) + rows


def obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """Return a Wavefront OBJ."""
    lines = ["# relief, in millimetres"]
    lines += ["v {:.3f} {:.3f} {:.3f}".format(*vertex).replace("-0.000", "0.000") for vertex in vertices]
    lines += ["f {} {} {}".format(*face) for face in faces + 1]
    return "\n".join([*lines, ""]).encode()


def contents() -> dict[str, bytes]:
    """Return file name -> content."""
    return {"pebble.stl": stl(*pebble()), "relief.obj": obj(*relief())}


if __name__ == "__main__":
    for name, content in contents().items():
        (FOLDER / name).write_bytes(content)
