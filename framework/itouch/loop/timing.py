"""Timing: how late ticks began, how long they and their parts took, and what made them overrun.

It is a record of its own beside State, and nothing in a tick reads it.  Everything is counted in bins of equal ratio,
so that hours need no more memory than seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import run_chain
from itouch.plugin import Field, Record

#: Bins per octave, shortest duration [s] that is resolved, and the number of bins: they reach up to some 16 s.
PER_OCTAVE, LEAST, BINS = 16, 0.25e-6, 416
#: Culprits on the machine's side, not the loop's: a tick was woken late, or was preempted.
WAKE_UP, TAKEN = "wake-up", "processor taken"
#: Culprit for what the loop does between two ticks: publishing, listening to commands, a user's callbacks.
BETWEEN = "between ticks"
_SCALE = 1.0 / LEAST

Stamps = Sequence[float] | NDArray[np.float64]


def edges() -> NDArray[np.float64]:
    """Return the edges of the bins [s], shape (BINS + 1,); anything shorter than the first is in the first bin."""
    return LEAST * 2.0 ** (np.arange(BINS + 1) / PER_OCTAVE)


_BORDERS_US = [round(1e6 * edge, 3) for edge in edges().tolist()]


def bins(counts: NDArray[Any]) -> list[list[float]]:
    """Return the bins that are not empty: lower edge [us], upper edge [us], count; ``counts`` has shape (BINS,)."""
    used = np.flatnonzero(counts)
    held = zip(used.tolist(), counts[used].tolist(), strict=True)
    return [[_BORDERS_US[i], _BORDERS_US[i + 1], count] for i, count in held]


def merged(histograms: Iterable[object]) -> list[list[float]]:
    """Return the sum of histograms of the form that ``bins`` returns; what can't be a bin is left out.

    They may come from files, so nothing in them is taken for granted.
    """
    total: dict[tuple[float, float], int] = {}
    for histogram in histograms:
        for entry in histogram if isinstance(histogram, list) else ():
            if isinstance(entry, list) and len(entry) == 3 and all(isinstance(n, int | float) for n in entry):
                low, high, count = entry
                if 0.0 <= low < high < 1e12 and 0 < count < 1 << 53:
                    total[float(low), float(high)] = total.get((float(low), float(high)), 0) + int(count)
    return [[low, high, count] for (low, high), count in sorted(total.items())]


def percentile(counts: NDArray[Any], percent: float, greatest: float = math.inf) -> float | None:
    """Return a percentile [s] of binned durations to within 2 %, or None if there are none.

    ``counts`` (bins,): how many durations each bin has; ``percent`` 0 to 100, ``greatest`` [s].
    """
    total = int(counts.sum())
    if total == 0:
        return None
    rank = percent / 100 * total
    below = np.cumsum(counts)
    index = int(np.searchsorted(below, rank))
    before = int(below[index - 1]) if index else 0
    share = (rank - before) / int(counts[index])
    return min(greatest, LEAST * math.pow(2.0, (index + share) / PER_OCTAVE))


#: How many of the worst overruns are kept.
WORST = 8


def timing_fields(parts: int) -> tuple[Field, ...]:
    """Return the fields of a Timing record for a tick with this many parts."""
    return (
        Field("ticks", "i8", unit="tick", doc="ticks so far"),
        Field("overruns", "i8", unit="tick", doc="ticks that ended after the next was due"),
        Field("skipped", "i8", unit="tick", doc="periods that were given up after the loop had been held for too long"),
        Field("greatest", "f8", 3 + parts, unit="s", doc="greatest of each row of counts"),
        Field("culprits", "i8", 3 + parts, unit="tick", doc="overruns by what made them, see Timing.culprit_names"),
        Field("worst", "f8", (WORST, 3), unit="mixed", doc="overruns: tick, how long after the next was due [s], part"),
        Field(
            "counts",
            "u4",
            (3 + parts, BINS),
            unit="tick",
            doc="histograms of lateness, tick time, each part, and processor time per tick with what follows it",
        ),
    )


@kernel
def count(counts: Any, greatest: Any, row: int, seconds: float) -> None:
    """Count one duration [s] in a row of histograms, ``counts`` (rows, BINS); ``greatest`` (rows,) of durations [s]."""
    index = int(math.log2(seconds * _SCALE) * PER_OCTAVE) if seconds > LEAST else 0
    counts[row, min(index, BINS - 1)] += 1
    if seconds > greatest[row]:
        greatest[row] = seconds


_count_one = getattr(count, "py_func", count)


@kernel
def _count_tick(counts: Any, greatest: Any, stamps: Any, used: int, listener: int) -> int:
    """Count a tick in row 1, and its parts in the rows after it if the parts were stamped; then run a listener's chain.

    Return what `run_chain` does; ``listener`` is the address of the chain, 0: there is none.
    """
    count(counts, greatest, 1, stamps[used - 1] - stamps[0])
    if used == counts.shape[0] - 2:  # one more stamp than parts; lateness, the tick and the processor have rows, too
        for part in range(used - 1):
            count(counts, greatest, 2 + part, stamps[part + 1] - stamps[part])
    return int(run_chain(listener, 0)) if listener != 0 else -1


class Timing:
    """Counts ticks.

    Attributes
    ----------
    parts
        Names of the parts of a tick, in order: ``read DEVICE``, ``contact``, ``modality NAME``, ``safety``,
        ``write DEVICE``, ``twins``.
    record
        The numbers; ``counts`` has lateness in row 0, whole ticks in row 1, then a row for each part, and in the last
        row the processor time of a tick, together with what the loop does until it waits for the next one.
    """

    def __init__(self, parts: Sequence[str], record: Record | None = None) -> None:
        self.parts = tuple(parts)
        self.record = record if record is not None else Record.of(timing_fields(len(self.parts)))
        self._counts = self.record["counts"]
        self._greatest = self.record["greatest"]
        # the same memory for Python, which counts a single duration faster than it can call compiled code
        self._counted, self._most = self._counts.data, self._greatest.data
        self._told = self.record["ticks"].reshape(1).data
        self._stamps = np.zeros(2 + len(self.parts))
        # compile now, not in the first tick
        _count_tick(self._counts.copy(), self._greatest.copy(), self._stamps, 2, 0)
        self._ticks, self._overruns, self._skipped = (self.record[n] for n in ("ticks", "overruns", "skipped"))
        #: How late [s] the current tick began.
        self.late = 0.0
        self._culprit = -1  # of the overrun that the loop has not caught up with yet
        #: How late [s] the loop would be by its own work alone.
        self._behind = 0.0
        self._maker = 0  # what made it so late

    @property
    def ticks(self) -> int:
        """How many ticks were timed."""
        return int(self._ticks)

    @property
    def overruns(self) -> int:
        """How many ticks ended after the next one was due."""
        return int(self._overruns)

    @property
    def skipped(self) -> int:
        """How many periods were given up after the loop had been held for too long."""
        return int(self._skipped)

    def _add(self, row: int, seconds: float) -> None:
        _count_one(self._counted, self._most, row, seconds)

    @property
    def views(self) -> tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[np.float64]]:
        """The number of timed ticks (1,), the histograms and the greatest times, for compiled code to count in."""
        return self.record["ticks"].reshape(1), self._counts, self._greatest

    def add_whole(self, seconds: float) -> None:
        """Note one tick that took this long [s], its parts unknown."""
        self._told[0] += 1
        _count_one(self._counted, self._most, 1, seconds)

    def add(self, stamps: Stamps, listener: int = 0) -> int:
        """Note one tick; ``stamps`` (n,) [s] are taken at its start, after each part (or none) and at its end.

        In the same compiled call a listener hears of the tick (`CompiledListener.place`; 0: there is none); return what
        it leaves to Python as `run_chain` does, -1 if nothing.
        """
        self._told[0] += 1
        used = len(stamps)
        self._stamps[:used] = stamps
        found: int = _count_tick(self._counts, self._greatest, self._stamps, used, listener)
        return found

    def pace(
        self, late: float, period: float, stamps: Stamps, tick: int = 0, *, end: float | None = None,
        busy: float | None = None, waited: bool = False,
    ) -> str | None:  # fmt: skip
        """Note a tick in real time; return the culprit if it overran.

        The cause is the loop itself if it would have been late even on a machine that always wakes it in time and never
        preempts it; how late it would be then is carried on from tick to tick.  Otherwise the cause is the machine.

        Parameters
        ----------
        late, period
            How late [s] the tick began, and the period of the loop [s].
        stamps
            Those of ``add``, shape (n,) [s].
        tick
            Its number.
        end
            When the loop was ready to wait for the next tick, by the same clock [s]; None: when the tick ended.
        busy
            The thread's processor time from its waking up until then [s]; None: not known, and the whole time that
            passed is put down to the loop.
        waited
            Whether it waited by itself meanwhile, as for a device that blocks: then, too, the whole time is the loop's.
        """
        self._add(0, max(late, 0.0))
        work = float(stamps[-1] - stamps[0])
        after = 0.0 if end is None else end - float(stamps[-1])
        if busy is not None:
            self._add(len(self._most) - 1, busy)
        mine = work + after if busy is None or waited else busy
        ideal = self._behind + mine
        self._behind = max(0.0, ideal - period)
        if mine > period:
            self._maker = self._longest(stamps, after)
        if late + work <= period:
            self._culprit = -1
            return None
        own, before, taken = ideal > period, self._culprit, len(self.parts) + 2
        if before < 0 or mine > period or own == (before in (0, taken)):  # else it is the backlog of an earlier overrun
            self._culprit = self._maker if own else 0 if late >= work + after - mine else taken
        self._overruns += 1
        self.record["culprits"][self._culprit] += 1
        self._keep(tick, late + work - period)
        return self.culprit_names[self._culprit]

    def _longest(self, stamps: Stamps, after: float) -> int:
        """Return the number of the culprit that took longest of what the loop did; BETWEEN if no parts were stamped."""
        shares = [*(float(b - a) for a, b in zip(stamps, stamps[1:], strict=False)), after]
        return 1 + shares.index(max(shares)) if len(shares) == 1 + len(self.parts) else 1 + len(self.parts)

    def _keep(self, tick: int, over: float) -> None:
        """Keep an overrun if it is among the worst."""
        worst = self.record["worst"]
        least = int(worst[:, 1].argmin())
        if over > worst[least, 1]:
            worst[least] = tick, over, self._culprit

    def worst(self) -> list[dict[str, Any]]:
        """Return the worst overruns, worst first: tick, how long after the next was due [us], and the culprit."""
        rows = sorted((row for row in self.record["worst"].tolist() if row[1] > 0.0), key=lambda row: -row[1])
        names = self.culprit_names
        return [{"tick": int(tick), "us": over * 1e6, "culprit": names[int(part)]} for tick, over, part in rows]

    def skip(self, periods: int) -> None:
        """Note that periods were given up, so that there is nothing left to catch up on."""
        self._skipped += periods
        self._behind = 0.0

    @property
    def culprit_names(self) -> tuple[str, ...]:
        """Return the names of all possible culprits of an overrun, in the order of ``culprits``."""
        return (WAKE_UP, *self.parts, BETWEEN, TAKEN)

    def figures(self, row: int) -> dict[str, float | None]:
        """Return p50, p99, p99.9 and max of one row of ``counts`` [us]."""
        counts, worst = self.record["counts"][row], float(self.record["greatest"][row])
        named = (("p50", 50.0), ("p99", 99.0), ("p99.9", 99.9))
        found = {name: percentile(counts, percent, worst) for name, percent in named}
        found["max"] = worst if counts.any() else None
        return {name: None if value is None else value * 1e6 for name, value in found.items()}

    def summary(self) -> dict[str, float | None]:
        """Return p50, p99, p99.9 and max of whole ticks [us]."""
        return self.figures(1)

    def lateness(self) -> dict[str, float | None]:
        """Return p50, p99, p99.9 and max of how late ticks began [us]."""
        return self.figures(0)

    def processor(self) -> dict[str, float | None]:
        """Return p50, p99, p99.9 and max of the processor time of a tick in real time, with what follows it [us]."""
        return self.figures(len(self._most) - 1)

    def machine(self) -> dict[str, int]:
        """Return how many overruns the machine caused, by late wake-ups and by taking the processor away."""
        found = self.culprits()
        return {name: found.get(name, 0) for name in (WAKE_UP, TAKEN)}

    def split(self) -> dict[str, dict[str, float | None]]:
        """Return p50, p99, p99.9 and max of each part of a tick [us]."""
        return {name: self.figures(2 + index) for index, name in enumerate(self.parts)}

    def culprits(self) -> dict[str, int]:
        """Return how many overruns each culprit caused: parts, the time between ticks, the machine; zeros left out."""
        counts = self.record["culprits"].tolist()
        return {name: count for name, count in zip(self.culprit_names, counts, strict=True) if count}

    def histogram(self, row: int) -> list[list[float]]:
        """Return the bins of one row that are not empty: lower edge [us], upper edge [us], count."""
        return bins(self.record["counts"][row])

    def histograms(self) -> dict[str, list[list[float]]]:
        """Return how late ticks began (in real time; else empty) and how long they took, as ``histogram`` does."""
        return {"lateness": self.histogram(0), "tick": self.histogram(1)}
