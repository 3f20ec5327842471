"""How far a sweep is: its rows by status, and why runs failed; also while it runs."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from itouch_tools.sweeps.store import PLAN, read_work, rows


@dataclass(frozen=True, slots=True)
class Status:
    """Runs of the plan, None if the folder does not say; rows by status; and how often there is each reason."""

    runs: int | None
    counts: Counter[str]
    reasons: Counter[str]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(self.counts.values())


def status_of(folder: Path) -> Status:
    """Return how far the sweep of a folder is.

    Raises
    ------
    StoreError
        If it is not the folder of a sweep.
    """
    read_work(folder)
    counts: Counter[str] = Counter()
    reasons: Counter[str] = Counter()
    for row in rows(folder, ["status", "reason"]):
        counts[row["status"]] += 1
        if row["reason"]:
            reasons[f"{row['status']}: {row['reason']}"] += 1
    return Status(_runs(folder), counts, reasons)


def _runs(folder: Path) -> int | None:
    try:
        return int(json.loads((folder / PLAN).read_text(encoding="utf-8"))["runs"])
    except (OSError, ValueError, KeyError, TypeError):
        return None  # a folder of an earlier version
