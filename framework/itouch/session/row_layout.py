"""The row that is recorded every tick: which fields of State, in which order, and how they get into the ring."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from itouch.compiling import kernel
from itouch.plugin import Field, Record
from itouch.recording.ring import ControlWord
from itouch.recording.tracks import KINDS, Column, Track
from itouch.scene.elements.rates import CLOSE
from itouch.world import Model, declared

#: Fields that are recorded of each device besides its channels; those that a device does not have are left out.
_STATUS = ("status", "trip", "ramp", "age", "sequence", "clamped", "dropped")
#: Fields that come from outside the loop besides readings.
_INPUTS = ("hold", "ready")
#: Fields that are recorded of each probe: enough to draw it, and to move a hand by it in another scene.
_PROBE = ("hip", "force", "penetration", "object")
#: Pieces begin and end at multiples of this many bytes.
_WORD = 8
#: How many numbers a field may have to be recorded as a channel.
_MOST = 4096

#: Where the ring says how many rows have come, and have been taken.
_IN, _OUT = int(ControlWord.ROWS_IN), int(ControlWord.ROWS_OUT)
#: Codes for what is left to Python: no row was copied, as there is no room; or something is to be told or looked at.
FULL, LOOK = 1, 2

#: A wish for channels: patterns of names, and the rate [Hz].
Wish = tuple[Sequence[str], float]


def replay_tracks(model: Model, state: Record) -> list[Track]:
    """Return the tracks that are always recorded: of each device and probe, and of the session itself."""
    known, tracks = declared(model), []
    for name, device in model.devices.items():
        names = [c.name for c in device.reads]
        for kind in ("command", "sent"):
            names += [f"{kind}.{c.name}" for c in device.commands]
        names += [field for field in _STATUS if f"{name}.{field}" in state]
        if device.wire:  # without one, a reading is of the tick in which it came, and a command leaves at once
            names += ["measured", "left", *(f"out.{c.name}" for c in device.commands)]
        tracks.append(Track(name, 1, True, tuple(_column(state, known, f"{name}.{n}", in_track(n)) for n in names)))
    for probe in model.probes:
        columns = tuple(_column(state, known, f"{probe.name}.{n}", n) for n in _PROBE)
        tracks.append(Track(probe.name, 1, True, columns))
    inputs = tuple(_column(state, known, n, n) for n in _INPUTS if n in state)
    return [Track("session", 1, True, inputs), *tracks]


def chosen_tracks(model: Model, state: Record, wishes: Iterable[Wish]) -> list[Track]:
    """Return the tracks of chosen channels, one for each owner and rate.

    Raises
    ------
    ValueError
        If a pattern matches nothing, not even what a real device would have as a twin, or only what a track cannot
        hold, or a rate does not divide the servo rate.
    """
    known, found = declared(model), dict[tuple[str, int], dict[str, Column]]()
    for patterns, rate in wishes:
        every = _every(rate, model.period)
        for pattern in patterns:
            names = fnmatch.filter([name for name in state if recordable(state, name)], pattern)
            if not names and not real_device_of(model, pattern):
                if held := fnmatch.filter(list(state), pattern):
                    raise ValueError(
                        f"'{held[0]}' cannot be chosen: it is a table, or has more than {_MOST} numbers; "
                        "each event and mark is in every recording anyway"
                    )
                raise ValueError(f"no channel is named '{pattern}'")
            for name in names:
                owner, _, short = name.partition(".") if "." in name else ("session", "", name)
                found.setdefault((owner, every), {})[name] = _column(state, known, name, in_track(short))
    return [
        Track(_track_name(owner, every, model.period), every, False, tuple(columns.values()))
        for (owner, every), columns in found.items()
    ]


def real_device_of(model: Model, pattern: str) -> str:
    """Return the device that is real here and would have matching fields if it were a twin; empty: none."""
    for name, device in model.devices.items():
        if not device.twin and fnmatch.filter([f"{name}.twin.{f.name}" for f in device.twin_fields()], pattern):
            return name
    return ""


def in_track(name: str) -> str:
    """Return a field's name in a track, which has columns `tick` and `time` of its own."""
    return f"{name}_" if name in ("tick", "time") else name


