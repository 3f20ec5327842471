"""The step in which monitors look at a device's reading, and how often each looks, compiled.

What is unusual is left to Python, and nothing is changed here: a reading that did not come or is not believed, a device
that is stopped.  When a plate's monitor finds something else than before, Python acts on it.  Monitors of other kinds
are called by Python when it is their turn.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.joining import SKIP
from itouch.monitors import heat_kernels
from itouch.monitors.readings_kernels import Memory, PlausibilityLimits, check
from itouch.monitors.runaway_kernels import Look, SensorChecks

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

#: Codes for what is left to Python: the whole step, the monitors whose turn it is, or (TOLD plus its number) to act on
#: what one of them has found.
PYTHON, LOOK, TOLD = 1, 2, 3


class Watched(NamedTuple):
    """The part of a device's State that checking a reading needs; arrays have shape (1,) unless said otherwise.

    ``raw`` (n,): the reading, ``seen`` (n,): the copy that monitors work with; ``words``: all of State as integers,
    ``turns``: the indices in it of when monitors looked last; ``due``: time of the reading that must be checked at
    once.
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


class CheckSchedule(NamedTuple):
    """How often a device is read and its monitors are asked, in ticks, and the period of a tick [s].

    ``every``: ticks from reading to reading; ``apart``: distance from which on a reading is checked at once; ``clock``:
    longest time between two checks.
    """

    every: int
    apart: int
    clock: int
    period: float


class Clocks(NamedTuple):
    """Times of a device in ticks: how many were left out, and when its last reading came, each (1,).

    ``measured`` (n,): when each of its readings was measured.
    """

    missed: Numbers
    heard: Numbers
    measured: Numbers


@kernel
def clocked(ticks: int, period: float) -> float:
    """Return the time [s] of this many ticks, rounded to 1 ns: the decimal number that they stand for."""
    return float(np.rint(ticks * period * 1e9) / 1e9)


@kernel
def moment(clocks: Any, checked: int, tick: int, period: float) -> tuple[float, float, float]:
    """Return the time now, the time at which the newest reading was measured, and the time since ``checked`` [s].

    ``clocks``: `Clocks`; ``checked``: when a monitor looked last, in ticks; below 0: not yet, or not since a pause;
    then the last is 0.
    """
    now, newest = tick + clocks.missed[0], clocks.measured[0]
    for i in range(1, len(clocks.measured)):
        newest = max(newest, clocks.measured[i])
    return (
        clocked(now, period), clocked(newest + clocks.missed[0], period),
        clocked(now - checked, period) if checked >= 0 else 0.0,
    )  # fmt: skip


class Asked(NamedTuple):
    """A plate's monitor: when it looked last [ticks], the share that it allowed, what it finds; all of shape (1,).

    ``due``: time of the reading that must be checked at once; ``touched``: whether a finger touches the device.
    """

    checked: Numbers
    share: Floats
    said: Floats
    due: Numbers
    touched: Numbers


@kernel
def due(status: Any, sequence: Any, tick: Any, taken: Any, replaced: Any, closed: int, every: int) -> int:
    """Return 0 if a reading is to be taken in this tick, else SKIP; arrays have shape (1,).

    ``status``: the device's, a code; ``sequence``: the number of its readings so far; ``tick``: the number of this
    tick; ``taken``: whether a reading has come, set to 0; ``replaced``: whether another twin stands in for it: then it
    returns PYTHON, because the compiled calls read the one before.
    """
    taken[0] = 0
    if replaced[0] != 0:
        return PYTHON
    if status[0] == closed or (tick[0] % every != 0 and sequence[0] != 0):
        return SKIP
    return 0


@kernel
def came(tick: Any, measured: Any, taken: Any) -> int:
    """Note that a reading has come that was measured in this tick: ``measured`` (n,) is the tick of each channel.

    ``tick`` (1,): the number of this tick; ``taken`` (1,): whether a reading has come, set to 1.
    """
    taken[0] = 1
    for i in range(len(measured)):
        measured[i] = tick[0]
    return 0


@kernel
def watch(
    device: Watched, limits: PlausibilityLimits, memory: Memory, rhythm: CheckSchedule, tick: Any, closed: int,
    fault: int,
) -> int:  # fmt: skip
    """Check the reading that has come, take it over if it is believed, and tell whether it is a monitor's turn.

    Returns 0, LOOK, or PYTHON; with PYTHON nothing has changed, except the figure of a trip.  ``tick`` (1,): the number
    of this tick.
    """
    status = device.status[0]
    if status == closed:
        return 0
    now = tick[0] + device.missed[0]
    if device.taken[0] != 0:
        heard = device.heard[0]
        seconds = (device.age[0] + rhythm.every) * rhythm.period + device.slip[0]
        if heard >= 0:  # the device may have gone on in periods that were left out
            seconds = max(seconds, (now - heard) * rhythm.period)
        if status == fault or device.share[0] != 1.0 or check(limits, memory, device.raw, seconds) != 1.0:
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


@kernel
def ask(
    one: Asked, clocks: Clocks, rhythm: CheckSchedule, status: Any, tick: Any, plate: heat_kernels.Plate,
    allowed: heat_kernels.Allowed, checks: SensorChecks, memory: heat_kernels.Memory, seen: Floats, sent: Floats,
    number: int, closed: int,
) -> int:  # fmt: skip
    """Let the monitor of a plate look if it is its turn; ``number``: which of the device's monitors it is.

    Returns 0, or TOLD + ``number`` if what it finds, in ``one.said``, is not the share that it allowed before.

    ``status`` (1,): the device's, a code; ``tick`` (1,): the number of this tick; ``seen`` and ``sent`` (n,): all
    numbers that the device read and was sent, in their channels' units.
    """
    if status[0] == closed or clocks.heard[0] < 0:
        return 0
    now, checked = tick[0] + clocks.missed[0], one.checked[0]
    if checked >= 0 and now - checked < rhythm.clock and one.due[0] != now:
        return 0
    at, time, seconds = moment(clocks, checked, tick[0], rhythm.period)
    one.checked[0] = now
    look, fresh = Look(at, time, seconds, one.touched[0] != 0), clocks.heard[0] > checked
    one.said[0] = heat_kernels.check(plate, allowed, checks, memory, seen, sent, look, fresh)
    return 0 if one.said[0] == one.share[0] else TOLD + number
