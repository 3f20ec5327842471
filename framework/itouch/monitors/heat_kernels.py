"""What a plate may do to a finger, compiled: the arithmetic of `Heat` (T1 to T7), and its whole check.

In every function ``plate`` is a `Plate`, ``allowed`` an `Allowed`, ``memory`` a `Memory`, ``checks`` are
`runaway_kernels.SensorChecks`, ``look`` a `runaway_kernels.Look`, and a temperature is that of the plate [K].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.monitors import history_kernels, runaway_kernels
from itouch.monitors.default_limits import COLD_FROM, SINK, SINK_TRIP
from itouch.monitors.thresholds import (
    AHEAD,
    CONTACT_RATE_TIME,
    DOSE_FROM,
    DOSE_UNIT,
    DOUBLE,
    LONG,
    MEAN,
    RATE_TIME,
    SHORT,
    STEP,
)

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


class Plate(NamedTuple):
    """The indices of a plate's numbers: its temperature, fluxes and heat sinks in the reading, switches among commands.

    ``fluxes``, ``sinks`` and ``switches`` (n,): none, its own, or all of the device if it is not known which are its
    own; then the greatest flux and the hottest sink count, and the plate is off only if all switches are.  ``drives``
    (n,): indices of its drive commands, ``ceilings`` (n,): the greatest value of each, negative for a heater;
    ``targets`` (n,): 1 where the command is a temperature.
    """

    plate: int
    fluxes: Numbers
    sinks: Numbers
    switches: Numbers
    drives: Numbers
    ceilings: Floats
    targets: Numbers


class Allowed(NamedTuple):
    """The limits of a plate, and the codes of the trips.

    ``least`` and ``most``: temperatures [K] that trip; ``low`` and ``high``: those from which the drive is cut down
    [K]; ``rate`` [K/s] and ``flux`` [W/m2]: from which it is cut down; ``dose`` and ``cold`` [s]: that trip.
    """

    least: float
    low: float
    high: float
    most: float
    rate: float
    flux: float
    dose: float
    cold: float
    trip_temperature: int
    trip_rate: int
    trip_flux: int
    trip_dose: int
    trip_cold: int
    trip_jump: int


class Memory(NamedTuple):
    """What is remembered of a plate, as State has it.

    ``dose``, ``cold_time``: thermal dose and time in the cold so far; ``since``: when the contact began, NaN: there is
    none; (1,) each [s].  ``figure`` (3,): the figures of the last trip, in the units of its limit.
    """

    past: history_kernels.ReadingRing
    dose: Floats
    cold_time: Floats
    since: Floats
    figure: Floats
    runaway: runaway_kernels.Memory


@kernel
def check(
    plate: Any, allowed: Any, checks: Any, memory: Any, reading: Floats, sent: Floats, look: Any, fresh: bool
) -> float:  # fmt: skip
    """Check the newest readings; without a new one, budgets and clocks run on with the last one.

    Parameters
    ----------
    plate, allowed, checks, memory, look
        See above.
    reading, sent
        All numbers of the device's reading and of what it was sent, (n,) each, in their channels' units.
    fresh
        Whether a reading has come since the last check.

    Returns
    -------
    float
        The share of the drive that is allowed, or minus the code of a trip.
    """
    temperature = reading[plate.plate]
    flux = 0.0
    for k in range(len(plate.fluxes)):
        flux = max(flux, abs(reading[plate.fluxes[k]]))
    news = fresh and history_kernels.add(memory.past, look.time, temperature, flux)
    share = near_temperature(allowed, memory, temperature)
    share = min(share, near_rate(allowed, memory, temperature, look.touched))
    if len(plate.fluxes) > 0:
        share = min(share, near_flux(allowed, memory))
    sink = math.nan
    for k in range(len(plate.sinks)):
        sink = reading[plate.sinks[k]] if k == 0 else max(sink, reading[plate.sinks[k]])
    if len(plate.sinks) > 0:
        share = min(share, left(sink - SINK, SINK_TRIP - SINK))
    if share < 0.0:
        return float(share)
    spent = count(allowed, memory, temperature, look)
    if spent == 0.0 and news:
        spent = jump(allowed, memory)
    if spent != 0.0:
        return float(spent)
    found = runaway_kernels.check(
        checks, memory.runaway, temperature, sink, drive(plate, sent, temperature), look, news
    )
    return float(found if found != 0.0 else share)


@linked
def left(beyond: float, room: float) -> float:
    """Return the share of the drive that is left at ``beyond`` past a limit, whose trip is ``room`` past it."""
    return 1.0 if beyond <= 0.0 else max(0.0, 1.0 - beyond / room)


@linked
def drive(plate: Any, sent: Floats, temperature: float) -> float:
    """Return how strongly the plate is driven: -1 (heating) to 1 (cooling), as a part of the limit in force.

    ``sent`` (n,): all numbers that the device was sent; ``temperature`` of the plate [K].
    """
    off = len(plate.switches) > 0
    for k in range(len(plate.switches)):
        if sent[plate.switches[k]] >= 0.5:
            off = False
    if off:
        return 0.0
    found = 0.0
    for k in range(len(plate.drives)):
        one = runaway_kernels.drive_of(plate.targets[k] != 0, sent[plate.drives[k]], temperature, plate.ceilings[k])
        if abs(one) > abs(found):
            found = one
    return found


@linked
def near_temperature(allowed: Any, memory: Any, temperature: float) -> float:
    """Return the share of the drive that the plate's temperature, extrapolated a little, allows (T1, T2)."""
    ahead = temperature
    known, before = history_kernels.before(memory.past, SHORT)
    if known:
        ahead += (temperature - before) / RATE_TIME * AHEAD
    if not allowed.least <= ahead <= allowed.most:
        memory.figure[0], memory.figure[1], memory.figure[2] = temperature, ahead, 0.0
        return -float(allowed.trip_temperature)
    cold = left(allowed.low - ahead, allowed.low - allowed.least)
    hot = left(ahead - allowed.high, allowed.most - allowed.high)
    return float(min(cold, hot))


