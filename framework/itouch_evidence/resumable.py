"""Results of a campaign in a file, one a line, so that it can be stopped, continued and extended."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


class Kept:
    """The results of a campaign so far, by seed and number; without a file, only in memory.

    Campaigns with different seeds may write into one file, one after the other, and then count as one.
    A line that was cut off by a kill is ignored, so its case runs again.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self._path = None if path is None else Path(path)
        self.rows: dict[tuple[int, int], dict[str, Any]] = {}
        if self._path is None or not self._path.exists():
            return
        text = self._path.read_text(encoding="utf-8")
        for line in text.splitlines(keepends=True):
            row = _row(line)
            if row is not None:
                self.rows[row["seed"], row["number"]] = row
        if text and not text.endswith("\n"):
            with open(self._path, "a", encoding="utf-8") as stream:
                stream.write("\n")

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self.rows

    def add(self, seed: int, number: int, row: dict[str, Any]) -> None:
        """Keep a result."""
        row = {"seed": seed, "number": number, **row}
        self.rows[seed, number] = row
        if self._path is not None:
            with open(self._path, "a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")

    @property
    def seeds(self) -> list[int]:
        """The seeds that have results, in order."""
        return sorted({seed for seed, _ in self.rows})


def _row(line: str) -> dict[str, Any] | None:
    """Return the result in a line; None if the line is incomplete."""
    try:
        row: dict[str, Any] = json.loads(line)
        return row if line.endswith("\n") and row["seed"] is not None and row["number"] is not None else None
    except (ValueError, TypeError, KeyError):
        return None
