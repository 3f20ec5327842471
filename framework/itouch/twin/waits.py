"""Waits of a hand on its path until the skin is back at its temperature at the session's start; all of it is State.

The baseline is the mean of the readings of the first second, or of less if something is touched sooner; the skin's
present temperature is the mean of the readings of the last 0.1 s in which the finger was free.  While the hand waits,
its path is paused; after the longest time it goes on in any case.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.plugin import Bound, Record
from itouch.scene.elements import Operator
from itouch.schema.hold_until import Until
from itouch.twin.mechanics import lower
from itouch.world.fields import wait_fields
from itouch.world.skin import SkinSource, window_ticks

Floats = NDArray[np.float64]

#: How a wait ended.
NOT_YET, BACK, TOO_LONG = 0, 1, 2


@kernel
def look(
    skin: Any, valid: Any, object_: Any, force: Any, spans: Any, baseline: Any, averaged: Any, now: Any, fresh: Any
) -> int:
    """Update the means with the skin's reading of this tick; return 0.

    Parameters
    ----------
    skin, valid
        The reading [K], of which the first number counts, and whether it is valid, shape (1,).
    object_, force
        The touched object (-1: none) and the plate's force on the finger [N], shape (1,).
    spans
        Lengths of baseline, window and longest wait [tick], shape (3,).
    baseline, averaged, now, fresh
        The fields of State, shape (1,); written: the baseline [K] and the number of readings in it, the mean now [K]
        and the number of consecutive valid readings while nothing is touched.
    """
    touched = object_[0] >= 0 or force[0] > 0.0
    if touched and averaged[0] > 0:  # later readings are no longer the skin at the start
        averaged[0] = spans[0]
    if touched or valid[0] == 0 or not (skin[0] > 0.0 and skin[0] < np.inf):
        fresh[0] = 0
        return 0
    if averaged[0] < spans[0]:
        averaged[0] += 1
        baseline[0] += (skin[0] - baseline[0]) / averaged[0]
    fresh[0] += 1
    now[0] += (skin[0] - now[0]) / min(fresh[0], spans[1])
    return 0


@kernel
def stay(
    ticks: Any, tick: Any, at: Any, within: Any, spans: Any, baseline: Any, averaged: Any, now: Any, fresh: Any,
    begin: Any, waited: Any, end: Any, found: Any,
) -> int:  # fmt: skip
    """Return 1 if the hand waits in this tick instead of moving on along its path, else 0.

    Parameters
    ----------
    ticks, tick
        Ticks along its path, and the tick of the session, shape (1,).
    at, within
        Where on the path each wait is [tick], and how near the skin must be [K], shape (n,).
    spans, baseline, averaged, now, fresh
        As in ``look``.
    begin, waited, end, found
        When each wait began [tick], how long it has lasted [tick], how it ended, and the skin's temperature then [K],
        shape (n,); written.
    """
    for k in range(at.shape[0]):
        if end[k] != NOT_YET:
            continue
        if ticks[0] < at[k]:
            return 0
        if begin[k] < 0:
            begin[k] = tick[0]
        known = fresh[0] >= spans[1] and averaged[0] > 0
        if known and abs(now[0] - baseline[0]) <= within[k]:
            end[k] = BACK
        elif waited[k] >= spans[2]:
            end[k] = TOO_LONG
        else:
            waited[k] += 1
            return 1
        found[k] = now[0] if fresh[0] > 0 else 0.0
    return 0


@kernel
def follow_waiting_path(
    moving: Any, steered: Any, ticks: Any, time: Floats, period: float, offset: Floats, back: float, stage: Any,
    done: int, skin: Any, valid: Any, object_: Any, force: Any, tick: Any, at: Any, within: Any, spans: Any,
    baseline: Any, averaged: Any, now: Any, fresh: Any, begin: Any, waited: Any, end: Any, found: Any,
) -> int:  # fmt: skip
    """Advance along a hand's path by one tick, or wait; if the hand is steered, return 1 and leave it to Python.

    The first nine arguments are those of ``mechanics.follow_path``, the others those of ``look`` and ``stay``, with the
    same shapes, such as ``time`` (1,) [s].
    """
    if steered[0] != 0:
        return 1
    if moving[0] == 0 and stage[0] == done:
        lower(offset, 0.0, back)
    look(skin, valid, object_, force, spans, baseline, averaged, now, fresh)
    if moving[0] == 0:
        time[0] = ticks[0] * period
        return 0
    if stay(ticks, tick, at, within, spans, baseline, averaged, now, fresh, begin, waited, end, found) == 0:
        ticks[0] += 1
    time[0] = ticks[0] * period
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
        self._begin, self._end = state[f"{own}.wait_begin"], state[f"{own}.wait_end"]
        self._memory = [state[f"{own}.{field}"] for field in ("baseline", "averaged", "skin", "fresh")]
        self._table = [self._begin, state[f"{own}.waited"], self._end, state[f"{own}.wait_skin"]]
        skin = state[source.field].reshape(-1)[:1]
        valid = state[source.valid] if source.valid else np.ones(1)
        self._seen = (skin, valid, state[f"{name}.contact.object"], state[f"{name}.plate_force"])
        self._rules = (state["tick"], self.at, np.array(within, np.float64), spans)
        self.look = Bound(look, *self._seen, spans, *self._memory)
        self.stay = Bound(stay, state[f"{own}.ticks"], *self._rules, *self._memory, *self._table)
        self.look.warm_up()
        self.stay.warm_up()

    def bound(self, *path: Any) -> Bound:
        """Return the step along the path, with its waits, as one compiled call.

        ``path``: the arguments of ``mechanics.follow_path``, such as the time (1,) [s].
        """
        return Bound(follow_waiting_path, *path, *self._seen, *self._rules, *self._memory, *self._table)

    def reset(self) -> None:
        """Start without a baseline, before the first wait."""
        for field in (*self._memory, *self._table):
            field[...] = 0
        self._begin[...] = -1

    def pending(self, ticks: int) -> bool:
        """Tell whether the hand has come to a wait that has not ended yet."""
        return bool(np.any((self._end == NOT_YET) & (self.at <= ticks)))
