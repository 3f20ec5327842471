"""The progress of a sweep: runs, rate, time left, failures by kind; when it is to end; and how far a folder's is."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from itouch_tools.sweeps.sweep_elements import Stop, StopCriterion
from itouch_tools.sweeps.sweep_store import PLAN, read_work, rows

#: Half the width of a 95 % interval, in standard errors.
Z = 1.959964


@dataclass(slots=True)
class Mean:
    """Mean of a result and its 95 % interval, updated row by row."""

    count: int = 0
    mean: float = 0.0
    _squares: float = 0.0

    def add(self, value: float) -> None:
        """Take one value."""
        self.count += 1
        off = value - self.mean
        self.mean += off / self.count
        self._squares += off * (value - self.mean)

    @property
    def half_width(self) -> float:
        """Half the width of the interval; infinite with fewer than two values."""
        if self.count < 2:
            return math.inf
        return Z * math.sqrt(self._squares / (self.count - 1) / self.count)


@dataclass(slots=True)
class Progress:
    """Counts rows as they come."""

    total: int
    before: int
    stop: Stop
    began: float = field(default_factory=time.monotonic)
    done: int = 0
    retries: int = 0
    losses: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    means: dict[str, Mean] = field(default_factory=dict)

    def add(self, row: Mapping[str, Any], *, before: bool = False) -> None:
        """Count a row; ``before``: one that an earlier client wrote."""
        self.done += not before
        if row["status"] != "done":
            self.failures[str(row["status"])] += 1
        for one in self.stop.enough:
            value = row.get(one.result)
            if value is not None and math.isfinite(value):
                self.means.setdefault(one.result, Mean()).add(float(value))

    @property
    def seconds(self) -> float:
        """Seconds since this client began."""
        return time.monotonic() - self.began

    @property
    def share(self) -> float:
        """The share of the runs that is there, 0 to 1."""
        return (self.before + self.done) / self.total if self.total else 1.0

    def ended_by(self) -> str:
        """Return why the sweep is to end now; empty: it goes on."""
        stop = self.stop
        if stop.after is not None and self.seconds >= stop.after:
            return f"{stop.after:g} s have passed"
        if stop.failures is not None and sum(self.failures.values()) >= stop.failures:
            return f"{sum(self.failures.values())} runs were not 'done': {self.kinds()}"
        if stop.enough and all(self._known(one) for one in stop.enough):
            told = ", ".join(f"{name} = {m.mean:.4g} +- {m.half_width:.2g}" for name, m in self.means.items())
            return f"known well enough: {told} (95 %, {self.before + self.done} runs)"
        return ""

    def _known(self, one: StopCriterion) -> bool:
        mean = self.means.get(one.result, Mean())
        return mean.count >= one.at_least and mean.half_width <= one.half_width

    def kinds(self) -> str:
        """Return the failures by kind."""
        return ", ".join(f"{count} {kind}" for kind, count in sorted(self.failures.items())) or "none"

    def line(self) -> str:
        """Return one line for a terminal."""
        known, seconds = self.before + self.done, self.seconds
        rate = self.done / seconds if seconds > 0.0 else 0.0
        left = (self.total - known) / rate if rate > 0.0 else math.inf
        words = f"{known} of {self.total} runs, {rate:.2f} a second, {shown_time(left)} left; failures: {self.kinds()}"
        more = f"; tried again: {self.retries}" if self.retries else ""
        return words + more


def shown_time(seconds: float) -> str:
    """Return a duration in words."""
    if not math.isfinite(seconds):
        return "unknown time"
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


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
