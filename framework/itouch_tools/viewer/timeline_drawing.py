"""Draws the time line of a recording, and finds the time under the mouse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch_tools.viewer import colours
from itouch_tools.viewer.buffers import Paint
from itouch_tools.viewer.colours import look
from itouch_tools.viewer.flat_shapes import Rectangle, diamond, rectangle
from itouch_tools.viewer.text import Text
from itouch_tools.viewer.timeline import Timeline

_TRACK, _KNOWN, _DARK = (0.20, 0.22, 0.26, 1.0), (0.34, 0.37, 0.43, 1.0), (0.02, 0.03, 0.05)
_HELP = "P play   left right: a tick   up down: speed   page: next contact"


def bar(area: Rectangle, size: float) -> Rectangle:
    """Return the part of a time line's area that responds to the mouse: left, bottom, width, height [pixels]."""
    left, bottom, width, _ = area
    return left + 1.2 * size, bottom + 0.9 * size, width - 2.4 * size, 1.5 * size


def time_at(line: Timeline, place: Rectangle, x: float) -> float:
    """Return the time [s] at a pixel of the bar; beyond an end, the time of that end."""
    left, _, width, _ = place
    return line.first + (line.last - line.first) * min(1.0, max(0.0, (x - left) / max(width, 1.0)))


def draw(line: Timeline, paint: Paint, text: Text, area: Rectangle, seen: NDArray[np.float64], size: float) -> None:
    """Draw a time line into an area: left, bottom, width, height [pixels].

    ``seen`` (4, 4) transforms pixels to the clip space of OpenGL; ``size`` is that of letters, and the unit of layout.
    """
    paint.draw(gl.GL_TRIANGLES, rectangle(area, look().panel), seen)
    left, bottom, width, height = place = bar(area, size)
    upper = area[1] + area[3] - 1.9 * size
    text.put(line.words(), area[0] + 1.2 * size, upper, look().words, size=size)
    text.put(_HELP, area[0] + area[2] - 1.2 * size, upper, look().quiet,
             size=0.85 * size, anchor="right")  # fmt: skip
    parts = [rectangle(place, _TRACK)]
    each = width / len(line.known)
    parts += [rectangle((left + i * each, bottom, each + 0.5, height), _KNOWN) for i in np.nonzero(line.known)[0]]
    for begin, end, _ in line.spans:
        x = left + width * line.share(begin)
        long = max(2.0, width * line.share(end) - width * line.share(begin))
        parts.append(rectangle((x, bottom, long, height), (*colours.CURVES[0], 0.75)))
    for number, times in ((4, line.marks), (5, line.faults)):
        tint = (*colours.CURVES[number], 1.0)
        for seconds, _ in times:
            x = left + width * line.share(seconds)
            parts.append(rectangle((x - 1.0, bottom - 0.3 * size, 2.0, height + 0.6 * size), tint))
            parts.append(diamond(x, bottom + height + 0.4 * size, 0.45 * size, tint))
    x = left + width * line.share(line.now)
    parts.append(rectangle((x - 1.5, bottom - 0.4 * size, 3.0, height + 0.8 * size), (1.0, 1.0, 1.0, 1.0)))
    paint.draw(gl.GL_TRIANGLES, np.vstack(parts), seen)
    _names(line, text, place, size)


def _names(line: Timeline, text: Text, place: Rectangle, size: float) -> None:
    """Draw the names of contacts in their spans, and of marks and faults above, as far as there is room."""
    left, bottom, width, height = place
    letter, free = text.width(0.8 * size), 0.0
    for begin, end, name in line.spans:
        room = width * (line.share(end) - line.share(begin))
        if len(name) * letter < room - 4:
            middle = left + width * (line.share(begin) + line.share(end)) / 2
            text.put(name, middle, bottom + 0.4 * size, _DARK, size=0.8 * size, anchor="center")
    for seconds, name in sorted((*line.marks, *line.faults)):
        x = left + width * line.share(seconds) + 0.6 * size
        if x >= free and x + len(name) * letter < left + width:
            text.put(name, x, bottom + height + 0.15 * size, look().words, size=0.8 * size)
            free = x + (len(name) + 1) * letter
