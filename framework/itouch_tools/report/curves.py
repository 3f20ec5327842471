"""Curves for a session's page: over the whole session and over each contact, thinned so that no peak is lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.viewer.signals import charts

#: Most points of a curve of the whole session, of one contact, and of all contacts together.
MOST_WHOLE, MOST_CONTACT, MOST_CONTACTS = 6000, 1500, 60_000
#: Most numbers of the whole session, and of all contacts: with many signals fewer points, so that the page stays small.
NUMBERS_WHOLE, NUMBERS_CONTACTS = 140_000, 1_050_000
#: Fewest points of a contact: with more contacts than the total admits, the last ones have no curves of their own.
LEAST_CONTACT = 120
#: Seconds shown before and after a contact.
MARGIN = 0.5
#: Most numbers that are kept while a recording is read; a longer recording is sampled less often.
_MOST_KEPT = 1 << 26

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of time: ``times`` [s], shape (n,), and ``values``, shape (signals, n), NaN in gaps."""

    times: Floats
    values: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Line:
    """One curve: its name, whether it is a desired value (a wish), how it is read in the chart's unit, its meaning."""

    label: str
    wish: bool
    read: Callable[[Record], float]
    doc: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """Curves that share a unit and an axis; ``least`` is the height of the axis where all values are the same."""

    title: str
    unit: str
    lines: tuple[Line, ...]
    least: float = 0.0


@dataclass(frozen=True, slots=True)
class Curves:
    """Charts, and their signals over the whole session and over the first contacts; rows are in the charts' order."""

    charts: tuple[Chart, ...]
    whole: Block
    contacts: tuple[Block, ...]


class Sampler:
    """Reads the signals of a model every tick; ``ticks`` is the greatest number of ticks to come."""

    def __init__(self, model: Model, ticks: int) -> None:
        self.charts = tuple(_charts(model))
        self._signals = [line.read for chart in self.charts for line in chart.lines]
        self._period, self._every = model.period, max(1, -(-ticks * max(1, len(self._signals)) // _MOST_KEPT))
        room = ticks // self._every + 1
        self._times, self._values = np.zeros(room), np.zeros((room, len(self._signals)), np.float32)
        self._seen = self._count = 0

    def add(self, state: Record) -> None:
        """Take a sample."""
        if self._seen % self._every == 0 and self._count < len(self._times):
            self._times[self._count] = int(state["tick"]) * self._period
            self._values[self._count] = [read(state) for read in self._signals]
            self._count += 1
        self._seen += 1

    def curves(self, spans: list[tuple[float, float | None]]) -> Curves:
        """Return what was sampled; ``spans`` are the start and the end [s] (None: open) of each contact."""
        times, values = self._times[: self._count], self._values[: self._count]
        step = self._period * self._every
        rows = 1 + len(self._signals)
        whole, contacts = min(MOST_WHOLE, NUMBERS_WHOLE // rows), min(MOST_CONTACTS, NUMBERS_CONTACTS // rows)
        most = min(MOST_CONTACT, max(LEAST_CONTACT, contacts // max(1, len(spans))))
        cut = []
        for begin, end in spans[: contacts // most]:
            first = int(np.searchsorted(times, begin - MARGIN))
            last = int(np.searchsorted(times, (end if end is not None else np.inf) + MARGIN))
            cut.append(thinned(times[first:last], values[first:last], most, step))
        return Curves(self.charts, thinned(times, values, whole, step), tuple(cut))


def thinned(times: Floats, values: NDArray[np.float32], most: int, step: float) -> Block:
    """Return samples as about ``most`` points at most: the least and the greatest of each stretch, in their order.

    Parameters
    ----------
    times, values
        Samples, shapes (n,) and (n, signals).
    most
        How many points are enough; where there are no more samples than this, they stay as they are.
    step
        Time between two samples [s]; a longer one is a gap, into which a NaN is put.
    """
    gaps = np.flatnonzero(np.diff(times) > 1.5 * step) + 1
    size = -(-2 * len(times) // most)
    if size > 2:
        pieces = [_envelope(t, v, size) for t, v in zip(np.split(times, gaps), np.split(values, gaps), strict=True)]
        times, values = np.concatenate([t for t, _ in pieces]), np.concatenate([v for _, v in pieces])
        gaps = np.cumsum([len(t) for t, _ in pieces])[:-1]
    nothing = np.full((len(gaps), values.shape[1]), np.nan, np.float32)
    held = times[gaps - 1] + step if len(gaps) else np.zeros(0)
    return Block(np.insert(times, gaps, held), np.insert(values, gaps, nothing, axis=0).T)


def _envelope(times: Floats, values: NDArray[np.float32], size: int) -> tuple[Floats, NDArray[np.float32]]:
    """Return two points for every ``size`` samples, and two for those left over at the end."""
    count = len(times) // size * size
    heads, blocks = times[:count].reshape(-1, size), values[:count].reshape(-1, size, values.shape[1])
    least, greatest = (_places(blocks, sign) for sign in (1.0, -1.0))
    order = np.sort(np.stack((least, greatest), axis=1), axis=1)
    taken = np.take_along_axis(blocks, order, axis=1).reshape(-1, values.shape[1])
    shown = heads[:, [0, size // 2]].reshape(-1)
    if count == len(times):
        return shown, taken
    rest_t, rest = _envelope(times[count:], values[count:], len(times) - count)
    return np.concatenate((shown, rest_t)), np.concatenate((taken, rest))


def _places(blocks: NDArray[np.float32], sign: float) -> NDArray[np.int64]:
    """Return where each stretch is least (``sign`` 1) or greatest (-1); what is not finite is passed over."""
    found: NDArray[np.int64] = np.argmin(np.where(np.isfinite(blocks), sign * blocks, np.inf), axis=1)
    return found


def _charts(model: Model) -> Iterator[Chart]:
    """Yield the charts that the window shows, and those that only the page has."""
    for chart in charts(model, page=True):
        lines = tuple(Line(one.label, one.dashed, one.read, one.doc) for one in chart.signals)
        yield Chart(chart.title, chart.unit, lines, chart.least)
