"""A recording as it was read: its tracks as structured arrays, its messages, and what is missing."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.recording.reader import Content, read_content
from itouch.recording.recording_error import RecordingError
from itouch.recording.tracks import SCENE, Track
from itouch.schema.diagnostics import did_you_mean
from itouch.schema.notebook_display import Shown

if TYPE_CHECKING:
    import pandas

#: Key of a note on timing -> name of its histogram, as in a report.
_HISTOGRAMS = {"lateness": "lateness", "ticks": "tick"}


class Recording(Shown, Mapping[str, NDArray[Any]]):
    """The content of a recording; tracks by name, such as ``recording["arm"]["pose"]``, shape (n, 7).

    A track is a structured array with ``tick``, ``time`` [s] and its columns, in SI units.  ``recording["arm.pose"]``
    is one column of it.  ``itouch.read(path)`` makes one.

    Raises
    ------
    TypeError
        If it is made of anything but what was read, such as a path.
    """

    #: Imported by name when a notebook asks: the core imports nothing from the tools.
    PAGE = "itouch_tools.report.notebook:recording"

    def __init__(self, content: Content) -> None:
        if not isinstance(content, Content):
            raise TypeError(f"a recording is read with itouch.read(PATH), not made of {content!r}")
        self._content = content

    def __getitem__(self, name: str) -> NDArray[Any]:
        rows = self._content.rows
        if name in rows:
            return rows[name]
        for track in self.tracks.values():
            for column in track.columns:
                if name in (column.field, f"{track.name}.{column.name}"):
                    return np.asarray(rows[track.name][column.name])
        raise KeyError(f"the recording has no track or channel '{name}'; {did_you_mean(name, rows, 'tracks are')}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._content.rows)

    def __len__(self) -> int:
        return len(self._content.rows)

    def __repr__(self) -> str:
        return f"Recording({self.path!r}: {', '.join(self)}; {self.duration:.3f} s)"

    @property
    def path(self) -> str:
        """The file."""
        return self._content.path

    @property
    def tracks(self) -> Mapping[str, Track]:
        """Description of each track."""
        return self._content.tracks

    @property
    def units(self) -> dict[str, str]:
        """Unit of every channel, by its name in State; empty for plain numbers."""
        return {column.field: column.unit for track in self.tracks.values() for column in track.columns}

    @property
    def meanings(self) -> dict[str, str]:
        """What every channel is, in one sentence, by its name in State; empty for a recording of an older version."""
        return {column.field: column.doc for track in self.tracks.values() for column in track.columns if column.doc}

    @property
    def session(self) -> Mapping[str, Any]:
        """The description of the session: manifest, scene, layout, bases."""
        return self._content.session

    @property
    def scene(self) -> str:
        """The scene that ran, as XML."""
        return str(self.session.get("scene", ""))

    @property
    def period(self) -> float:
        """Servo period [s]."""
        return float(self.session["period"])

    def _letters(self, topic: str) -> list[dict[str, Any]]:
        return self._content.letters.get(topic, [])

    @property
    def events(self) -> list[dict[str, Any]]:
        """Contact events: tick, time [s], kind, probe, object, point [m], normal."""
        return self._letters("/log/events")

    @property
    def marks(self) -> list[dict[str, Any]]:
        """Operator marks and trial markers: tick, time [s], name, payload."""
        return self._letters("/log/marks")

    @property
    def left_out(self) -> list[dict[str, Any]]:
        """Time that a late loop has left out: the tick that follows, time [s], seconds, 1 if a run was under way."""
        return self._letters("/log/left_out")

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Faults: tick, time [s], device, trip, cause."""
        return self._letters("/log/faults")

    @property
    def lifecycle(self) -> list[dict[str, Any]]:
        """Changes of a device's status: tick, time [s], device, status."""
        return self._letters("/log/lifecycle")

    @property
    def timing(self) -> list[dict[str, Any]]:
        """How the loop kept time: tick, p50, p99 and max of a tick [us], overruns, lost samples."""
        return self._letters("/log/timing")

    @property
    def report(self) -> dict[str, Any] | None:
        """The session's report from the end of the recording; None if that is cut off, or is of an earlier version."""
        found = self._letters("/log/report")
        report = found[-1].get("report") if found else None
        return report if isinstance(report, dict) else None

    @property
    def histograms_us(self) -> dict[str, list[list[float]]]:
        """``lateness`` (in real time) and ``tick``: lower edge [us], upper edge [us], count; empty for old files."""
        return histograms_us(self.session, self.timing)

    @property
    def states(self) -> list[dict[str, Any]]:
        """Whole States: at the start, every 10 s, and whenever something came from outside the loop."""
        return self._letters("/log/state")

    @property
    def ticks(self) -> NDArray[np.int64]:
        """Ticks that were recorded at servo rate, shape (n,)."""
        found = [self[name]["tick"] for name, track in self.tracks.items() if track.replay]
        shortest = min(found, key=len, default=np.zeros(0, np.int64))
        return np.asarray(shortest, np.int64)

    @property
    def duration(self) -> float:
        """From the start of the first to the end of the last recorded tick [s]."""
        ticks = self.ticks
        return float(ticks[-1] - ticks[0] + 1) * self.period if len(ticks) else 0.0

    @property
    def lost(self) -> int:
        """Number of samples of the servo loop between the first and the last that the recorder could not take.

        Where another scene begins, what lies before it may be in another file: ticks of scenes whose State differs.
        """
        ticks = self.ticks
        gaps = np.flatnonzero(np.diff(ticks) > 1)
        begun = np.array([-1, *(state["tick"] for state in self.states if state["reason"] == SCENE)])
        missing = 0
        for after, end in zip(ticks[gaps] + 1, ticks[gaps + 1], strict=True):  # no sample of after, ..., end - 1
            missing += int(end - max(after, begun[begun <= end].max()))
        return missing

    @property
    def whole(self) -> bool:
        """Whether the recording was ended properly and nothing in it is damaged or missing."""
        return self._content.whole and not self._content.losses and not self.lost

    @property
    def losses(self) -> tuple[str, ...]:
        """What is missing, one sentence each."""
        more = (f"{self.lost} samples were lost while recording",) if self.lost else ()
        return (*self._content.losses, *more)

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """Content of the files inside the recording, by name."""
        return self._content.attachments

    def pandas(self, name: str) -> pandas.DataFrame:
        """Return a track as a table with one column per number, indexed by time [s].

        Raises
        ------
        RecordingError
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise RecordingError("pandas is not installed; install it with `pip install pandas`") from error
        table = flat(self[name], self.tracks[name])
        return pd.DataFrame(table).set_index("time")


def flat(rows: NDArray[Any], track: Track) -> dict[str, NDArray[Any]]:
    """Return a track's numbers as columns of shape (n,), by label.

    ``rows`` (n,) have the track's dtype; numbers keep the units of its columns.
    """
    table: dict[str, NDArray[Any]] = {"time": rows["time"], "tick": rows["tick"]}
    for column in track.columns:
        values = rows[column.name]
        if column.size == 0:
            table[column.name] = values
            continue
        for index, label in enumerate(column.labels):
            table[label] = values[:, index]
    return table


def read(path: str | os.PathLike[str]) -> Recording:
    """Read a recording: its longest valid prefix; ``losses`` says what is missing.

    Raises
    ------
    RecordingError
        If it cannot be opened, or is not a recording of this program.
    """
    return Recording(read_content(os.fspath(path)))


def histograms_us(session: Mapping[str, Any], notes: Iterable[Mapping[str, Any]]) -> dict[str, list[list[float]]]:
    """Return the histograms of lateness and duration of ticks: bins of lower edge [us], upper edge [us] and count.

    ``session`` has the edges, ``notes`` the counts since the previous note.  Recordings of earlier versions have none;
    entries that cannot be the count of a bin are left out, as a file may contain anything.
    """
    edges = session.get("timing_edges_us")
    if not isinstance(edges, list) or not all(isinstance(e, int | float) and 0 <= e < 1e12 for e in edges):
        return {}
    totals: dict[str, dict[int, int]] = {name: {} for name in _HISTOGRAMS.values()}
    for note in notes:
        for key, name in _HISTOGRAMS.items():
            for index, count in _counts(note.get(key), len(edges) - 1):
                totals[name][index] = totals[name].get(index, 0) + count
    return {
        name: [[edges[index], edges[index + 1], count] for index, count in sorted(total.items())]
        for name, total in totals.items()
        if total
    }


def _counts(entries: object, bins: int) -> Iterable[tuple[int, int]]:
    for entry in entries if isinstance(entries, list) else ():
        if isinstance(entry, list) and len(entry) == 2 and all(type(number) is int for number in entry):
            index, count = entry
            if 0 <= index < bins and 0 < count < 1 << 53:
                yield index, count
