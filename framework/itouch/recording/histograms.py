"""Histograms of the loop's timing, summed from the notes of every second."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

#: Key of a note -> name of the histogram, as in a report.
NAMES = {"lateness": "lateness", "ticks": "tick"}


def histograms_us(session: Mapping[str, Any], notes: Iterable[Mapping[str, Any]]) -> dict[str, list[list[float]]]:
    """Return the histograms of lateness and duration of ticks: bins of lower edge [us], upper edge [us] and count.

    ``session`` has the edges, ``notes`` the counts since the previous note.  Recordings of earlier versions have none;
    entries that cannot be the count of a bin are left out, as a file may contain anything.
    """
    edges = session.get("timing_edges_us")
    if not isinstance(edges, list) or not all(isinstance(e, int | float) and 0 <= e < 1e12 for e in edges):
        return {}
    totals: dict[str, dict[int, int]] = {name: {} for name in NAMES.values()}
    for note in notes:
        for key, name in NAMES.items():
            for index, count in _counts(note.get(key), len(edges) - 1):
                totals[name][index] = totals[name].get(index, 0) + count
    return {
        name: [[edges[index], edges[index + 1], count] for index, count in sorted(total.items())]
        for name, total in totals.items()
        if total
    }


def _counts(entries: object, bins: int) -> Iterable[tuple[int, int]]:
    for entry in entries if isinstance(entries, list) else ():
        if isinstance(entry, list) and len(entry) == 2 and all(type(number) is int for number in entry):
            index, count = entry
            if 0 <= index < bins and 0 < count < 1 << 53:
                yield index, count
