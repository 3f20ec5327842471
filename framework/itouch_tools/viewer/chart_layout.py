"""Layout of the charts in a picture, the time that is pointed at, and the values in their keys; without graphics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch_tools.viewer.flat_shapes import Rectangle
from itouch_tools.viewer.signals import WINDOW

Values = NDArray[np.float64]

#: Least height of a chart, in sizes of a letter; where there is less room, the last charts are left out.
LEAST_HEIGHT = 10.5
#: Least width of a chart that stands beside others, in sizes of a letter.
LEAST_WIDTH = 34.0
#: Height of the time axis's labels, the gap between two charts, and the height of a line of keys, in sizes of a letter.
_AXIS, _GAP, KEY = 2.4, 0.8, 1.7
#: Width of a key's line with the space after it, in sizes of a letter; space between two keys, in widths of a letter.
SWATCH, _APART = 2.3, 1.6
#: Least height of the part with the curves, in sizes of a letter.
LEAST_INNER = 3.0


def arranged(count: int, area: Rectangle, size: float) -> list[tuple[Rectangle, float]]:
    """Return the areas of as many charts as there is room for, each with the height of the time labels below it."""
    left, bottom, width, height = area
    gap, axis = _GAP * size, _AXIS * size
    columns = max(1, min(count, int((width + gap) / (LEAST_WIDTH * size + gap))))
    wide = (width - gap * (columns - 1)) / columns
    rows = min(-(-count // columns), max(1, int((height - axis + gap) / (LEAST_HEIGHT * size + gap))))
    most = max(0.32 * height, LEAST_HEIGHT * size) if columns == 1 else height
    each = min((height - axis - gap * (rows - 1)) / max(rows, 1), most)
    found = []
    for index in range(min(count, rows * columns)):
        row, column = divmod(index, columns)
        foot = axis if row == rows - 1 or index + columns >= count else 0.0
        below = bottom + height - (row + 1) * each - row * gap - (axis if row == rows - 1 else 0.0)
        high = each + (axis if row == rows - 1 else 0.0)
        found.append(((left + column * (wide + gap), below, wide, high), foot))
    return found


def keyed(words: Sequence[str], width: float, letter: float, size: float) -> list[tuple[int, float]]:
    """Return the line, from 0, and the left end [pixels] of each key; one that has no room beside others begins a line.

    ``width`` and ``letter`` are those of a line and of a letter [pixels].
    """
    found, x, line = [], 0.0, 0
    for said in words:
        wide = SWATCH * size + len(said) * letter
        if x > 0.0 and x + wide > width:
            x, line = 0.0, line + 1
        found.append((line, x))
        x += wide + _APART * letter
    return found


def key_lines(area: Rectangle, foot: float, size: float) -> int:
    """Return for how many lines of keys a chart has room, one at least."""
    room = inner(area, foot, size)[3] - LEAST_INNER * size
    return 1 + max(0, int(room / (KEY * size)))


def inner(area: Rectangle, foot: float, size: float, lines: int = 1) -> Rectangle:
    """Return the part of a chart's area in which its curves are drawn, below some lines of keys."""
    left, bottom, width, height = area
    head, foot = (4.3 + KEY * (lines - 1)) * size, foot + 0.9 * size
    return left + 5.0 * size, bottom + foot, width - 6.4 * size, height - foot - head


def pointed_time(area: Rectangle, foot: float, pointed: tuple[float, float], size: float) -> float | None:
    """Return the time [s] relative to now at which the mouse points in a chart; None if it points at none."""
    x0, y0, w, h = inner(area, foot, size)
    x, y = pointed
    return WINDOW * ((x - x0) / w - 1.0) if w > 0.0 and x0 <= x <= x0 + w and y0 <= y <= y0 + h else None


def sample(times: Values, cursor: float | None) -> int:
    """Return the index of the sample whose values the keys show: that at the cursor, else the newest.

    ``times`` (n,) [s] ascend; ``cursor`` [s] is relative to the newest, 0 or less.  Where there is no sample at the
    cursor, the index is n; without a cursor or any sample, it is n - 1.
    """
    if cursor is None or not len(times):
        return len(times) - 1
    found = int(np.searchsorted(times, times[-1] + cursor))
    return found if times[-1] + cursor >= times[0] else len(times)


def told(row: Values, digits: str, index: int) -> str:
    """Return the sample of a curve (n,) at this index as text, in the curve's unit; ``--`` where there is none."""
    return format(row[index], digits) if 0 <= index < len(row) and math.isfinite(row[index]) else "--"
