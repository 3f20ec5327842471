"""Whether a plate's sensor and drive can be right, compiled: the arithmetic of `Runaway` (T8, T9).

In every function ``checks`` are `SensorChecks`, ``memory`` a `Memory`, ``look`` a `Look`, ``temperature`` the plate's
[K], and ``drive`` what `drive_of` returns [1].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.monitors.thresholds import (
    COLDEST_TARGET,
    DRIFT,
    DRIFT_DRIVE,
    DRIFT_TIME,
    DRIVEN,
    FAST,
    FAST_TIME,
    FROZEN,
    FROZEN_DRIVE,
    FROZEN_HELD,
    FULL_STRENGTH,
    LAG,
    PART,
    PARTS,
    RUNAWAY_DRIVE,
    RUNAWAY_STILL,
    RUNAWAY_TIME,
    RUNAWAY_WRONG,
    SLOPE_TIME,
    STOPPED,
    STOPPED_TIME,
    STOPPED_WITHIN,
)

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class SensorChecks(NamedTuple):
    """Checks of a plate's sensor: ``follows`` (whether) and ``part`` [1] of its drive, see `Runaway`; codes of trips.

    ``frozen`` and ``disagree``: of a sensor that is frozen or has drifted; ``runaway``: of a plate that does not obey
    its drive.
    """

    follows: bool
    part: float
    frozen: int
    disagree: int
    runaway: int


class Memory(NamedTuple):
    """What is remembered of a plate and its drive, as State has it; shape (1,) unless said otherwise.

    Of a reading that stays exactly the same: ``frozen`` itself [K]; ``frozen_at``, when the newest was measured, and
    ``frozen_for``, how long it has been the same [s]; ``frozen_drive``, how much the drive has changed meanwhile, times
    time, and ``frozen_held``, the seconds of full drive [s]; ``frozen_slope``, how fast it changed before [K/s];
    ``frozen_from``, the drive when that began [1].

    ``driven_for``: how long a strong drive has lasted, negative if it heats; ``touched_at``: when the plate was last
    touched; ``odd_for``: how long it has been on the wrong side of its heat sink [s].  ``parts`` (PARTS, 3): time [s],
    least and greatest temperature [K] of tenths of a second.  ``figure2`` (2,): the figures of the last trip, in the
    units of its limit.
    """

    frozen: Floats
    frozen_at: Floats
    frozen_for: Floats
    frozen_drive: Floats
    frozen_held: Floats
    frozen_slope: Floats
    frozen_from: Floats
    driven_for: Floats
    parts: Floats
    touched_at: Floats
    odd_for: Floats
    figure2: Floats


class Look(NamedTuple):
    """One look at a plate: times as in `Moment` [s], and whether a finger touches it."""

    now: float
    time: float
    seconds: float
    touched: bool


@kernel
def drive_of(target: bool, sent: float, temperature: float, ceiling: float) -> float:
    """Return how strongly a command drives its plate: -1 (heating) to 1 (cooling).

    ``target``: it is a temperature to be held [K]; else ``ceiling`` is the greatest drive, negative for a heater.
    """
    if target:
        known = sent >= COLDEST_TARGET  # else none was requested yet
        return max(-1.0, min(1.0, (temperature - sent) / FULL_STRENGTH)) if known else 0.0
    return sent / ceiling


@linked
def check(
    checks: Any, memory: Any, temperature: float, sink: float, drive: float, look: Any, news: bool
) -> float:  # fmt: skip
    """Return minus the code of a trip, or 0.

    ``sink``: temperature of the heat sink [K], NaN: not known; ``news``: whether the reading is a new one.
    """
    if look.touched:
        memory.touched_at[0] = look.now
    found = still(checks, memory, temperature, drive, look) if news else 0.0
    if found == 0.0:
        found = against(checks, memory, temperature, drive, look)
    if found == 0.0:
        found = odd(checks, memory, temperature, sink, drive, look)
    return float(found)


@linked
def still(checks: Any, memory: Any, temperature: float, drive: float, look: Any) -> float:
    """Trip on a sensor that reads exactly the same although the drive changes, or the plate must move on (T8)."""
    passed = max(0.0, look.time - memory.frozen_at[0])
    memory.frozen_at[0] = look.time
    last, change = memory.frozen[0], abs(drive - memory.frozen_from[0])
    if temperature != last:
        elapsed, slope = memory.frozen_for[0] + passed, memory.frozen_slope[0]
        steady = change * checks.part <= DRIVEN and elapsed > 0.0 and not math.isnan(last)
        newest = (temperature - last) / elapsed if steady else 0.0
        part = 1.0 - math.exp(-elapsed / SLOPE_TIME) if steady else 1.0
        memory.frozen_slope[0] = slope + part * (newest - slope)
        memory.frozen[0] = temperature
        memory.frozen_for[0] = memory.frozen_drive[0] = memory.frozen_held[0] = 0.0
        memory.frozen_from[0] = drive
        return 0.0
    memory.frozen_for[0] += passed
    memory.frozen_drive[0] += change * passed
    if abs(drive) > RUNAWAY_DRIVE:
        memory.frozen_held[0] += abs(drive) * passed
    same, driven = memory.frozen_for[0], memory.frozen_drive[0]
    changed = driven > FROZEN_DRIVE or (same > FROZEN and driven > DRIVEN * same)
    if changed or memory.frozen_held[0] > FROZEN_HELD or stopped(checks, memory, drive, same):
        memory.figure2[0] = same
        return -float(checks.frozen)
    return 0.0


@linked
def stopped(checks: Any, memory: Any, drive: float, same: float) -> bool:
    """Tell whether a plate whose temperature moved under a steady drive seems to have stopped abruptly."""
    slope = abs(memory.frozen_slope[0])
    strong = abs(drive) > DRIFT_DRIVE
    driven = checks.follows and strong and same > STOPPED_TIME
    # a device that controls its temperature itself stops where it was told to, however fast it moved
    fast = (checks.follows or strong) and slope > FAST and same > FAST_TIME
    return bool((driven or fast) and same <= STOPPED_WITHIN and slope * same > STOPPED)


@linked
def against(checks: Any, memory: Any, temperature: float, drive: float, look: Any) -> float:
    """Trip if the plate does not follow a strong drive, or goes the wrong way (T9)."""
    passed = memory.driven_for[0]
    if abs(drive) <= RUNAWAY_DRIVE or drive * passed < 0.0:
        memory.driven_for[0] = 0.0
        return 0.0
    passed += math.copysign(look.seconds, drive)
    memory.driven_for[0] = passed
    least, most = extremes(memory, temperature, look.now, look.now - abs(passed) + LAG)
    wrong = (temperature - least) if drive > 0.0 else (most - temperature)
    if wrong > RUNAWAY_WRONG:
        memory.figure2[0], memory.figure2[1] = wrong, 0.0
        return -float(checks.runaway)
    alone = look.now - memory.touched_at[0] >= RUNAWAY_TIME - 1e-9
    if abs(passed) >= RUNAWAY_TIME - 1e-9 and alone and checks.follows and most - least < RUNAWAY_STILL:
        memory.figure2[0], memory.figure2[1] = 0.0, abs(passed)
        return -float(checks.runaway)
    return 0.0


@linked
def extremes(memory: Any, temperature: float, now: float, begin: float) -> tuple[float, float]:
    """Note a temperature; return least and greatest of the last two seconds [K], without those before ``begin`` [s]."""
    if now < begin:
        return temperature, temperature
    index = int(math.floor(now / PART))
    row = memory.parts[index % PARTS]
    if row[0] != index * PART:
        row[0], row[1], row[2] = index * PART, temperature, temperature
    row[1], row[2] = min(row[1], temperature), max(row[2], temperature)
    oldest, least, most = max(begin, now - RUNAWAY_TIME) - PART, math.inf, -math.inf
    for i in range(PARTS):
        if memory.parts[i, 0] >= oldest:
            least, most = min(least, memory.parts[i, 1]), max(most, memory.parts[i, 2])
    return least, most


@linked
def odd(checks: Any, memory: Any, temperature: float, sink: float, drive: float, look: Any) -> float:
    """Trip if an untouched plate has long been where its drive cannot have brought it: its sensor has drifted (T8)."""
    beyond = (temperature - sink) * math.copysign(1.0, drive)
    weak = not DRIFT_DRIVE < abs(drive) < RUNAWAY_DRIVE
    if look.touched or weak or not beyond > DRIFT:
        memory.odd_for[0] = 0.0
        return 0.0
    memory.odd_for[0] += look.seconds
    if memory.odd_for[0] <= DRIFT_TIME:
        return 0.0
    memory.figure2[0], memory.figure2[1] = beyond, memory.odd_for[0]
    return -float(checks.disagree)
