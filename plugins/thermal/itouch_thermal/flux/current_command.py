"""Which current is asked for: one that brings the plate to its start temperature, or one that follows the plan.

The derivation stands in docs/explanation/thermal-estimator.md, "Following the plan".
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from itouch.plugin.kernels import kernel, linked
from itouch_thermal.display.column import P_DECAY, P_EXCESS, P_MEAN, P_PORT
from itouch_thermal.display.peltier import current_for
from itouch_thermal.flux import observer as at
from itouch_thermal.flux import planner, slew
from itouch_thermal.flux.limits import RATE, RATE_OVER


class FutureCurrent(NamedTuple):
    """What will become of the current that is asked for now.

    It leaves in ``wait`` periods and is held for ``hold`` periods.  ``out`` says what leaves before it: one current
    [A], then another [A], and in how many periods the second takes the place of the first.
    """

    hold: int = 1
    wait: int = 0
    out: tuple[float, float, float] = (0.0, 0.0, 0.0)


#: A current that leaves at once and is held for one period, as without a wire.
AT_ONCE = FutureCurrent()
#: How often the plan's responses are recomputed in a touch [s].
REFRESH = 16e-3
#: The share of the plate's greatest rate that is used: more than `paper` and `hold` may, which see less far ahead.
RATE_USED = 0.98
#: A change of the contact resistance is acted upon as far as it exceeds this many standard deviations, and a standard
#: deviation up to the second number is small enough to act upon any change.
SURE, ENOUGH = 2.0, 0.015
#: Time [s] in which the pump can stop the face at an end of its band, and how far inside that end it does so [K].
STOPPING, SLACK = 0.05, 0.02


@linked
def _coming(line: Any, slot: int, delay: int, out: Any, i: int) -> float:
    """Return the current [A] that will act ``i`` periods from now if no other leaves; ``out`` as in `FutureCurrent`."""
    if i < delay:
        return float(line[(slot + i) % delay])
    return float(out[0] if i - delay < out[2] else out[1])


@linked
def _flowing(line: Any, slots: Any, leaving: Any, flows: float, most: float) -> float:
    """Return the current [A] that flows where the one that is asked for begins to act.

    ``flows`` is the current that flows now, ``most`` [A] by how much it may change in a period; ``leaving`` is a
    `FutureCurrent`.
    """
    delay = int(slots[1])
    for i in range(delay + leaving.wait):
        flows = at.slewed(_coming(line, int(slots[0]), delay, leaving.out, i), flows, most)
    return flows


@linked
def _queue(
    line: Any, slot: int, delay: int, out: Any, size: int, fine: Any, coarse: Any, flows: float, most: float
) -> None:
    """Fill in the currents [A] on their way: the oldest, which make no whole coarse step, singly; then means per step.

    ``flows`` is the current [A] that flows now, ``most`` [A] by how much it may change in a period; 0: by any amount.
    """
    first = fine.shape[0]
    for i in range(first):
        flows = at.slewed(_coming(line, slot, delay, out, i), flows, most)
        fine[i] = flows
    for g in range(coarse.shape[0]):
        total = 0.0
        for i in range(size):
            flows = at.slewed(_coming(line, slot, delay, out, first + g * size + i), flows, most)
            total += flows
        coarse[g] = total / size


@linked
def _limits(band: Any, trace: Any, first: int, allowed: float, out: Any) -> None:
    """Fill the band (2, steps) of the face [K] at the ends of the horizon's steps, by the plate's band and its rate."""
    for i in range(out.shape[1]):
        before = trace[(first + i) % trace.shape[0]]
        out[0, i] = max(band[0], before - allowed)
        out[1, i] = min(band[1], before + allowed)


@linked
def _commanded(current: float, ceiling: float, known: float) -> float:
    """Return a current [A] within the ceiling, or NaN where ``known``, the sum of what it is made of, is not a number.

    Each limit on the way would make an end of its range of that, and the guard, which stops at NaN, would see a current
    like any other.
    """
    return math.nan if known != known else float(min(ceiling, max(-ceiling, current)))


class Arrival(NamedTuple):
    """What will be when the current that is asked for begins to act, as the model says.

    ``flux`` [W/m2] through the contact, temperature [K] of the plate's ``back``, the current [A] that flows ``before``,
    temperature [K] of the plate's ``face``, and the pumped flux [W/m2] that is ``holding`` it.
    """

    flux: float
    back: float
    before: float
    face: float
    holding: float


@linked
def _module(c: Any, theta: Any) -> Any:
    """Return the module's Seebeck coefficient [V/K], conductance [W/K] and resistance [ohm], as estimated."""
    seebeck, legs = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]), c[at.O_CONDUCTANCE] * (1.0 + theta[at.LEGS])
    return seebeck, legs, c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC])