@linked
def near_rate(allowed: Any, memory: Any, temperature: float, touched: bool) -> float:
    """Return the share that the plate's rate in contact, a mean over half a second, allows (T5)."""
    if not touched:
        memory.since[0] = math.nan
        return 1.0
    newest = history_kernels.newest(memory.past)
    if math.isnan(memory.since[0]):
        memory.since[0] = newest
    before = history_kernels.value_at(memory.past, max(memory.since[0], newest - CONTACT_RATE_TIME), LONG)
    rate = abs(temperature - before) / CONTACT_RATE_TIME
    if rate > 2.0 * allowed.rate:
        memory.figure[0] = rate
        return -float(allowed.trip_rate)
    return float(left(rate - allowed.rate, allowed.rate))


@linked
def near_flux(allowed: Any, memory: Any) -> float:
    """Return the share that the mean of |flux| over a second allows (T6)."""
    mean, limit = history_kernels.mean_flux(memory.past, MEAN), allowed.flux
    if mean * 3.0 > limit * 3.99:  # 4/3, or a sensor that has been at the end of its scale all the time
        memory.figure[0] = mean
        return -float(allowed.trip_flux)
    return float(left(mean - limit, limit / 3.0))


@linked
def count(allowed: Any, memory: Any, temperature: float, look: Any) -> float:
    """Add to the thermal dose, in seconds at 43 degC (T3), and to the time in the cold; return a trip or 0."""
    if not look.touched:
        return 0.0
    if temperature >= DOSE_FROM:
        base = 0.5 if temperature >= DOSE_UNIT else 0.25
        memory.dose[0] += look.seconds * base ** (DOSE_UNIT - temperature)
        if memory.dose[0] > allowed.dose:
            return -float(allowed.trip_dose)
    elif temperature < COLD_FROM:
        memory.cold_time[0] += look.seconds
        if memory.cold_time[0] > allowed.cold:
            return -float(allowed.trip_cold)
    return 0.0


@linked
def jump(allowed: Any, memory: Any) -> float:
    """Trip on a step of the plate's sensor that no plate can make (T8)."""
    step = history_kernels.step(memory.past, SHORT, DOUBLE)
    if abs(step) <= STEP:
        return 0.0
    memory.figure[0] = step
    return -float(allowed.trip_jump)
