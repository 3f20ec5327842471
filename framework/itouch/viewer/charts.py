"""Draws the curves of the last seconds, and the scale of temperatures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch.viewer import colours
from itouch.viewer.buffers import Paint
from itouch.viewer.signals import WINDOW, Chart, Ring
from itouch.viewer.words import Text

Rows = NDArray[np.float32]
Rectangle = tuple[float, float, float, float]

_PANEL = (0.05, 0.06, 0.08, 0.80)
_AXIS = (0.45, 0.48, 0.53, 0.8)
_FAINT = (0.45, 0.48, 0.53, 0.25)
_WORDS = (0.78, 0.80, 0.84)


def pixels(width: int, height: int) -> NDArray[np.float64]:
    """Return the matrix (4, 4) of a picture in pixels from its lower left."""
    matrix = np.diag((2.0 / width, 2.0 / height, 1.0, 1.0))
    matrix[0, 3] = matrix[1, 3] = -1.0
    return matrix


def draw(ring: Ring, paint: Paint, text: Text, area: Rectangle, seen: NDArray[np.float64], size: float) -> None:
    """Draw all charts of a ring, one under the other, into an area: left, bottom, width, height [pixels]."""
    left, bottom, width, height = area
    count = len(ring.charts)
    each = min((height - 8.0 * (count - 1)) / max(count, 1), 0.3 * height)
    for index, chart in enumerate(ring.charts):
        below = bottom + height - (index + 1) * each - index * 8.0
        _chart(ring, chart, paint, text, (left, below, width, each), seen, size)


def _chart(
    ring: Ring, chart: Chart, paint: Paint, text: Text, area: Rectangle, seen: NDArray[np.float64], size: float
) -> None:
    left, bottom, width, height = area
    paint.draw(gl.GL_TRIANGLES, rectangle(area, _PANEL), seen)
    head, foot, gutter = 2.1 * size * 1.7, 0.5 * size, 4.2 * size
    x0, y0, w, h = left + gutter, bottom + foot, width - gutter - size, height - foot - head
    times, values = ring.curves(chart)
    low, high = span(values, chart.least)
    end = float(times[-1]) if len(times) else 0.0
    text.put(f"{chart.title} [{chart.unit}]", left + 0.6 * size, bottom + height - 1.6 * size, _WORDS, size=size)
    _keys(chart, text, left + 0.6 * size, bottom + height - 3.2 * size, size)
    for value in ticks(low, high):
        y = y0 + h * (value - low) / (high - low)
        paint.draw(gl.GL_LINES, _line((x0, y), (x0 + w, y), _FAINT if value else _AXIS), seen)
        text.put(f"{value:g}", x0 - 0.4 * size, y - 0.4 * size, _WORDS, size=0.85 * size, anchor="right")
    for row, signal in zip(values, chart.signals, strict=True):
        known = np.isfinite(row)
        x = x0 + w * (1.0 + (times[known] - end) / WINDOW)
        y = y0 + h * (np.clip(row[known], low, high) - low) / (high - low)
        paint.draw(gl.GL_TRIANGLES, ribbon(x, y, (*signal.colour, 1.0), 0.11 * size), seen)


def _keys(chart: Chart, text: Text, left: float, y: float, size: float) -> None:
    for signal in chart.signals:
        words = f"- {signal.label}"
        text.put(words, left, y, signal.colour, size=0.85 * size)
        left += (len(words) + 1.5) * text.width(0.85 * size)


def span(values: NDArray[np.float64], least: float) -> tuple[float, float]:
    """Return the ends of an axis that holds all values, at least ``least`` high."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, least)
    if low > 0.0 and low < 0.5 * high:
        low = 0.0
    room = max(least - (high - low), 0.08 * (high - low))
    return low - room / 2, high + room / 2


def ticks(low: float, high: float) -> list[float]:
    """Return three to six round numbers between two ends."""
    raw = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= raw * 0.999)
    return [round(i * step, 12) for i in range(math.ceil(low / step), math.floor(high / step) + 1)]


def scale(paint: Paint, text: Text, left: float, bottom: float, seen: NDArray[np.float64], size: float) -> None:
    """Draw the scale of temperatures with its legend in degC."""
    width, height, parts = 16 * size, 0.9 * size, 64
    paint.draw(gl.GL_TRIANGLES, rectangle((left - size, bottom - 2.2 * size, width + 2 * size, 5.2 * size), _PANEL),
               seen)  # fmt: skip
    for index in range(parts):
        kelvin = colours.COLD + (colours.WARM - colours.COLD) * (index + 0.5) / parts
        part = (left + width * index / parts, bottom, width / parts + 0.5, height)
        paint.draw(gl.GL_TRIANGLES, rectangle(part, (*colours.of_temperature(kelvin), 1.0)), seen)
    text.put("skin, plate [degC]", left, bottom + 1.5 * size, _WORDS, size=0.85 * size)
    for celsius in (15, 20, 25, 30, 35, 40):
        at = left + width * (celsius + 273.15 - colours.COLD) / (colours.WARM - colours.COLD)
        text.put(f"{celsius}", at, bottom - 1.4 * size, _WORDS, size=0.85 * size, anchor="center")


def rectangle(area: Rectangle, colour: tuple[float, float, float, float]) -> Rows:
    """Return two triangles that fill a rectangle."""
    x, y, w, h = area
    corners = [(x, y), (x + w, y), (x + w, y + h), (x, y), (x + w, y + h), (x, y + h)]
    return np.array([(a, b, 0.0, *colour) for a, b in corners], np.float32)


def ribbon(
    x: NDArray[np.float64], y: NDArray[np.float64], colour: tuple[float, float, float, float], half: float
) -> Rows:
    """Return triangles of a line of constant width through points, shape (6 (n - 1), 7)."""
    if len(x) < 2:
        return np.empty((0, 7), np.float32)
    ends = np.stack([x, y], 1)
    along = np.diff(ends, axis=0)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    side = half * np.stack([-along[:, 1], along[:, 0]], 1)
    a, b = ends[:-1] - half * along, ends[1:] + half * along
    quads = np.stack([a - side, b - side, b + side, a - side, b + side, a + side], 1).reshape(-1, 2)
    rows = np.zeros((len(quads), 7), np.float32)
    rows[:, :2], rows[:, 3:] = quads, colour
    return rows


def _line(a: tuple[float, float], b: tuple[float, float], colour: tuple[float, float, float, float]) -> Rows:
    return np.array([(*a, 0.0, *colour), (*b, 0.0, *colour)], np.float32)
