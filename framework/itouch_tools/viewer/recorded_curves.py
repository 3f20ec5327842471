"""The curves of a recording: filled in whatever order it is read, shown up to the moment that is displayed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.viewer.signals import WINDOW, Chart, charts, rows_of, spans


class RecordedCurves:
    """Remembers the signals of every recorded tick, thinned to ``rate`` Hz; NaN where it has not been read.

    Parameters
    ----------
    model
        The model whose signals are remembered.
    ticks
        The recorded ticks, shape (n,).
    """

    def __init__(self, model: Model, ticks: NDArray[np.int64], *, rate: float = 100.0) -> None:
        self.charts = charts(model)
        self._step = max(1, round(1.0 / (rate * model.period)))
        self._times = np.asarray(ticks[:: self._step] * model.period, np.float64)
        self._signals = [signal for chart in self.charts for signal in chart.signals]
        self._values = np.full((len(self._signals), len(self._times)), np.nan, np.float32)
        self._ready = np.ones(len(self._times), bool)
        #: The row up to which curves are shown.
        self.row = 0

    def note(self, row: int, state: Record) -> None:
        """Note the State of a row, if the row is one of those that are kept."""
        if row % self._step == 0:
            self._values[:, row // self._step] = [signal.read(state) for signal in self._signals]
            self._ready[row // self._step] = "ready" not in state or bool(state["ready"])

    def add(self, state: Record) -> None:
        """Do nothing: the reader of the recording calls ``note``."""

    def curves(self, chart: Chart) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the times [s], shape (n,), and the values, shape (signals, n), of the last seconds, oldest first."""
        shown = self._shown()
        return self._times[shown], self._values[rows_of(self.charts, chart), shown].astype(np.float64)

    def preparing(self) -> list[tuple[float, float]]:
        """Return the spans of time [s] in which the rig was not ready."""
        shown = self._shown()
        return spans(self._times[shown], self._ready[shown])

    def _shown(self) -> slice:
        last = self.row // self._step + 1
        return slice(int(np.searchsorted(self._times[:last], self._times[last - 1] - WINDOW)), last)
