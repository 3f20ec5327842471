"""Flat shapes in pixels: filled rectangles, thick lines, marks; as vertices with position (3) and colour (4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch_tools.viewer.colours import Tint

Rows = NDArray[np.float32]
Rectangle = tuple[float, float, float, float]


def pixels(width: int, height: int) -> NDArray[np.float64]:
    """Return the matrix (4, 4) to clip space from pixels, counted from a picture's lower left."""
    matrix = np.diag((2.0 / width, 2.0 / height, 1.0, 1.0))
    matrix[0, 3] = matrix[1, 3] = -1.0
    return matrix


def rectangle(area: Rectangle, colour: Tint, upper: Tint | None = None) -> Rows:
    """Return two triangles that fill a rectangle; ``upper`` is the colour at its upper edge, if it differs."""
    x, y, w, h = area
    above = colour if upper is None else upper
    corners = [(x, y, colour), (x + w, y, colour), (x + w, y + h, above), (x, y, colour), (x + w, y + h, above),
               (x, y + h, above)]  # fmt: skip
    return np.array([(a, b, 0.0, *tint) for a, b, tint in corners], np.float32)


def border(area: Rectangle, width: float, colour: Tint) -> Rows:
    """Return the triangles of a rectangle's border, which lies inside it."""
    x, y, w, h = area
    sides = ((x, y, w, width), (x, y + h - width, w, width), (x, y, width, h), (x + w - width, y, width, h))
    return np.vstack([rectangle(side, colour) for side in sides])


def diamond(x: float, y: float, half: float, colour: Tint) -> Rows:
    """Return two triangles that fill a square standing on its corner."""
    ends = [(x - half, y), (x, y - half), (x + half, y), (x - half, y), (x + half, y), (x, y + half)]
    return np.array([(a, b, 0.0, *colour) for a, b in ends], np.float32)


def triangle(x: float, y: float, half: float, colour: Tint) -> Rows:
    """Return a triangle that points downwards, with its tip at (x, y)."""
    corners = ((x, y), (x + half, y + 1.7 * half), (x - half, y + 1.7 * half))
    return np.array([(a, b, 0.0, *colour) for a, b in corners], np.float32)


def ribbon(x: NDArray[np.float64], y: NDArray[np.float64], colour: Tint, half: float, *,
           drawn: NDArray[np.bool_] | None = None) -> Rows:  # fmt: skip
    """Return triangles of a line of constant width through points, shape (6 m, 7) for m drawn segments.

    ``drawn`` (n - 1,) says which segments are drawn; default: all. One that has an end which is not finite never is.

    ``x`` and ``y`` (n,) and ``half``, half of the width, are in [pixels].
    """
    if len(x) < 2:
        return np.empty((0, 7), np.float32)
    ends = np.stack([x, y], 1)
    kept = np.isfinite(ends[:-1]).all(1) & np.isfinite(ends[1:]).all(1)
    if drawn is not None:
        kept &= drawn
    first, second = ends[:-1][kept], ends[1:][kept]
    along = second - first
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    side = half * np.stack([-along[:, 1], along[:, 0]], 1)
    a, b = first - half * along, second + half * along
    quads = np.stack([a - side, b - side, b + side, a - side, b + side, a + side], 1).reshape(-1, 2)
    rows = np.zeros((len(quads), 7), np.float32)
    rows[:, :2], rows[:, 3:] = quads, colour
    return rows


def line(a: tuple[float, float], b: tuple[float, float], colour: Tint) -> Rows:
    """Return the two ends of a thin line, for GL_LINES."""
    return np.array([(*a, 0.0, *colour), (*b, 0.0, *colour)], np.float32)
