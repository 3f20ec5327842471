"""The legend in the lower left: the temperature scale, the meaning of colours, and a scale bar."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch_tools.viewer import colours
from itouch_tools.viewer.buffers import Paint
from itouch_tools.viewer.colours import look
from itouch_tools.viewer.flat_shapes import Rectangle, rectangle, triangle
from itouch_tools.viewer.scales import length
from itouch_tools.viewer.temperatures import Range, degrees
from itouch_tools.viewer.text import Text

#: Width of the legend, in sizes of a letter; number of steps in the temperature scale.
WIDE, _PARTS = 27.0, 64


def draw(
    paint: Paint, text: Text, place: tuple[float, float], seen: NDArray[np.float64], size: float, *,
    title: str, marks: dict[str, float], skin: colours.Colour, ends: Range, metre: float,
) -> Rectangle:  # fmt: skip
    """Draw the legend and return its area [pixels].

    Parameters
    ----------
    place
        Left and bottom of the legend [pixels].
    seen
        The matrix from pixels to the clip space of OpenGL, shape (4, 4).
    title
        Title of the temperature scale; empty: no scale is drawn.
    marks
        Temperatures [K] that are marked on the scale.
    metre
        Length in pixels of a metre at the camera's target.
    """
    left, bottom = place
    area = (left, bottom, WIDE * size, (11.2 if title else 5.5) * size)
    x0, width, y0 = left + 1.5 * size, (WIDE - 3.0) * size, bottom + 7.2 * size
    rows = [rectangle(area, look().panel)]
    low, high = ends.ends
    for index in range(_PARTS if title else 0):
        kelvin = low + (high - low) * (index + 0.5) / _PARTS
        part = (x0 + width * index / _PARTS, y0, width / _PARTS + 0.5, size)
        rows.append(rectangle(part, (*ends.colour(kelvin), 1.0)))
    for kelvin in marks.values() if title else ():
        if math.isfinite(kelvin):
            along = min(1.0, max(0.0, (kelvin - low) / (high - low)))
            rows.append(triangle(x0 + width * along, y0 + 0.7 * size, 0.5 * size, (*look().words, 1.0)))
    x = x0
    for words, colour in (("HIP", colours.HIP), ("proxy", skin), ("force", colours.FORCE)):
        rows.append(rectangle((x, bottom + 3.6 * size, 0.9 * size, 0.9 * size), (*colour, 1.0)))
        text.put(words, x + 1.4 * size, bottom + 3.6 * size, look().quiet, size=0.85 * size)
        x += 8.0 * size
    rows.append(_bar(text, (x0, bottom + 1.2 * size), metre, 0.45 * width, size))
    paint.draw(gl.GL_TRIANGLES, np.vstack(rows), seen)
    if title:
        shown = min(1.0, (width + size) / (len(title) * text.width(0.9 * size)))  # so that it fits into the panel
        text.put(title, x0, y0 + 2.0 * size, look().words, size=0.9 * shown * size)
        for celsius in degrees(low, high):
            at = x0 + width * (celsius + 273.15 - low) / (high - low)
            text.put(f"{celsius:g}", at, y0 - 1.9 * size, look().quiet, size=0.85 * size, anchor="center")
    return area


def _bar(text: Text, place: tuple[float, float], metre: float, room: float, size: float) -> NDArray[np.float32]:
    """Return the triangles of the scale bar, and write its length beside it."""
    x, y = place
    if not (math.isfinite(metre) and metre > 0.0):
        return np.empty((0, 7), np.float32)
    metres = length(metre, room)
    wide, tint = metres * metre, (*look().words, 1.0)
    pieces = (
        (x, y + 0.25 * size, wide, 0.2 * size),
        (x, y, 0.2 * size, 0.7 * size),
        (x + wide, y, 0.2 * size, 0.7 * size),
    )
    said = f"{1e3 * metres:g} mm" if metres < 1.0 else f"{metres:g} m"
    said += " at the centre"  # nearer things appear larger
    text.put(said, x + wide + size, y, look().words, size=0.85 * size)
    return np.vstack([rectangle(piece, tint) for piece in pieces])
