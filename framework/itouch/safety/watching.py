"""A reading's way past the monitors in a tick, compiled as far as nothing unusual is seen.

What is unusual changes nothing here and is left to Python: a reading that did not come or is not believed, a device
that is stopped.  The other monitors are called by Python when it is their turn.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import SKIP
from itouch.monitors.believing import Believable, Memory, check

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: What is left to Python: the whole step, or the monitors whose turn it is.
PYTHON, LOOK = 1, 2


class Watched(NamedTuple):
    """What of a device's State a reading's way goes past; all but ``raw``, ``seen`` and ``turns`` have shape (1,).

    ``raw``: the reading, ``seen``: the copy that monitors work with; ``words``: State as whole numbers, ``turns``:
    where in it monitors note when they looked last; ``due``: the time whose reading must be looked at.
    """

    status: Numbers
    taken: Numbers
    age: Numbers
    sequence: Numbers
    slip: Floats
    missed: Numbers
    heard: Numbers
    checked: Numbers
    share: Floats
    due: Numbers
    raw: Floats
    seen: Floats
    words: Numbers
    turns: Numbers


class Rhythm(NamedTuple):
    """The beat of a device in ticks, and the period [s]."""

    every: int
    apart: int
    clock: int
    period: float


@kernel
def due(status: Any, sequence: Any, tick: Any, taken: Any, replaced: Any, closed: int, every: int) -> int:
    """Say whether a reading is to be taken in this tick: 0, or SKIP; all but the numbers have shape (1,).

    Of a twin that was ``replaced`` it is PYTHON: what is compiled reads the one before.
    """
    taken[0] = 0
    if replaced[0] != 0:
        return PYTHON
    if status[0] == closed or (tick[0] % every != 0 and sequence[0] != 0):
        return SKIP
    return 0


@kernel
def came(tick: Any, measured: Any, taken: Any) -> int:
    """Note that a reading has come, measured in this tick: ``measured`` has the tick of each channel."""
    taken[0] = 1
    for i in range(len(measured)):
        measured[i] = tick[0]
    return 0


@kernel
def watch(
    device: Watched, able: Believable, memory: Memory, rhythm: Rhythm, tick: Any, closed: int, fault: int
) -> int:  # fmt: skip
    """Believe the reading that has come, and say whether it is a monitor's turn.

    Returns 0, LOOK, or PYTHON; then nothing was changed, but for the figure of a trip.
    """
    status = device.status[0]
    if status == closed:
        return 0
    now = tick[0] + device.missed[0]
    if device.taken[0] != 0:
        heard = device.heard[0]
        seconds = (device.age[0] + rhythm.every) * rhythm.period + device.slip[0]
        if heard >= 0:  # it may have gone on in periods that were left out
            seconds = max(seconds, (now - heard) * rhythm.period)
        if status == fault or device.share[0] != 1.0 or check(able, memory, device.raw, seconds) != 1.0:
            return PYTHON
        if (now - heard if heard >= 0 else rhythm.apart) >= rhythm.apart:
            device.due[0] = now
        device.taken[0] = device.age[0] = 0
        device.slip[0] = 0.0
        device.sequence[0] += 1
        device.heard[0] = device.checked[0] = now
        for i in range(len(device.raw)):
            device.seen[i] = device.raw[i]
    if device.heard[0] < 0:
        return 0
    for k in range(len(device.turns)):
        checked = device.words[device.turns[k]]
        if checked < 0 or now - checked >= rhythm.clock or device.due[0] == now:
            return LOOK
    return 0
