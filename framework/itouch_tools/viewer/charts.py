"""Drawing of the charts: curves of the last seconds with axes and keys."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch_tools.viewer import chart_layout
from itouch_tools.viewer.buffers import Paint
from itouch_tools.viewer.colours import look
from itouch_tools.viewer.flat_shapes import Rectangle, line, rectangle, ribbon
from itouch_tools.viewer.scales import titled
from itouch_tools.viewer.signals import WINDOW, Chart, Curves, Signal
from itouch_tools.viewer.text import Text

Values = NDArray[np.float64]

#: Seconds between two lines of the time axis; length of a dash and of the gap after it [s].
STEP = 2.0
_DASH = 0.12


def draw(
    ring: Curves, paint: Paint, text: Text, area: Rectangle, seen: NDArray[np.float64], size: float, *,
    pointed: tuple[float, float] = (-1.0, -1.0),
) -> None:  # fmt: skip
    """Draw all charts into an area [pixels], one under the other, or side by side if it is wide.

    All have the same time axis; where the mouse points into one, a line stands at that time in all, and their keys show
    the values at that time.  ``seen`` (4, 4) transforms pixels to the clip space of OpenGL.
    """
    places = chart_layout.arranged(len(ring.charts), area, size)
    times = (chart_layout.pointed_time(place, foot, pointed, size) for place, foot in places)
    cursor = next((time for time in times if time is not None), None)
    preparing = ring.preparing()
    for (place, foot), chart in zip(places, ring.charts, strict=False):
        _chart(ring, chart, paint, text, place, seen, size, foot=foot, cursor=cursor, preparing=preparing)


def _chart(
    ring: Curves, chart: Chart, paint: Paint, text: Text, area: Rectangle, seen: NDArray[np.float64], size: float, *,
    foot: float, cursor: float | None, preparing: list[tuple[float, float]],
) -> None:  # fmt: skip
    left, bottom, width, height = area
    paint.draw(gl.GL_TRIANGLES, rectangle(area, look().panel), seen)
    title = titled(chart.title, chart.unit, int((width - 1.8 * size) / text.width(size)))
    text.put(title, left + 0.9 * size, bottom + height - 1.8 * size, look().words, size=size)
    if chart_layout.inner(area, foot, size)[3] < chart_layout.LEAST_INNER * size:
        return
    times, values = ring.curves(chart)
    keys = (left + 0.9 * size, bottom + height - 3.5 * size, width - 1.8 * size, size)
    most = chart_layout.key_lines(area, foot, size)
    told = _keys(chart, values, chart_layout.sample(times, cursor), paint, text, keys, seen, most)
    x0, y0, w, h = chart_layout.inner(area, foot, size, told)
    low, high = span(values, chart.least)
    lines = []
    for value in ticks(low, high, round(h / (2.0 * size))):
        y = y0 + h * (value - low) / (high - low)
        lines.append(line((x0, y), (x0 + w, y), look().fine if value else look().axis))
        text.put(f"{value:g}", x0 - 0.5 * size, y - 0.35 * size, look().quiet, size=0.85 * size, anchor="right")
    end = float(times[-1]) if len(times) else 0.0
    _mark(preparing, end, paint, text if chart is ring.charts[0] else None, (x0, y0, w, h), seen, size)
    lines += _time_axis(text, (x0, y0, w, h), size, words=foot > 2.0 * size, cursor=cursor)
    paint.draw(gl.GL_LINES, np.vstack(lines), seen)
    curves = [np.empty((0, 7), np.float32)]
    for row, signal in sorted(zip(values, chart.signals, strict=True), key=lambda pair: pair[1].dashed):
        x = x0 + w * (1.0 + (times - end) / WINDOW)
        y = y0 + h * (np.clip(row, low, high) - low) / (high - low)
        drawn = np.floor(times[1:] / _DASH) % 2 == 0 if signal.dashed else None
        curves.append(ribbon(x, y, (*look().drawn(signal.colour), 1.0), 0.12 * size, drawn=drawn))
    with clipped((x0, y0, w, h)):
        paint.draw(gl.GL_TRIANGLES, np.vstack(curves), seen)


def _mark(
    preparing: list[tuple[float, float]], end: float, paint: Paint, text: Text | None, area: Rectangle,
    seen: NDArray[np.float64], size: float,
) -> None:  # fmt: skip
    """Mark when the rig found its heights: the pulses of force there are its own, and not the touch of an object.

    ``text`` says so, in the first chart.
    """
    x0, y0, w, h = area
    for begin, last in preparing:
        left, right = (x0 + w * max(0.0, 1.0 + (time - end) / WINDOW) for time in (begin, last))
        paint.draw(gl.GL_TRIANGLES, rectangle((left, y0, right - left, h), (*look().quiet, 0.13)), seen)
        words, small = "finds its heights", 0.8 * size
        if text is not None and right - left > (len(words) + 1) * text.width(small):
            text.put(words, 0.5 * (left + right), y0 + h - 1.1 * size, look().quiet, size=small, anchor="center")


@contextlib.contextmanager
def clipped(area: Rectangle) -> Iterator[None]:
    """Draw nothing outside an area of the picture [pixels] while the context lasts."""
    gl.glEnable(gl.GL_SCISSOR_TEST)
    gl.glScissor(*(max(0, round(value)) for value in area))
    try:
        yield
    finally:
        gl.glDisable(gl.GL_SCISSOR_TEST)


def _time_axis(
    text: Text, area: Rectangle, size: float, *, words: bool, cursor: float | None
) -> list[NDArray[np.float32]]:
    """Return the lines of the time axis and of the cursor, and draw their numbers."""
    x0, y0, w, h = area
    lines = []
    told = STEP if w * STEP / WINDOW > 5.0 * text.width(0.85 * size) else WINDOW / 2
    for seconds in np.arange(-WINDOW, 0.5 * STEP, STEP):
        x = x0 + w * (1.0 + seconds / WINDOW)
        lines.append(line((x, y0), (x, y0 + h), look().fine))
    for seconds in np.arange(-WINDOW, 0.5 * told, told):
        x = x0 + w * (1.0 + seconds / WINDOW)
        hidden = cursor is not None and abs(seconds - cursor) * w / WINDOW < 5.5 * text.width(0.85 * size)
        if words and not hidden:
            said = f"{seconds:g}" if seconds else "now"
            text.put(said + (" s" if seconds == -WINDOW else ""), x, y0 - 1.9 * size, look().quiet, size=0.85 * size,
                     anchor="center")  # fmt: skip
    if cursor is not None:
        x = x0 + w * (1.0 + cursor / WINDOW)
        lines.append(line((x, y0), (x, y0 + h), (*look().words, 1.0)))
        if words:
            text.put(f"{cursor:.2f} s", x, y0 - 1.9 * size, look().words, size=0.85 * size, anchor="center")
    return lines


def _keys(
    chart: Chart, values: Values, index: int, paint: Paint, text: Text, place: Rectangle, seen: NDArray[np.float64],
    most: int,
) -> int:  # fmt: skip
    """Draw the key: each curve's line and name, and its value at a sample if all have room in a line.

    Names that have no room in one line go on in others, at most ``most``.  Returns the number of lines.
    """
    left, y, width, size = place
    small = 0.9 * size
    letter = text.width(small)
    shown = [(row, s) for row, s in zip(values, chart.signals, strict=True) if not _silent(row, s, index)]
    signals = [signal for _, signal in shown]
    said = [f"{signal.label} {chart_layout.told(row, chart.digits, index)}" for row, signal in shown]
    places = chart_layout.keyed(said, width, letter, size)
    if any(row for row, _ in places):
        said = [signal.label for signal in signals]
        places = chart_layout.keyed(said, width, letter, size)
    lines = 1
    for words, signal, (row, right) in zip(said, signals, places, strict=True):
        if row >= most:
            break
        lines, x, foot = row + 1, left + right, y - chart_layout.KEY * size * row
        for begin, end in ((0.0, 0.7), (1.1, 1.8)) if signal.dashed else ((0.0, 1.8),):
            piece = (x + begin * size, foot + 0.3 * size, (end - begin) * size, 0.28 * size)
            paint.draw(gl.GL_TRIANGLES, rectangle(piece, (*look().drawn(signal.colour), 1.0)), seen)
        text.put(words, x + chart_layout.SWATCH * size, foot, look().drawn(signal.colour), size=small)
    return lines


def _silent(row: Values, signal: Signal, index: int) -> bool:
    """Tell whether a curve is the one of a reading's two forms, measured or held, that has no value at a sample."""
    return signal.held is not None and not (0 <= index < len(row) and math.isfinite(row[index]))


def span(values: Values, least: float) -> tuple[float, float]:
    """Return the ends of an axis that holds all values, of any shape, and spans ``least`` at least [chart's unit]."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, least or 1.0)
    if low > 0.0 and low < 0.5 * high:
        low = 0.0
    least = least or max(1e-2 * max(abs(low), abs(high)), 1e-12)
    room = max(least - (high - low), 0.08 * (high - low))
    return low - room / 2, high + room / 2


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round numbers between two ends: about ``most`` of them at most, and in most cases two or more."""
    raw = (high - low) / max(2, min(most, 5))
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= raw * 0.999)
    return [round(i * step, 12) for i in range(math.ceil(low / step), math.floor(high / step) + 1)]
