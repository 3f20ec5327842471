"""Random access to a recording: the State of any tick, computed by replaying the recording from a place before it.

A replay goes forwards only.  So a place from which it can go on is kept every quarter of a second; to show an earlier
tick, it begins again from the last place before it.  What has not been read yet is read in the time that is left, first
around the tick that is shown; a recording holds whole States every 10 s, from which reading may begin anywhere.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.recording import Recording, RecordingError
from itouch.servo.prepare import prepare_replay
from itouch.session.replaying import ReplayPosition
from itouch.world import Model
from itouch_tools.viewer.signals import WINDOW, Chart, charts, rows_of, spans

#: Time [s] between two places that are kept, and how many are kept at most.
EVERY, MOST = 0.25, 20_000
#: Seconds before and after the tick that is shown which are read first.
_BEFORE, _BEHIND = WINDOW, 20.0
#: Ticks between two looks at the clock.
_PART = 16


class SeekableRecording:
    """Shows the State of any recorded tick.

    Parameters
    ----------
    recording
        The recording to show.
    catalog
        The plugins; default: those of this environment.

    Attributes
    ----------
    state
        The State after tick ``ticks[shown]``.
    row
        The row of ``ticks`` that is wanted; ``work`` brings ``state`` to it.
    curves
        The curves up to that row.

    Raises
    ------
    RecordingError, SessionError
        If the recording holds no tick, or its session can't be built here.
    """

    def __init__(self, recording: Recording, *, catalog: Catalog | None = None) -> None:
        self.recording = recording
        self.ticks = recording.ticks
        if not len(self.ticks):
            raise RecordingError(f"'{recording.path}' holds no tick that could be shown")
        self._replay = prepare_replay(recording, catalog=catalog, compares=False)
        self.session = self._replay.session
        self.model = self.session.model
        self.curves = RecordedCurves(self.model, self.ticks)
        self.state = Record(self.session.state.dtype)
        self.state.raw[:] = self.session.state.raw
        self.row, self.shown = 0, -1
        self._seen = np.zeros(len(self.ticks), bool)
        self._block = max(1, round(EVERY / self.model.period), -(-len(self.ticks) // MOST))
        self._places: dict[int, ReplayPosition] = {}
        self._letters = self._stated()
        self._here: ReplayPosition | None = None
        self._filler: ReplayPosition | None = None
        # where the replay is now, if that is a place: going there again takes time
        self._stands: ReplayPosition | None = None
        self._caught = False
        self.session.taps.append(self._tap)

    def _stated(self) -> dict[int, Mapping[str, Any]]:
        """Return the recorded States from which reading may begin, by row."""
        said = [letter for letter in self.recording.states if letter["reason"] != "fault"]
        found = {int(np.searchsorted(self.ticks, int(letter["tick"]))): letter for letter in said}
        return {row: letter for row, letter in sorted(found.items()) if row < len(self.ticks)}

    def _tap(self, tick: int) -> None:
        """Note a tick that was replayed; also called within the safe sequence."""
        row = self._replay.feed.at - 1
        if row < 0 or int(self.ticks[row]) != tick:
            return
        self.curves.note(row, self.session.state)
        if row == self.row and not self._caught:
            self.state.raw[:] = self.session.state.raw
            self._caught = True

    def work(self, seconds: float) -> bool:
        """Bring ``state`` to the wanted row, and read on for the rest of ``seconds``; return whether it got there."""
        end = time.perf_counter() + seconds
        if self.shown != self.row:
            self._bring(end)
        if self.shown == self.row:
            self.curves.row = self.row
            self._read_on(end)
        return self.shown == self.row

    def known(self, parts: int) -> NDArray[np.bool_]:
        """Return which of ``parts`` equal parts of the recording have been read (at their middle), shape (parts,)."""
        at = (np.arange(parts) + 0.5) * len(self.ticks) / parts
        return np.asarray(self._seen[at.astype(int)], bool)

    def _bring(self, end: float) -> None:
        row, here = self.row, self._here
        start = self._nearest(row)
        if here is not None and _row(start, self.ticks) <= here.at <= row:
            start = here
        self._caught = False
        self._stand(start)  # which also clears ``_stands``
        done = self._run(row + 1, end)
        self._here = self._replay.place()
        if not done:
            return
        if not self._caught:  # nothing can be said of this row: it lies in a gap
            self.state.raw[:] = self.session.state.raw
        self.shown = row

    def _read_on(self, end: float) -> None:
        self._caught = True  # what is shown stays
        while time.perf_counter() < end:
            first = self._unread()
            if first is None:
                return
            if self._filler is not None and self._filler.at == first:
                if self._stands is not self._filler:
                    self._stand(self._filler)
            else:
                self._stand(self._nearest(first))
            rest = self._seen[first:]
            self._run(first + (int(np.argmax(rest)) if rest.any() else len(rest)), end)
            self._filler = self._stands = self._replay.place()

    def _unread(self) -> int | None:
        """Return the next row to read: the first unread one near the row that is shown, else the first of all."""
        period = self.model.period
        near = max(0, self.row - round(_BEFORE / period))
        for begin, stop in ((near, self.row + round(_BEHIND / period)), (0, len(self._seen))):
            part = self._seen[begin:stop]
            if not part.all():
                return begin + int(np.argmin(part))
        return None

    def _nearest(self, row: int) -> ReplayPosition | Mapping[str, Any]:
        """Return the last place or recorded State from which a row can be reached."""
        rows = [at for at in self._letters if at <= row]
        letter = rows[-1] if rows else min(self._letters, default=0)
        for block in range(row // self._block, letter // self._block - 1, -1):
            place = self._places.get(block)
            if place is not None and letter <= place.at <= row:
                return ReplayPosition(place.at, zlib.decompress(place.state), place.going, place.parks)
        return self._letters[letter]

    def _stand(self, start: ReplayPosition | Mapping[str, Any]) -> None:
        self._stands = None
        if isinstance(start, ReplayPosition):
            self._replay.go(start)
            return
        self._replay.begin_at(start)
        self._seen[: self._replay.feed.at] |= self._replay.feed.at == min(self._letters)  # rows before the first State

    def _run(self, stop: int, end: float) -> bool:
        """Replay up to a row; return whether there was time for that."""
        feed, count = self._replay.feed, 0
        while feed.at < stop:
            self._keep()
            before = feed.at
            if not self._replay.step():
                break
            self._seen[before : feed.at] = True
            count += 1
            if count % _PART == 0 and time.perf_counter() > end:
                return feed.at >= stop
        return True

    def _keep(self) -> None:
        block = self._replay.feed.at // self._block
        if block in self._places:
            return
        place = self._replay.place()
        if place.going:
            self._places[block] = ReplayPosition(place.at, zlib.compress(place.state, 1), True, place.parks)


def _row(start: ReplayPosition | Mapping[str, Any], ticks: NDArray[np.int64]) -> int:
    return start.at if isinstance(start, ReplayPosition) else int(np.searchsorted(ticks, int(start["tick"])))


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
