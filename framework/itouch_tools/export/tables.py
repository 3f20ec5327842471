"""Tracks as CSV and Parquet tables, with units; temperatures in CSV are in degrees Celsius."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from itouch.recording.recording import Recording, flat
from itouch.recording.recording_error import RecordingError
from itouch.recording.tracks import Track
from itouch.schema.durable import replacing
from itouch.schema.units import CELSIUS_OFFSET

_BLOCK = 4096
#: Tables of a folder that are not those of a track, which may bear the same name.
_LISTS, _MEANINGS = ("events", "marks", "faults"), "columns"
_TABLES = (*_LISTS, _MEANINGS)

Columns = dict[str, tuple[str, NDArray[np.generic]]]


def columns_of(recording: Recording, track: Track, *, celsius: bool, prefix: str = "") -> Columns:
    """Return a track's numbers as columns: (unit, values) by label; with ``celsius`` temperatures are in degC."""
    return columns_in(recording[track.name], track, celsius=celsius, prefix=prefix)


def columns_in(rows: NDArray[Any], track: Track, *, celsius: bool, prefix: str = "") -> Columns:
    """Return rows (n,) of a track's dtype as columns, as `columns_of` does."""
    units = {label: u for c in track.columns for label, u in zip(c.labels, c.units, strict=True)}
    found: Columns = {}
    for label, values in flat(rows, track).items():
        unit = {"time": "s", "tick": ""}.get(label, units.get(label, ""))
        name = label if label in ("time", "tick") else prefix + label
        if celsius and unit == "K":
            found[name] = ("degC", values - CELSIUS_OFFSET)
        else:
            found[name] = (unit, values)
    return found


def meanings_of(track: Track, *, prefix: str = "") -> dict[str, str]:
    """Return the meaning of each of a track's numbers, by the labels of `columns_of`; numbers without one are left out.

    Time and tick are never among them.
    """
    return {prefix + label: c.doc for c in track.columns if c.doc for label in c.labels}


def _all_meanings(recording: Recording) -> dict[str, str]:
    found: dict[str, str] = {}
    for track in recording.tracks.values():
        if track.every == 1:
            found |= meanings_of(track, prefix=track.name + ".")
    return found


def joined(recording: Recording, *, celsius: bool) -> Columns:
    """Return the tracks at servo rate, chosen ones included, side by side, as columns named ``TRACK.channel``."""
    found: Columns = {}
    for track in recording.tracks.values():
        if track.every == 1:
            found |= columns_of(recording, track, celsius=celsius, prefix=track.name + ".")
    return found


def left_out(recording: Recording) -> list[str]:
    """Return the channels that are missing in a table at servo rate because they were recorded at other rates."""
    return [
        f"{track.name}.{label}"
        for track in recording.tracks.values() if track.every != 1
        for column in track.columns for label in column.labels
    ]  # fmt: skip


def lines(columns: Columns, separator: str) -> Iterator[str]:
    """Yield the rows of a table as text; each column (n,) is in its own unit; the table is as long as the shortest."""
    arrays = [values for _, values in columns.values()]
    count = min((len(values) for values in arrays), default=0)
    for begin in range(0, count, _BLOCK):
        block = [values[begin : min(count, begin + _BLOCK)].tolist() for values in arrays]
        for row in zip(*block, strict=True):
            yield separator.join(map(repr, row)) + "\n"


def write_csv(stream: TextIO, columns: Columns) -> None:
    """Write a table with a header of names and units; columns have the shape (n,)."""
    stream.write(",".join(f"{name} [{unit}]" if unit else name for name, (unit, _) in columns.items()) + "\n")
    stream.writelines(lines(columns, ","))


