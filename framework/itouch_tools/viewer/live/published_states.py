"""Samples of what a running session publishes, and the events since the last sample; the loop is not disturbed."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from itouch.plugin import Contact, Record
from itouch.servo import Link
from itouch.session.marks import remembered
from itouch.world import Model
from itouch.world.state import EVENTS

#: Niceness of a process that only passes States on, and its shortest and longest time [s] between two looks.
NICE: Final = 10
_SHORTEST, _LONGEST = 5e-4, 5e-3
#: How many moments may wait, by default.
WAITING: Final = 32


@dataclass(frozen=True, slots=True)
class Moment:
    """A copy of one published State, and when it was published [ns] by the wall clock."""

    tick: int
    wall_ns: int
    state: Record


class Moments:
    """Takes a session's States at a rate [Hz]; ``passed`` is how many were passed over.

    At most ``waiting`` of them wait; of more the oldest are passed over, so that what is passed on is never old.
    """

    def __init__(self, link: Link, rate: float, *, waiting: int = WAITING) -> None:
        self._link, self._follower, self._most = link, link.follow(), waiting
        self._every = max(1, round(1.0 / (rate * link.period)))
        self._rest = min(_LONGEST, max(_SHORTEST, 0.25 * self._every * link.period))
        self._state = Record(link.dtype)
        self._passed = 0

    @property
    def passed(self) -> int:
        """How many moments were passed over because too many were waiting."""
        return self._passed + self._follower.dropped // self._every

    def take(self) -> Iterator[list[Moment]]:
        """Yield lists of the new moments, oldest first, until the session ends; a list may be empty."""
        with contextlib.suppress(OSError, AttributeError):
            os.nice(NICE)
        while self._link.alive:
            yield self._new()
            time.sleep(self._rest)

    def _new(self) -> list[Moment]:
        offset = time.time_ns() - time.monotonic_ns()
        due = [entry for entry in self._follower.take() if entry.tick % self._every == 0]
        self._passed += max(0, len(due) - self._most)
        found = []
        for entry in due[-self._most :]:
            state = Record(self._link.dtype)
            state.raw[:] = np.frombuffer(entry.state, np.uint8)
            found.append(Moment(entry.tick, entry.host_ns + offset, state))
        return found


class NewEvents:
    """Contact events and marks that are new since the last call, in the form that they have in a recording."""

    def __init__(self, model: Model, state: Record) -> None:
        self._model = model
        self._probes = {probe.index: probe.name for probe in model.probes}
        self._events, self._marks = int(state["events.count"]), int(state["marks.count"])

    def events(self, state: Record) -> list[dict[str, Any]]:
        """Return the contact events that are new, oldest first: time [s], tick, kind, probe, object, and figures."""
        count, table, found = int(state["events.count"]), state["events.table"], []
        for number in range(max(self._events, count - EVENTS), count):
            row = dict(zip(table.dtype.names or (), table[number % EVENTS].tolist(), strict=True))
            kind, tick, probe, index = (row.pop(name) for name in ("kind", "tick", "probe", "object"))
            finite = {name: np.asarray(value).tolist() for name, value in row.items() if np.isfinite(value).all()}
            found.append({"time": tick * self._model.period, "tick": tick, "kind": Contact(kind).name,
                          "probe": self._probes[probe], "object": self._model.objects[index], **finite})  # fmt: skip
        self._events = count
        return found

    def marks(self, state: Record) -> list[dict[str, Any]]:
        """Return the new marks, oldest first: time [s], tick, name, payload; at most `world.mark_fields.MARKS`."""
        count = int(state["marks.count"])
        new, self._marks = count - self._marks, count
        listed = remembered(state)[-new:] if new > 0 else []
        return [{"time": mark["tick"] * self._model.period, **mark} for mark in listed]
