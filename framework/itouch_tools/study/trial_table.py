"""Trials of a study as one table of tab-separated values, for other programs."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from itouch.schema.durable import replacing
from itouch_tools.study.study_store import Row

_PLAIN = ("participant", "place", "repeats", "block", "task", "staircase", "level", "answer", "right", "reaction_s",
          "void", "begun_s", "ended_s", "session")  # fmt: skip


def factor_column(factor: str) -> str:
    """Return the column of a factor: its name, or ``factor_NAME`` where every trial has a column of that name."""
    return f"factor_{factor}" if factor in _PLAIN else factor


def interval_columns(rows: Iterable[Row]) -> dict[str, tuple[str, int]]:
    """Return the columns of what differed between the intervals of a trial, as column -> (factor, interval from 0).

    Without them nobody could tell what an answer such as *the first* means.
    """
    found = {
        (name, index) for row in rows if len(row.shown) > 1 for index, shown in enumerate(row.shown) for name in shown
        if any(other.get(name) != shown[name] for other in row.shown)
    }  # fmt: skip
    return {f"{name}_{index + 1}": (name, index) for name, index in sorted(found)}


def table_of(rows: Iterable[Row]) -> list[dict[str, str]]:
    """Return the trials as `write_table` writes them: the cells of each as text by column, ``n/a`` without a value."""
    head, lines = _cells(list(rows))
    return [dict(zip(head, map(str, line), strict=True)) for line in lines]


def write_table(rows: Iterable[Row], path: Path) -> None:
    """Write trials as tab-separated values.

    There is a column for each factor, for what each interval showed where they differ, and for each figure of each
    interval.

    Raises
    ------
    OSError
        If the file can't be written; an earlier one stays as it was.
    """
    head, lines = _cells(list(rows))
    with replacing(str(path)) as new, open(new, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, delimiter="\t", lineterminator="\n")
        writer.writerow(head)
        writer.writerows(lines)


def _cells(rows: Sequence[Row]) -> tuple[list[str], list[list[Any]]]:
    """Return the names of the columns, and the cells of each row."""
    factors = sorted({name for row in rows for name in row.condition})
    figures = sorted({(index, name) for row in rows for index, felt in enumerate(row.felt or []) for name in felt})
    intervals = interval_columns(rows)
    head = [*_PLAIN, *map(factor_column, factors), *intervals, *(f"{name}_{index + 1}" for index, name in figures)]
    lines = []
    for row in rows:
        felt = row.felt or []
        cells = [getattr(row, name) for name in _PLAIN] + [row.condition.get(name) for name in factors]
        cells += [row.shown[index].get(name) if index < len(row.shown) else None for name, index in intervals.values()]
        cells += [felt[index].get(name) if index < len(felt) else None for index, name in figures]
        lines.append(["n/a" if cell in (None, "") else cell for cell in cells])
    return head, lines