def export_csv(recording: Recording, target: str) -> list[str]:
    """Write one table of all tracks at servo rate (if ``target`` ends in .csv), or a folder with a table per track.

    Raises
    ------
    OSError
        If it can't be written.
    """
    if target.endswith(".csv"):
        columns = joined(recording, celsius=True)
        with replacing(target) as new, open(new, "w", encoding="utf-8") as stream:
            write_csv(stream, columns)
        return [
            target,
            _write_meanings(target.removesuffix(".csv") + ".columns.csv", columns, _all_meanings(recording)),
        ]
    os.makedirs(target, exist_ok=True)
    written: list[str] = []
    described: Columns = {}
    meanings: dict[str, str] = {}
    names = distinct(map(safe_name, recording.tracks), taken=_TABLES)
    for name, track in zip(names, recording.tracks.values(), strict=True):
        written.append(os.path.join(target, f"{name}.csv"))
        with replacing(written[-1]) as new, open(new, "w", encoding="utf-8") as stream:
            write_csv(stream, columns_of(recording, track, celsius=True))
        described |= columns_of(recording, track, celsius=True, prefix=track.name + ".")
        meanings |= meanings_of(track, prefix=track.name + ".")
    for name, rows in zip(_LISTS, (recording.events, recording.marks, recording.faults), strict=True):
        written.append(os.path.join(target, f"{name}.csv"))
        with replacing(written[-1]) as new, open(new, "w", encoding="utf-8") as stream:
            _write_letters(stream, rows)
    return [*written, _write_meanings(os.path.join(target, f"{_MEANINGS}.csv"), described, meanings)]


def _write_meanings(path: str, columns: Columns, meanings: Mapping[str, str]) -> str:
    """Write the unit and meaning of each column as a table, and return its path."""
    with replacing(path) as new, open(new, "w", encoding="utf-8") as stream:
        stream.write("column,unit,meaning\n")
        for name, (unit, _) in columns.items():
            stream.write(",".join(_quoted(word) for word in (name, unit, meanings.get(name, ""))) + "\n")
    return path


def _write_letters(stream: TextIO, rows: Sequence[dict[str, object]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row)) or ["tick", "time"]
    stream.write(",".join(names) + "\n")
    for row in rows:
        stream.write(",".join(_quoted(row.get(name, "")) for name in names) + "\n")


def _quoted(value: object) -> str:
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(part, dict | list) for part in value)):
        value = json.dumps(value)  # as the payloads of marks: programs in any language read it
    elif isinstance(value, list):
        value = " ".join(map(str, value))
    text = "" if value is None else str(value)
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n') else text


def safe_name(name: str) -> str:
    """Return a name that is safe as a file's name, whatever the recording says."""
    word = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).lstrip(".")
    return word[:100] or "track"


def distinct(words: Iterable[str], *, taken: Iterable[str] = (), joint: str = "-") -> list[str]:
    """Return words that all differ, also without regard to case: a number after ``joint`` tells equal ones apart.

    None of them is one of ``taken``.  Names of tracks that differ may become one and the same name of a file or topic.
    """
    found: list[str] = []
    seen = {word.casefold() for word in taken}
    for word in words:
        name, number = word, 1
        while name.casefold() in seen:
            number += 1
            name = f"{word}{joint}{number}"
        seen.add(name.casefold())
        found.append(name)
    return found


def export_parquet(recording: Recording, target: str) -> list[str]:
    """Write one table (if ``target`` ends in .parquet) or one per track, in SI, each column with its unit as metadata.

    The table's own metadata has the meaning of each column under ``meanings``, as JSON.

    Raises
    ------
    RecordingError
        If pyarrow is not installed.
    OSError
        If it can't be written.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise RecordingError("pyarrow is not installed; install it with `pip install 'itouch-py[tables]'`") from error

    def put(path: str, columns: Columns, meanings: dict[str, str]) -> None:
        count = min(len(values) for _, values in columns.values())
        fields = [
            pyarrow.field(name, pyarrow.from_numpy_dtype(values.dtype), metadata={"unit": unit})
            for name, (unit, values) in columns.items()
        ]
        arrays = [pyarrow.array(np.ascontiguousarray(values[:count])) for _, values in columns.values()]
        schema = pyarrow.schema(fields, metadata={"meanings": json.dumps(meanings)})
        with replacing(path) as new:
            pyarrow.parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=schema), new)

    if target.endswith(".parquet"):
        put(target, joined(recording, celsius=False), _all_meanings(recording))
        return [target]
    os.makedirs(target, exist_ok=True)
    written = []
    for name, track in zip(distinct(map(safe_name, recording.tracks)), recording.tracks.values(), strict=True):
        written.append(os.path.join(target, f"{name}.parquet"))
        put(written[-1], columns_of(recording, track, celsius=False), meanings_of(track))
    return written