@kernel
def approach_current(basis: Any, own: Any, bounds: Any, leaving: Any, target: float, within: float) -> Any:
    """Return the current [A] that brings the plate to a target, its flux [W/m2], and the error [K] as it acts.

    Parameters
    ----------
    basis, own, bounds
        The column (`observer.Basis`), the law's State (`law.Memory`) and what never changes (`law.Bounds`).
    leaving
        A `FutureCurrent`: what leaves before the current that is asked for.
    target, within
        Temperature of the plate [K], and the time in which an error is to be corrected [s].
    """
    c, tissue, plate = basis.c, basis.tissue, basis.plate
    x, theta, memory, line, slots = own.x, own.theta, own.memory, own.line, own.slots
    limit, ceiling, wait = bounds.flux_limit, bounds.ceiling, leaving.wait
    n, m = tissue.shape[1], plate.shape[1]
    gp = 1.0 / (1.0 + theta[at.PLATE])
    seebeck, legs, ohmic = _module(c, theta)
    delay, before = int(slots[1]), 0.0
    shift, most = planner.later(theta) / c[at.O_PERIOD], c[at.O_SLEW] * c[at.O_PERIOD]
    if shift != 0.0 or most > 0.0:
        before = memory[at.M_BEFORE]
    # If an earlier touch has left the plate warmer or colder under the finger than beside it, this fades by itself.
    mean, excess, soon = c[at.O_REFERENCE], 0.0, delay + wait + within / c[at.O_PERIOD]
    for i in range(m):
        mean += plate[P_MEAN, i] * x[0, n + i]
        if plate[P_EXCESS, i] != 0.0:
            excess += plate[P_EXCESS, i] * x[0, n + i] * plate[P_DECAY, i] ** soon
    back, hot = x[0, n + m + at.X_BACK], memory[at.M_SINK]
    heat = bounds.capacity / gp
    air = c[at.O_AIR] * (c[at.O_AMBIENT] - mean)
    for i in range(delay + wait):
        coming = at.slewed(_coming(line, int(slots[0]), delay, leaving.out, i), before, most)
        current, square = at.shifted(coming, before, shift)
        before = coming
        pump = (seebeck * back * current - 0.5 * square * ohmic - legs * (hot - back)) / c[at.O_AREA]
        change = c[at.O_PERIOD] * (air - pump - theta[at.FLUX]) / heat
        mean += change
    error = mean + excess - target
    braked = slew.braked(heat * error, within, slew.rate(c, theta, before, mean))
    flux = min(limit, max(-limit, braked + air))
    current = current_for(seebeck, ohmic, legs, (flux - theta[at.FLUX]) * c[at.O_AREA], mean, hot)
    current = slew.reached(current, before, most * leaving.hold)
    return _commanded(current, ceiling, error + hot + seebeck + legs + ohmic + theta[at.FLUX]), flux, error


@linked
def _pumped(c: Any, theta: Any, current: float, back: float, hot: float) -> float:
    """Return the flux [W/m2] that is pumped at a current [A], as estimated; ``back`` of plate and ``hot`` sink [K]."""
    seebeck, legs, ohmic = _module(c, theta)
    pumped = seebeck * back * current - 0.5 * current * current * ohmic - legs * (hot - back)
    return float(pumped / c[at.O_AREA] + theta[at.FLUX])


@linked
def _acted_upon(found: float, doubt: float) -> float:
    """Return by how much the contact resistance is taken to differ, of what the estimator has ``found`` (a logarithm).

    ``doubt`` is the variance of what was found: what may be noise is not acted upon, or the plan would follow it.
    """
    noise = SURE * SURE * max(0.0, doubt - ENOUGH * ENOUGH)
    return float(found * max(0.0, 1.0 - noise / max(found * found, 1e-12)))


@linked
def _arrival(fixed: Any, own: Any, bounds: Any, leaving: Any, scale: float, hot: float, spill: float) -> Arrival:
    """Run the column ahead over the currents on their way; return what will be then, and leave it in ``own.work``.

    ``scale`` of the resistance as in `observer.advance`; ``hot`` sink [K]; ``spill`` [W/m2] is what air gives to the
    plate beside the finger.
    """
    c, plate, x, memory, slots = fixed.coarse.c, fixed.coarse.plate, own.x, own.memory, own.slots
    n, m = fixed.coarse.tissue.shape[1], plate.shape[1]
    o, period = n + m, c[at.O_PERIOD]
    above, below, single, queue = own.work[:n], own.work[n:o], own.single, own.queue
    before = memory[at.M_BEFORE] if memory.shape[0] > at.M_BEFORE else 0.0
    most = c[at.O_SLEW] * period
    _queue(own.line, int(slots[0]), int(slots[1]), leaving.out, bounds.size, single, queue, before, most)
    for i in range(n):
        above[i] = x[0, i]
    for i in range(n, o):
        below[i - n] = x[0, i]
    flux, back = planner.arrive(
        fixed.fine, own.theta, hot, scale, single, above, below, x[0, o + at.X_FLUX], x[0, o + at.X_BACK], spill,
        before, period,
    )  # fmt: skip
    if single.shape[0] > 0:
        before = single[-1]
    step = bounds.size * period
    flux, back = planner.arrive(
        fixed.coarse, own.theta, hot, scale, queue, above, below, flux, back, spill, before, step
    )  # fmt: skip
    if queue.shape[0] > 0:
        before = queue[-1]
    if most > 0.0:
        before = _flowing(own.line, slots, leaving, memory[at.M_BEFORE], most)
    # The pumped flux that holds the face's temperature: the contact's, less what spreads into the plate beside it.
    face, holding, gp = c[at.O_REFERENCE], flux + spill, 1.0 / (1.0 + own.theta[at.PLATE])
    for i in range(m):
        face += plate[P_PORT, i] * below[i]
        holding -= bounds.capacity / gp * plate[P_EXCESS, i] * (1.0 - plate[P_DECAY, i]) / step * below[i]
    return Arrival(flux, back, before, face, holding)


