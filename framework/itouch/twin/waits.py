"""Waits of a hand on its path until the skin is back at its temperature at the session's start; all of it is State.

The baseline is the mean of the readings of the first second, or of less if something is touched sooner; the skin's
present temperature is the mean of the readings of the last 0.1 s in which the finger was free.  While the hand waits,
its path is paused; after the longest time it goes on in any case.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.plugin import Bound, Record
from itouch.scene.elements import Operator
from itouch.schema.hold_until import Until
from itouch.twin.mechanics import AlongPath, lower
from itouch.world.skin_source import SkinSource, window_ticks
from itouch.world.state_fields import wait_fields

Floats = NDArray[np.float64]

#: How a wait ended.
NOT_YET, BACK, TOO_LONG = 0, 1, 2


class Reading(NamedTuple):
    """The skin's reading of a tick, and what touches the finger, each of shape (1,).

    The temperature [K] and whether it is valid; the touched object (-1: none) and the plate's force on the finger [N].
    """

    skin: Any
    valid: Any
    object: Any
    force: Any


class Rules(NamedTuple):
    """The tick of the session, shape (1,), and when the hand waits.

    Where on the path each wait is [tick], and how near the skin must be [K], shape (n,); lengths of the baseline, of
    the window and of the longest wait [tick], shape (1,) each.
    """

    tick: Any
    at: Any
    within: Any
    first: Any
    window: Any
    longest: Any


class Means(NamedTuple):
    """The means of the skin's readings, fields of State of shape (1,).

    The baseline [K] and the number of readings in it, the mean now [K] and the number of consecutive valid readings
    while nothing is touched.
    """

    baseline: Any
    averaged: Any
    skin: Any
    fresh: Any


class Table(NamedTuple):
    """The waits so far, fields of State of shape (n,).

    When each began [tick], how long it has lasted [tick], how it ended, and the skin's temperature then [K].
    """

    wait_begin: Any
    waited: Any
    wait_end: Any
    wait_skin: Any


@kernel
def look(reading: Reading, rules: Rules, means: Means) -> int:
    """Update the means with the skin's reading of this tick; return 0."""
    skin, averaged, fresh = reading.skin[0], means.averaged, means.fresh
    touched = reading.object[0] >= 0 or reading.force[0] > 0.0
    if touched and averaged[0] > 0:  # later readings are no longer the skin at the start
        averaged[0] = rules.first[0]
    if touched or reading.valid[0] == 0 or not (skin > 0.0 and skin < np.inf):
        fresh[0] = 0
        return 0
    if averaged[0] < rules.first[0]:
        averaged[0] += 1
        means.baseline[0] += (skin - means.baseline[0]) / averaged[0]
    fresh[0] += 1
    means.skin[0] += (skin - means.skin[0]) / min(fresh[0], rules.window[0])
    return 0


@kernel
def stay(ticks: Any, rules: Rules, means: Means, waits: Table) -> int:
    """Return 1 if the hand waits in this tick instead of moving on along its path, else 0.

    ``ticks`` along its path, shape (1,); the waits are written.
    """
    for k in range(rules.at.shape[0]):
        if waits.wait_end[k] != NOT_YET:
            continue
        if ticks[0] < rules.at[k]:
            return 0
        if waits.wait_begin[k] < 0:
            waits.wait_begin[k] = rules.tick[0]
        known = means.fresh[0] >= rules.window[0] and means.averaged[0] > 0
        if known and abs(means.skin[0] - means.baseline[0]) <= rules.within[k]:
            waits.wait_end[k] = BACK
        elif waits.waited[k] >= rules.longest[0]:
            waits.wait_end[k] = TOO_LONG
        else:
            waits.waited[k] += 1
            return 1
        waits.wait_skin[k] = means.skin[0] if means.fresh[0] > 0 else 0.0
    return 0


@kernel
def follow_waiting_path(path: AlongPath, reading: Reading, rules: Rules, means: Means, waits: Table) -> int:
    """Advance along a hand's path by one tick, or wait; if the hand is steered, return 1 and leave it to Python."""
    if path.steered[0] != 0:
        return 1
    if path.moving[0] == 0 and path.stage[0] == path.done:
        lower(path.offset, 0.0, path.back)
    look(reading, rules, means)
    if path.moving[0] != 0 and stay(path.ticks, rules, means, waits) == 0:
        path.ticks[0] += 1
    path.time[0] = path.ticks[0] * path.period
    return 0


class Waits:
    """The waits of one hand.

    Parameters
    ----------
    operator, name, state, period
        The operator whose hand it is, the name of the probe, the State, and the servo period [s].
    source
        The reading of the skin's temperature.
    """

    def __init__(self, operator: Operator, name: str, state: Record, period: float, source: SkinSource) -> None:
        at, within, time = [], [], 0.0
        for target in operator.motion.targets:
            time += target.in_
            if isinstance(target.hold, Until):
                at.append(math.ceil(time / period - 1e-9))
                within.append(target.hold.within)
            else:
                time += target.hold
        own = f"{name}.hand"
        #: The fields of State that it reads, and those that it writes.
        self.reads = ("tick", source.field, source.valid, f"{name}.contact.object", f"{name}.plate_force")
        self.written = tuple(f"{own}.{field.name}" for field in wait_fields(len(at)))
        self.at, spans = np.array(at, np.int64), np.array(window_ticks(period), np.int64)
        self._means = Means(*(state[f"{own}.{field}"] for field in Means._fields))
        self._table = Table(*(state[f"{own}.{field}"] for field in Table._fields))
        skin = state[source.field].reshape(-1)[:1]
        valid = state[source.valid] if source.valid else np.ones(1)
        self._reading = Reading(skin, valid, state[f"{name}.contact.object"], state[f"{name}.plate_force"])
        near = np.array(within, np.float64)
        self._rules = Rules(state["tick"], self.at, near, spans[:1], spans[1:2], spans[2:])
        self.look = Bound(look, self._reading, self._rules, self._means)
        self.stay = Bound(stay, state[f"{own}.ticks"], self._rules, self._means, self._table)
        self.look.warm_up()
        self.stay.warm_up()

    def bound(self, path: AlongPath) -> Bound:
        """Return the step along the path, with its waits, as one compiled call."""
        return Bound(follow_waiting_path, path, self._reading, self._rules, self._means, self._table)

    def reset(self) -> None:
        """Start without a baseline, before the first wait."""
        for field in (*self._means, *self._table):
            field[...] = 0
        self._table.wait_begin[...] = -1

    def pending(self, ticks: int) -> bool:
        """Tell whether the hand has come to a wait that has not ended yet."""
        return bool(np.any((self._table.wait_end == NOT_YET) & (self.at <= ticks)))
