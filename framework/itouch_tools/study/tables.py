"""Trials of a study as one table of tab-separated values, for other programs."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from itouch_tools.study.store import Row

_PLAIN = ("participant", "place", "repeats", "block", "task", "staircase", "level", "answer", "right", "reaction_s",
          "void", "begun_s", "ended_s", "session")  # fmt: skip


def write_table(rows: Iterable[Row], path: Path) -> None:
    """Write trials as tab-separated values, with a column for each factor and for each figure of each interval."""
    listed = list(rows)
    factors = sorted({name for row in listed for name in row.condition})
    figures = sorted({(index, name) for row in listed for index, felt in enumerate(row.felt or []) for name in felt})
    head = [*_PLAIN, *factors, *(f"{name}_{index + 1}" for index, name in figures)]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, delimiter="\t", lineterminator="\n")
        writer.writerow(head)
        for row in listed:
            felt = row.felt or []
            cells = [getattr(row, name) for name in _PLAIN] + [row.condition.get(name) for name in factors]
            cells += [felt[index].get(name) if index < len(felt) else None for index, name in figures]
            writer.writerow(["n/a" if cell in (None, "") else cell for cell in cells])