@linked
def _slew_limits(fixed: Any, own: Any, bounds: Any, leaving: Any, scale: float, hot: float, start: Arrival) -> Any:
    """Return what the driver's slew rate leaves of the plan, a `planner.Slew`."""
    c, theta, wanted = fixed.coarse.c, own.theta, own.wanted
    rate, gp = slew.rate(c, theta, start.before, start.back), 1.0 / (1.0 + theta[at.PLATE])
    missing = max(abs(wanted[0] - start.flux), abs(wanted[-1] - start.flux)) * planner.resistance(c, theta, scale)
    return planner.Slew(
        _pumped(c, theta, start.before, start.back, hot), 0.5 * leaving.hold * c[at.O_PERIOD] * rate, rate,
        start.holding,
        slew.way(bounds.capacity / gp * missing, planner.HORIZON, rate),
    )  # fmt: skip


@linked
def _held_in_band(flux: float, start: Arrival, heat: float, lowest: float, highest: float) -> float:
    """Return a flux [W/m2], limited near an end of the face's band to what stops the face there.

    ``heat`` of the plate [J/m2K]; ``lowest`` and ``highest`` face [K].
    """
    flux = min(flux, start.holding + heat * (start.face - lowest - SLACK) / STOPPING)
    return max(flux, start.holding - heat * (highest - SLACK - start.face) / STOPPING)


@kernel
def plan_current(fixed: Any, own: Any, bounds: Any, leaving: Any, scale: float, doubt: float, every: int) -> Any:
    """Improve the plan, and return the current [A] that follows it, and the pumped flux [W/m2] that it is for.

    Parameters
    ----------
    fixed, own, bounds
        What never changes (`law.Fixed`, `law.Bounds`), and the law's State (`law.Memory`), which is written.
    leaving
        A `FutureCurrent`: what leaves before the current that is asked for.
    scale, doubt
        Contact resistance as in `observer.advance`, and the variance of the logarithm of what it is found to be.
    every
        Every how many periods this is called.
    """
    c, theta, memory = fixed.coarse.c, own.theta, own.memory
    n, m = fixed.coarse.tissue.shape[1], fixed.coarse.plate.shape[1]
    o, period = n + m, c[at.O_PERIOD]
    above, below, rest, last = own.work[:n], own.work[n:o], own.work[o:], own.knots
    found, step = theta[at.RESISTANCE], bounds.size * period
    theta[at.RESISTANCE] = _acted_upon(found, doubt)
    ticks, hot = memory[at.M_TICKS], memory[at.M_SINK]
    if ticks % max(1.0, round(REFRESH / period)) < every:
        planner.respond(fixed.coarse, theta, scale, fixed.hats, above, below, own.response, step)
    memory[at.M_TICKS] = ticks + every
    spill = (1.0 - c[at.O_COVER]) * c[at.O_AIR] * (c[at.O_AMBIENT] - own.x[0, o + at.X_FACE])
    start = _arrival(fixed, own, bounds, leaving, scale, hot, spill)
    first = int(memory[at.M_AGE] / bounds.size) + own.single.shape[0] // bounds.size + own.queue.shape[0] + 1
    _limits(fixed.band, own.trace, first, RATE * RATE_OVER * RATE_USED, own.span)
    planned = planner.Planned(own.wanted, own.span, own.response, fixed.hats, last, rest)
    planner.plan(
        fixed.coarse, theta, scale, planned, above, below, start.flux, bounds.flux_limit,
        (ticks + own.slots[1] + leaving.wait) * period, step, spill,
        _slew_limits(fixed, own, bounds, leaving, scale, hot, start),
    )  # fmt: skip
    # A current that is held for long gives the plan's mean over that time.
    flux = last[0] + 0.5 * min(1.0, leaving.hold * period / planner.KNOTS[1]) * (last[1] - last[0])
    gp = 1.0 / (1.0 + theta[at.PLATE])
    flux = _held_in_band(flux, start, bounds.capacity / gp, own.span[0, 0], own.span[1, 0])
    theta[at.RESISTANCE] = found
    seebeck, legs, ohmic = _module(c, theta)
    current = current_for(seebeck, ohmic, legs, (flux - theta[at.FLUX]) * c[at.O_AREA], start.back, hot)
    current = slew.reached(current, start.before, c[at.O_SLEW] * period * leaving.hold)
    known = start.face + start.back + hot + seebeck + legs + ohmic + theta[at.FLUX] + found
    return _commanded(current, bounds.ceiling, known), flux