def _track_name(owner: str, every: int, period: float) -> str:
    return f"chosen/{owner}/{1.0 / (every * period):g}Hz"


def _every(rate: float, period: float) -> int:
    every = max(1, round(1.0 / (rate * period)))
    if abs(every * period * rate - 1.0) > CLOSE:
        nearest = 1.0 / (every * period)
        raise ValueError(
            f"the rate {rate:.9g} Hz does not divide the servo rate; the nearest that does is {nearest:.9g} Hz"
        )
    return every


def recordable(state: Record, name: str) -> bool:
    """Tell whether a field consists of numbers that a track can hold."""
    base = state[name].dtype
    return base.names is None and base.str[1:] in KINDS and 0 < state[name].size <= _MOST


def _column(state: Record, known: Mapping[str, Field], field: str, name: str) -> Column:
    view, said = state[field], known[field]
    size = view.size if view.ndim else 0
    return Column(field, name, view.dtype.str[1:], size, said.shown_unit, said.doc, said.role)


class Rows:
    """The bytes of State that make up a row, for tracks and ``more`` fields, and where each field stands in it."""

    def __init__(self, state: Record, tracks: Iterable[Track], more: Iterable[str] = ()) -> None:
        table: Mapping[str, Any] = state.dtype.fields or {}
        wanted = {column.field for track in tracks for column in track.columns} | set(more)
        fields = sorted(wanted, key=lambda f: table[f][1])
        ranges: list[list[int]] = []
        for field in fields:
            kind, offset = table[field][:2]
            begin, end = offset // _WORD * _WORD, -(-(offset + kind.itemsize) // _WORD) * _WORD
            if ranges and begin <= ranges[-1][1]:
                ranges[-1][1] = max(ranges[-1][1], end)
            else:
                ranges.append([begin, end])
        self.places, at = {}, 0
        pieces: list[tuple[int, int, int]] = []
        for begin, end in ranges:
            pieces.append((begin // _WORD, end // _WORD, at // _WORD))
            for field in fields:
                if begin <= table[field][1] < end:
                    self.places[field] = at + table[field][1] - begin
            at += end - begin
        #: Pieces of State, (n, 3): first word, the one after the last (of `Record.words`), and first word in the row.
        self.pieces = np.array(pieces, np.int64).reshape(-1, 3)
        #: Bytes of a row.
        self.size = max(_WORD, at)

    places: dict[str, int]


@kernel
def copy_row(counters: Any, state: Any, pieces: Any, rows: Any) -> int:
    """Copy pieces of State to the next row of the ring, and return 0; FULL: there is none.

    Parameters
    ----------
    counters
        The ring's control words, int64 (n,), see `ControlWord`.
    state
        State as 64-bit words, int64 (n,) (`Record.words`).
    pieces
        Int64 (n, 3): for each piece its first word, the one after its last, and its first word in the row.
    rows
        Int64 (m, k), m a power of two: the ring's rows; one is written.
    """
    count = counters[_IN]
    if count - counters[_OUT] >= rows.shape[0]:
        return FULL
    row = np.uint64(count & (rows.shape[0] - 1))  # an index that may be negative costs a look at each word
    for piece in range(pieces.shape[0]):
        begin, at = np.uint64(pieces[piece, 0]), np.uint64(pieces[piece, 2])
        for word in range(np.uint64(pieces[piece, 1]) - begin):
            rows[row, at + word] = state[begin + word]
    return 0


@kernel
def count_row(counters: Any, ticks: Any, tick: Any, events: Any, seen: Any, every: int) -> int:
    """Add the copied row to the ring, and return 0, or LOOK if there are new events, or the tick is one to look round.

    Parameters
    ----------
    counters
        The ring's control words, int64 (n,); that of the rows that have come is written.
    ticks
        Int64 (m,): the tick of each row; one is written.
    tick, events
        Fields of State, (1,): the number of the next tick, and how many events there have been.
    seen
        How many events have been told, int64 (1,).
    every
        One tick in this many is one to look round.
    """
    over = tick[0] - 1
    ticks[counters[_IN] & (ticks.shape[0] - 1)] = over
    counters[_IN] += 1
    return LOOK if events[0] != seen[0] or over % every == 0 else 0
