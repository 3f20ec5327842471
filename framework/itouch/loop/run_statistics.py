"""Statistics of a run: contacts, faults and figures for the report; they are only written in a tick, never read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.loop.timing import Timing, merged


class Counts(NamedTuple):
    """Counts in bins of equal width, shape (n,); of shape (1,) their sum, the greatest number, and bins per unit."""

    counts: NDArray[np.uint32]
    total: NDArray[np.int64]
    greatest: NDArray[np.float64]
    per_unit: NDArray[np.float64]


@kernel
def counted(bins: Any, value: float) -> None:
    """Count one number in `Counts`; what is beyond the last bin, or NaN, is counted in the last bin."""
    if value > bins.greatest[0]:
        bins.greatest[0] = value
    place, last = value * bins.per_unit[0], bins.counts.shape[0] - 1
    bins.counts[int(place) if place < last else last] += 1
    bins.total[0] += 1


class Histogram:
    """Counts of positive numbers in bins of equal width: percentiles without keeping the numbers."""

    _BINS = 100_000

    def __init__(self, width: float) -> None:
        self.width = width
        #: The arrays in which compiled code counts; they are never replaced.
        self.bins = Counts(
            np.zeros(self._BINS, np.uint32), np.zeros(1, np.int64), np.zeros(1), np.array([1.0 / width])
        )  # fmt: skip

    @property
    def counts(self) -> NDArray[np.uint32]:
        """How many numbers each bin has."""
        return self.bins.counts

    @property
    def total(self) -> int:
        """How many numbers were counted."""
        return int(self.bins.total[0])

    @property
    def greatest(self) -> float:
        """The greatest number counted, 0 before the first."""
        return float(self.bins.greatest[0])

    def add(self, value: float) -> None:
        """Count one number; what is beyond the last bin counts in it."""
        counted(self.bins, float(value))

    def percentile(self, percent: float) -> float | None:
        """Return the upper edge of the bin that holds the percentile, or None if nothing was counted."""
        if self.total == 0:
            return None
        used = np.flatnonzero(self.counts)
        reached = np.cumsum(self.counts[used], dtype=np.int64) >= percent / 100 * self.total
        return min(self.greatest, (int(used[int(reached.argmax())]) + 1) * self.width)

    def summary(self, scale: float) -> dict[str, float | None]:
        """Return p50, p99 and max, multiplied by a scale."""
        values = {"p50": self.percentile(50), "p99": self.percentile(99)}
        named = {name: None if value is None else value * scale for name, value in values.items()}
        return {**named, "max": self.greatest * scale if self.total else None}

    def dump(self) -> dict[str, Any]:
        """Return the content as plain data."""
        used = np.flatnonzero(self.counts)
        counts = {str(i): count for i, count in zip(used.tolist(), self.counts[used].tolist(), strict=True)}
        return {"counts": counts, "total": self.total, "greatest": self.greatest}

    def load(self, data: dict[str, Any]) -> None:
        """Take over what ``dump`` returned.

        Raises
        ------
        ValueError
            If the data do not fit.
        """
        counts = np.zeros(self._BINS, np.uint32)
        for index, count in data["counts"].items():
            if not 0 <= int(index) < len(counts):
                raise ValueError(f"histogram bin {index} does not exist")
            if not 0 <= int(count) < 1 << 32:
                raise ValueError(f"histogram bin {index} can't hold {count}")
            counts[int(index)] = int(count)
        self.counts[:] = counts
        self.bins.total[0], self.bins.greatest[0] = int(data["total"]), float(data["greatest"])


@dataclass(slots=True)
class RunStatistics:
    """What happened, for the report; ``contacts`` holds the closed ones.

    ``settle`` adds the entry of a contact that has ended to ``closed``, if one has since it was last called; ``times``
    is the Timing of this run, if there is one; ``earlier`` holds the histograms of the runs before a restore, and
    ``left_out`` counts the oldest contacts for which the stored session had no room.
    """

    closed: list[dict[str, Any]] = field(default_factory=list)
    faults: list[dict[str, Any]] = field(default_factory=list)
    tracking: Histogram = field(default_factory=lambda: Histogram(1e-6))
    worst_height: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    times: Timing | None = None
    earlier: dict[str, list[list[float]]] = field(default_factory=dict)
    settle: Callable[[], None] | None = None
    left_out: int = 0

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Entries of the contacts that have ended, in the order of their ends."""
        if self.settle is not None:
            self.settle()
        return self.closed

    @property
    def height_error(self) -> float:
        """Greatest difference [m] between virtual surface and plate in a contact that the plate rendered."""
        worst: float = self.worst_height[0].item()
        return worst

    def notices(self) -> tuple[str, ...]:
        """Return what has to be said of what is missing."""
        if not self.left_out:
            return ()
        return (
            f"the first {self.left_out} contacts of the session are missing: a saved session has room for later ones",
        )

    def histograms(self) -> dict[str, list[list[float]]]:
        """Return lateness and duration of all ticks, also of those before a restore, in bins [us, us, count]."""
        now = self.times.histograms() if self.times is not None else {}
        if not self.earlier:
            return now
        names = dict.fromkeys((*now, *self.earlier))
        return {name: merged([self.earlier.get(name), now.get(name)]) for name in names}

    def dump(self) -> dict[str, Any]:
        """Return the content as plain data, for a snapshot."""
        return {
            "contacts": self.contacts,
            "faults": self.faults,
            "tracking": self.tracking.dump(),
            "height_error": self.height_error,
            "histograms_us": self.histograms(),
            **({"left_out": self.left_out} if self.left_out else {}),
        }

    def load(self, data: dict[str, Any]) -> None:
        """Take over what ``dump`` returned."""
        left_out = data.get("left_out", 0)
        if not isinstance(left_out, int) or left_out < 0:
            raise ValueError(f"{left_out!r} contacts can't be left out")
        self.left_out = left_out
        self.contacts[:], self.faults = list(data["contacts"]), list(data["faults"])
        self.tracking.load(data["tracking"])
        self.worst_height[0] = float(data["height_error"])
        earlier = data.get("histograms_us", {})  # snapshots of format 1.0 and the first of 1.1 have none
        self.earlier = {name: merged([earlier[name]]) for name in ("lateness", "tick") if name in earlier}
