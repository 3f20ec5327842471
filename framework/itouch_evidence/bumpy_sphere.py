"""A closed mesh with any number of triangles, to draw: a sphere with bumps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def bumpy_sphere(triangles: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return vertices (v, 3) [m] and faces (n, 3) of a closed surface of about ``triangles`` triangles."""
    rings = max(4, round((triangles / 4) ** 0.5))
    around = 2 * rings
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, rings + 1)[1:-1], np.arange(around) * 2 * np.pi / around,
                                 indexing="ij")  # fmt: skip
    radius = 0.03 * (1 + 0.05 * np.sin(7 * azimuth) * np.sin(5 * polar))
    body = np.stack([radius * np.sin(polar) * np.cos(azimuth), radius * np.sin(polar) * np.sin(azimuth),
                     radius * np.cos(polar)], 2).reshape(-1, 3)  # fmt: skip
    vertices = np.vstack([body, [0, 0, 0.03], [0, 0, -0.03]])
    row, column = np.meshgrid(np.arange(rings - 2), np.arange(around), indexing="ij")
    a, b = (row * around + column).ravel(), (row * around + (column + 1) % around).ravel()
    c, d = a + around, b + around
    sides = np.vstack([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    first, last = np.arange(around), (rings - 2) * around + np.arange(around)
    north, south = len(body), len(body) + 1
    top = np.stack([np.full(around, north), first, np.roll(first, -1)], 1)
    bottom = np.stack([np.full(around, south), np.roll(last, -1), last], 1)
    return vertices, np.vstack([sides, top, bottom])


def write_stl(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> None:
    """Write a mesh as a binary STL file, in millimetres.

    ``vertices`` (v, 3) [m], ``faces`` (n, 3).
    """
    rows = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    rows["corners"] = 1e3 * vertices[faces]
    path.write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + rows.tobytes())
