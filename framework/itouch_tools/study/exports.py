"""A study's trials for other programs: Parquet, and a folder in the Brain Imaging Data Structure (``beh``)."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from itouch.schema import ItouchError
from itouch.schema.durable import replacing, write_whole
from itouch_tools.export.bids import VERSION
from itouch_tools.study.study_store import Row
from itouch_tools.study.touch_figures import known, meaning
from itouch_tools.study.trial_table import factor_column, interval_columns, table_of

_DESCRIBED = {
    "participant": "code of the participant", "place": "number of the trial in the participant's order, from 0",
    "repeats": "place of the void trial that it repeats",
    "block": "block of the order; practice and catch do not count",
    "task": "what was asked", "staircase": "adaptive procedure that the trial belongs to",
    "level": "level that the adaptive procedure asked for", "answer": "what was answered",
    "right": "1: right, 0: wrong", "reaction_s": "from the end of the contact to the answer",
    "void": "why the trial does not count; n/a: it does", "begun_s": "start of the trial on the servo's clock",
    "ended_s": "end of the trial on the servo's clock", "session": "session of the participant",
}  # fmt: skip


def write_parquet(rows: Sequence[Row], path: Path) -> None:
    """Write the trials as Parquet, with numbers as numbers, and null where there is no value.

    Raises
    ------
    ItouchError
        If pyarrow is not installed.
    OSError
        If the file can't be written; an earlier one stays as it was.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ItouchError("Parquet needs pyarrow: pip install 'itouch-py[data]'") from error
    table = table_of(rows)
    factors = {name for row in rows for name in row.condition}
    words = {*_WORDS, *map(factor_column, factors)}
    words |= {column for column, (name, _) in interval_columns(rows).items() if name in factors}
    columns = {
        name: [(_said if name in words else _value)(row[name]) for row in table] for name in (table[0] if table else {})
    }
    for name, values in columns.items():
        kinds = {type(value) for value in values if value is not None}
        if kinds == {int, float}:
            columns[name] = [None if value is None else float(value) for value in values]
        elif len(kinds) > 1:
            columns[name] = [None if value is None else str(value) for value in values]
    with replacing(str(path)) as new:
        pq.write_table(pa.table(columns), new)


#: Columns that are words, whatever they look like: a participant '007' is not the number 7.
_WORDS = frozenset(("participant", "block", "task", "staircase", "answer", "void", "session", "at"))


def _said(cell: str) -> str | None:
    return None if cell == "n/a" else cell


def _value(cell: str) -> Any:
    """Return a cell as a number, as true or false, or as text, whichever it is; None for ``n/a``."""
    if cell == "n/a":
        return None
    if cell in ("True", "False"):
        return cell == "True"
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell


#: How much of a study's name stands in the names of files [characters], which may have 255 with all else in them.
LONGEST_LABEL = 64


def write_bids(rows: Sequence[Row], folder: Path, *, name: str) -> list[Path]:
    """Write ``dataset_description.json``, ``participants.tsv`` and a table of trials for each participant.

    Parameters
    ----------
    rows
        The trials; codes become labels of letters and digits.
    folder
        The target; it is made if it is missing.
    name
        Name of the study; its letters and digits, up to ``LONGEST_LABEL``, are the label of the task.

    Raises
    ------
    ItouchError
        If two codes become the same label.
    OSError
        If a file can't be written.
    """
    label = re.sub(r"[^A-Za-z0-9]", "", name)[:LONGEST_LABEL] or "study"
    people = sorted({row.participant for row in rows})
    subjects = {code: re.sub(r"[^A-Za-z0-9]", "", code) or "x" for code in people}
    if len(set(subjects.values())) < len(people):
        raise ItouchError(f"codes become the same BIDS label of letters and digits: {', '.join(people)}")
    folder.mkdir(parents=True, exist_ok=True)
    written = [
        _json(folder / "dataset_description.json", {
            "Name": name, "BIDSVersion": VERSION, "DatasetType": "raw", "License": "n/a",
            "GeneratedBy": [{"Name": "itouch-py"}],
        }),
        _text(folder / "README", f"{name}\n\nTrials of a study of touch, one table a participant, by itouch-py.\n"),
        _text(folder / "participants.tsv", "".join(["participant_id\n", *(f"sub-{s}\n" for s in subjects.values())])),
        _json(folder / "participants.json", {"participant_id": {"Description": "code of the participant"}}),
    ]  # fmt: skip
    figures = {name for row in rows for felt in row.felt or [] for name in felt}
    for code, subject in subjects.items():
        stem = folder / f"sub-{subject}" / "beh" / f"sub-{subject}_task-{label}_beh"
        stem.parent.mkdir(parents=True, exist_ok=True)
        table = table_of(row for row in rows if row.participant == code)
        head = [column for column in table[0] if column != "participant"]
        intervals = interval_columns(row for row in rows if row.participant == code)
        lines = io.StringIO()
        writer = csv.DictWriter(lines, head, delimiter="\t", lineterminator="\n", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(table)
        written.append(_text(stem.with_suffix(".tsv"), lines.getvalue()))
        written.append(_json(stem.with_suffix(".json"), {"TaskName": label, **_sidecar(head, figures, intervals)}))
    return written


def _sidecar(
    columns: Sequence[str], figures: Collection[str], intervals: Mapping[str, tuple[str, int]]
) -> dict[str, Any]:  # fmt: skip
    found: dict[str, Any] = {}
    declared = known()
    for column in columns:
        felt, _, interval = column.rpartition("_")
        if column in _DESCRIBED:
            seconds = {"Units": "s"} if column.endswith("_s") else {}
            found[column] = {"Description": _DESCRIBED[column], **seconds}
        elif felt in figures and interval.isdigit():
            unit, words = meaning(felt, declared)
            found[column] = {"Description": f"{words}, interval {interval}", **({"Units": unit} if unit else {})}
        elif column in intervals:
            name, index = intervals[column]
            found[column] = {"Description": f"level of {name} that interval {index + 1} showed"}
        else:
            found[column] = {"Description": f"level of the factor {column}"}
    return found


def _text(path: Path, content: str) -> Path:
    write_whole(str(path), content.encode())
    return path


def _json(path: Path, content: dict[str, Any]) -> Path:
    return _text(path, json.dumps(content, indent=2) + "\n")
