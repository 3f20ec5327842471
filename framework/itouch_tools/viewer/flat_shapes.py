"""Flat shapes in pixels: filled rectangles, thick lines, marks; as vertices with position (3) and colour (4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float32]
Rectangle = tuple[float, float, float, float]
Tint = tuple[float, float, float, float]

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Look:
    """The colours of a picture: backgrounds, lines, words by weight; ``curve`` darkens curves on a light background."""

    panel: Tint
    axis: Tint
    fine: Tint
    words: Rgb
    quiet: Rgb
    good: Rgb
    warn: Rgb
    bad: Rgb
    help: Tint
    alarm: Tint
    ground: Rgb
    sky: Rgb
    grid: Rgb
    curve: float = 1.0

    def tint(self, weight: str) -> Rgb:
        """Return the colour of words of this weight: "plain" or a field's name."""
        found: Rgb = self.words if weight == "plain" else getattr(self, weight)
        return found

    def drawn(self, colour: Rgb) -> Rgb:
        """Return the colour in which a curve is drawn on this background."""
        return (self.curve * colour[0], self.curve * colour[1], self.curve * colour[2])


DARK = Look(
    panel=(0.045, 0.052, 0.068, 0.86), axis=(0.55, 0.58, 0.63, 0.9), fine=(0.45, 0.48, 0.53, 0.28),
    words=(0.88, 0.90, 0.93), quiet=(0.62, 0.65, 0.70), good=(0.45, 0.85, 0.65), warn=(0.95, 0.80, 0.35),
    bad=(1.00, 0.62, 0.48), help=(0.045, 0.052, 0.068, 0.97), alarm=(0.30, 0.06, 0.04, 0.94),
    ground=(0.105, 0.118, 0.145), sky=(0.045, 0.052, 0.068), grid=(0.27, 0.29, 0.34),
)  # fmt: skip
LIGHT = Look(
    panel=(0.975, 0.98, 0.985, 0.92), axis=(0.35, 0.38, 0.43, 0.9), fine=(0.45, 0.48, 0.53, 0.30),
    words=(0.10, 0.12, 0.15), quiet=(0.33, 0.36, 0.41), good=(0.00, 0.40, 0.24), warn=(0.52, 0.36, 0.00),
    bad=(0.68, 0.12, 0.02), help=(0.975, 0.98, 0.985, 0.98), alarm=(1.00, 0.90, 0.87, 0.97),
    ground=(0.80, 0.82, 0.85), sky=(0.93, 0.94, 0.96), grid=(0.62, 0.65, 0.70), curve=0.62,
)  # fmt: skip


class _Shown:
    look = DARK


def look() -> Look:
    """Return the colours of the picture that is being drawn."""
    return _Shown.look


def draw_in(chosen: Look) -> None:
    """Draw in these colours from now on."""
    _Shown.look = chosen


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
