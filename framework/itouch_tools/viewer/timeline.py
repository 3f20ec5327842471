"""The time line of a recording: what happened when, and which time is shown; needs no graphics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.recording import Recording


@dataclass(slots=True)
class Timeline:
    """What a time line shows; times in seconds of the session.

    ``spans`` are contacts: begin, end, object.  ``marks`` and ``faults`` have a time and a name.  ``known`` (n,) says
    which of n equal parts have been read.
    """

    first: float
    last: float
    spans: tuple[tuple[float, float, str], ...] = ()
    marks: tuple[tuple[float, str], ...] = ()
    faults: tuple[tuple[float, str], ...] = ()
    now: float = 0.0
    playing: bool = True
    speed: float = 1.0
    reading: bool = False
    known: NDArray[np.bool_] = field(default_factory=lambda: np.ones(1, bool))

    @property
    def stops(self) -> list[float]:
        """Times [s] to jump to, in order: beginnings of contacts, marks, faults and both ends."""
        found = {self.first, self.last, *(t for t, _ in self.marks), *(t for t, _ in self.faults)}
        return sorted(found | {begin for begin, _, _ in self.spans})

    def share(self, seconds: float) -> float:
        """Return the place of a time [s] between the ends, 0 to 1."""
        return min(1.0, max(0.0, (seconds - self.first) / max(self.last - self.first, 1e-9)))

    def words(self) -> str:
        """Return the words beside the line: what it is doing, the speed, and the time that is shown."""
        sign = "reading" if self.reading else "playing" if self.playing else "paused"
        speed = f"{self.speed:g} x" if self.speed >= 1.0 else f"1/{1.0 / self.speed:g} x"
        return f"{sign:<8}{speed:<6}{self.now:9.3f} of {self.last:.3f} s"


def timeline(recording: Recording, ticks: NDArray[np.int64], period: float) -> Timeline:
    """Return the time line of a recording, given its ticks (n,) and the loop's period [s]."""
    first, last = float(ticks[0]) * period, float(ticks[-1]) * period
    marks = tuple((float(mark["time"]), str(mark["name"])) for mark in recording.marks)
    faults = tuple((float(f["time"]), str(f.get("trip") or f.get("kind"))) for f in recording.faults if f.get("trip"))
    return Timeline(first, last, tuple(_spans(recording.events, last)), marks, faults, now=first)


def _spans(events: Sequence[Mapping[str, Any]], last: float) -> list[tuple[float, float, str]]:
    begun: dict[str, tuple[float, str]] = {}
    found = []
    for event in events:
        probe, kind = str(event["probe"]), event["kind"]
        if kind == "END" and probe in begun:
            begin, name = begun.pop(probe)
            found.append((begin, float(event["time"]), name))
        elif kind == "BEGIN":
            begun[probe] = float(event["time"]), str(event["object"])
    return sorted([*found, *((begin, last, name) for begin, name in begun.values())])


def faults_at(
    faults: Sequence[Mapping[str, Any]], states: Sequence[Mapping[str, Any]], tick: int
) -> list[dict[str, Any]]:
    """Return the recorded faults that were present at a tick: those after which nobody had re-armed yet."""
    anew = max((int(s["tick"]) for s in states if s["reason"] in ("rearm", "enable") and int(s["tick"]) <= tick),
               default=-1)  # fmt: skip
    return [dict(f) for f in faults if f.get("trip") and not f.get("optional") and anew <= int(f["tick"]) <= tick]
