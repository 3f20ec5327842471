"""The predictive part of the `model` controller: which flux to pump so that the finger's will be the desired one.

The estimated column is run ahead under the currents that are still on their way, and from there under the last plan,
a sum of a few hat functions of the pumped flux.  The contact flux of this run is compared with the desired flux of the
time to come; from the response to each hat, least squares gives the best change of the plan.  The plan's first value is
sent.

What it is made of are kernels by themselves: linked into the command alone, the plan's loops run a tenth slower.

In every function ``basis`` is an `observer.Basis`, whose fields are ``c``, ``tissue`` and ``plate``; ``theta`` is a
field of a `law.Memory`; ``above`` (n,) and ``below`` (m,) are the modes [K] of tissue and plate, which are run ahead.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.kernels import kernel, linked
from itouch_thermal.display.column import (
    F_BEGIN,
    F_DECAY,
    F_END,
    F_PORT,
    P_BACK,
    P_BEGIN,
    P_DECAY,
    P_END,
    P_PORT,
    P_PUMP,
    P_SPILL,
)
from itouch_thermal.flux import observer as at

#: Length of the plan, which begins after the delay, and the times of its knots [s].
HORIZON, KNOTS = 0.12, (0.0, 0.02, 0.055, 0.12)
HATS = len(KNOTS)
#: Least number of steps of the horizon.
FEWEST = 6
#: Before this time of a touch [s] the flux counts less: no pump acts on the finger so soon.
EARLY = 0.1
#: Added to the squared response of the flux to a change of the plan: a change with less effect is not worth its noise.
SMOOTH = 1e-5


class Joint(NamedTuple):
    """How finger and plate meet: contact resistance, gains of tissue and plate, response of each surface, and rest.

    ``contact``, ``tissue_self`` and ``plate_self`` in [K m2/W], see `selves`; ``rest`` [K] is by how much the skin at
    rest is warmer than the temperature from which the plate's modes are counted.
    """

    contact: float
    tissue_gain: float
    plate_gain: float
    tissue_self: float
    plate_self: float
    rest: float


class Slew(NamedTuple):
    """What the driver's slew rate leaves of a plan: what it begins with, how fast it changes, and how far it goes.

    ``flux`` [W/m2] is pumped where the plan begins, ``first`` [W/m2] by how much its first knot may differ from that,
    and ``rate`` [W/m2 per second] how fast the pumped flux may change; 0: at any rate.  ``rest`` [W/m2] holds the
    plate's face where it is, and no knot is to differ from that by more than ``way`` [W/m2].
    """

    flux: float
    first: float
    rate: float
    rest: float
    way: float


class Planned(NamedTuple):
    """What the plan is made of.

    Desired flux [W/m2] at the ends of the horizon's steps, shape (steps,), and the temperatures [K] that the plate's
    face must not pass then, shape (2, steps); response of the contact flux to each knot [1], and the knots' hat
    functions [1], both (HATS, steps); the knots of the last plan [W/m2], shape (HATS,), which change; and scratch
    space.
    """

    wanted: Any
    span: Any
    response: Any
    hats: Any
    knots: Any
    work: Any


def shapes(step: float) -> NDArray[np.float64]:
    """Return the plan's hat functions over the horizon's steps of ``step`` seconds, shape (HATS, steps)."""
    count = max(FEWEST, round(HORIZON / step))
    places = np.array(KNOTS) * max(1.0, count * step / HORIZON)
    middles = (np.arange(count) + 0.5) * step
    found = np.stack([np.interp(middles, places, unit) for unit in np.eye(HATS)])
    found.setflags(write=False)
    return found


@linked
def _weight(age: float) -> float:
    """Return the weight of the flux at a time [s] after the start of the touch: at first only the stored heat acts."""
    return 1.0 if age >= EARLY else (age / EARLY) ** 4


@kernel
def ahead(
    tissue: Any, plate: Any, above: Any, below: Any, flux: float, pump: float, spill: float, joint: Joint
) -> float:  # fmt: skip
    """Advance a column without derivatives by one coarse step under pump and air; return the contact flux."""
    n, m = above.shape[0], below.shape[0]
    gf, gp, s = joint.tissue_gain, joint.plate_gain, joint.rest
    for i in range(n):
        above[i] = tissue[F_DECAY, i] * above[i] - gf * tissue[F_BEGIN, i] * flux
        s += tissue[F_PORT, i] * above[i]
    for i in range(m):
        below[i] = plate[P_DECAY, i] * below[i] + gp * (
            plate[P_BEGIN, i] * flux + plate[P_SPILL, i] * spill - plate[P_PUMP, i] * pump
        )
        s -= plate[P_PORT, i] * below[i]
    late = s / (joint.contact + gf * joint.tissue_self + gp * joint.plate_self)
    for i in range(n):
        above[i] -= gf * tissue[F_END, i] * late
    for i in range(m):
        below[i] += gp * plate[P_END, i] * late
    return float(late)


@kernel
def resistance(c: Any, theta: Any, scale: float) -> float:
    """Return the estimated contact resistance [K m2/W]; ``scale`` as in `observer.advance`."""
    pressing = scale - 1.0 if scale < 1.0 else (scale - 1.0) * math.exp(theta[at.PRESS])
    return float(c[at.O_CONTACT] * math.exp(theta[at.RESISTANCE]) * (1.0 + pressing))


@kernel
def later(theta: Any) -> float:
    """Return by how much later [s] a command acts than the data sheets say, as estimated."""
    return float(theta[at.DELAY]) if theta.shape[0] > at.DELAY else 0.0


@linked
def respond(
    basis: Any, theta: Any, scale: float, hats: Any, above: Any, below: Any, response: Any, step_time: float
) -> None:
    """Fill ``response`` (HATS, steps): the contact flux that each hat of the pumped flux would add [1].

    ``hats`` (HATS, steps): the hat functions [1]; ``scale`` as in `observer.advance`; ``step_time``: of the plan [s].
    """
    tissue, plate, joint = basis.tissue, basis.plate, joined(basis, theta, scale, 0.0)
    shift = later(theta) / step_time
    for hat in range(HATS):
        above[:] = 0.0
        below[:] = 0.0
        flux = before = 0.0
        for i in range(hats.shape[1]):
            pump = hats[hat, i] - shift * (hats[hat, i] - before)
            before = hats[hat, i]
            flux = ahead(tissue, plate, above, below, flux, pump, 0.0, joint)
            response[hat, i] = flux


@kernel
def selves(tissue: Any, plate: Any) -> Any:
    """Return by how much the flux at the end of a step changes the temperature of each surface [K m2/W]."""
    tissue_self = plate_self = 0.0
    for i in range(tissue.shape[1]):
        tissue_self += tissue[F_PORT, i] * tissue[F_END, i]
    for i in range(plate.shape[1]):
        plate_self += plate[P_PORT, i] * plate[P_END, i]
    return tissue_self, plate_self


@kernel
def joined(basis: Any, theta: Any, scale: float, rest: float) -> Joint:
    """Return how finger and plate meet by the estimated parameters; ``scale`` as in `observer.advance`, rest [K]."""
    contact = resistance(basis.c, theta, scale)
    gp, gf = 1.0 / (1.0 + theta[at.PLATE]), 1.0 / (1.0 + theta[at.TISSUE])
    tissue_self, plate_self = selves(basis.tissue, basis.plate)
    return Joint(contact, gf, gp, tissue_self, plate_self, rest)


@kernel
def arrive(
    basis: Any, theta: Any, hot: float, scale: float, currents: Any, above: Any, below: Any, flux: float, back: float,
    spill: float, before: float, step_time: float,
) -> Any:  # fmt: skip
    """Run the column ahead over ``currents`` (steps,) [A] on their way; return contact flux and plate's back.

    These are in [W/m2] and [K]; ``spill`` is what air gives to the plate beside the finger [W/m2 of the plate],
    ``before`` the current [A] before the first one.
    """
    c, tissue, plate = basis.c, basis.tissue, basis.plate
    joint = joined(basis, theta, scale, c[at.O_REST] - c[at.O_REFERENCE])
    seebeck, legs = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]), c[at.O_CONDUCTANCE] * (1.0 + theta[at.LEGS])
    ohmic = c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC])
    shift = later(theta) / step_time
    for step in range(currents.shape[0]):
        current, square = at.shifted(currents[step], before, shift)
        before = currents[step]
        pump = (seebeck * back * current - 0.5 * square * ohmic - legs * (hot - back)) / c[at.O_AREA]
        pump += theta[at.FLUX]
        flux = ahead(tissue, plate, above, below, flux, pump, spill, joint)
        back = c[at.O_REFERENCE]
        for i in range(plate.shape[1]):
            back += plate[P_BACK, i] * below[i]
    return flux, back


@kernel
def plan(
    basis: Any, theta: Any, scale: float, planned: Planned, above: Any, below: Any, flux: float, limit: float,
    age: float, step_time: float, spill: float, slew: Slew,
) -> None:  # fmt: skip
    """Improve the plan's knots of the pumped flux [W/m2].

    Parameters
    ----------
    basis, theta, scale
        The column of the coarse steps, its parameters, and the resistance as in `observer.advance`.
    planned
        What the plan is made of; its knots are changed.
    above, below, flux
        The column and its contact flux where the plan begins; the column is run on.
    limit
        Greatest flux that may be pumped [W/m2].
    age, step_time
        Time of the touch at which the plan begins, and length of its steps [s].
    spill
        What air gives to the plate beside the finger [W/m2 of the plate].
    slew
        The flux that is pumped where the plan begins [W/m2], how fast it may change, and how far it may go.
    """
    c, tissue, plate = basis.c, basis.tissue, basis.plate
    wanted, band, response, hats = planned.wanted, planned.span, planned.response, planned.hats
    last, work = planned.knots, planned.work
    joint, before = joined(basis, theta, scale, c[at.O_REST] - c[at.O_REFERENCE]), slew.flux
    steps, v, shift = wanted.shape[0], HATS * HATS, later(theta) / step_time
    for a in range(v + HATS):
        work[a] = 0.0
    # Errors that the last plan would leave; then the best change of it.
    for i in range(steps):
        pump = 0.0
        for hat in range(HATS):
            pump += last[hat] * hats[hat, i]
        acting, before = pump - shift * (pump - before), pump
        flux = ahead(tissue, plate, above, below, flux, acting, spill, joint)
        skin = c[at.O_REST]
        for k in range(tissue.shape[1]):
            skin += tissue[F_PORT, k] * above[k]
        # With the face at an end of its band the contact can draw no more.
        aim = min((skin - band[0, i]) / joint.contact, max((skin - band[1, i]) / joint.contact, wanted[i]))
        weight = _weight(age + (i + 1) * step_time)
        for a in range(HATS):
            weighed = weight * response[a, i]
            work[v + a] += weighed * (aim - flux)
            for b in range(a + 1):
                work[a * HATS + b] += weighed * response[b, i]
    for a in range(HATS):
        work[a * HATS + a] += SMOOTH
        for b in range(a):
            work[b * HATS + a] = work[a * HATS + b]
    if slew.rate > 0.0:
        _solve_slewing(work, last, limit, slew)
        return
    _solve(work)
    for a in range(HATS):
        last[a] = min(limit, max(-limit, last[a] + work[v + a]))


@kernel
def _solve(work: Any) -> None:
    """Solve the normal equations in place."""
    v = HATS * HATS
    for k in range(HATS):
        for i in range(k + 1, HATS):
            factor = work[i * HATS + k] / work[k * HATS + k]
            for j in range(k, HATS):
                work[i * HATS + j] -= factor * work[k * HATS + j]
            work[v + i] -= factor * work[v + k]
    for k in range(HATS - 1, -1, -1):
        for j in range(k + 1, HATS):
            work[v + k] -= work[k * HATS + j] * work[v + j]
        work[v + k] /= work[k * HATS + k]


@kernel
def _solve_slewing(work: Any, last: Any, limit: float, slew: Slew) -> None:
    """Solve the normal equations in place for a driver whose slew rate is limited, and change the knots ``last``.

    The unknowns are eliminated from the last one on, so that the first comes out first.  It is limited to what the
    driver reaches, the others are the best given that, and so on: a plan of what could flow.  A plan that is cut only
    when it is sent asks for ever more while the current is on its way, and swings between the ends of the slew.
    """
    v = HATS * HATS
    for k in range(HATS - 1, 0, -1):
        for i in range(k):
            factor = work[i * HATS + k] / work[k * HATS + k]
            for j in range(k):
                work[i * HATS + j] -= factor * work[k * HATS + j]
            work[v + i] -= factor * work[v + k]
    centre, room = slew.flux, slew.first
    for a in range(HATS):
        for j in range(a):
            work[v + a] -= work[a * HATS + j] * work[v + j]
        if a > 0:
            centre, room = last[a - 1], slew.rate * (KNOTS[a] - KNOTS[a - 1])
        found = min(slew.rest + slew.way, max(slew.rest - slew.way, last[a] + work[v + a] / work[a * HATS + a]))
        found = min(centre + room, max(centre - room, found))
        found = min(limit, max(-limit, found))
        work[v + a] = found - last[a]
        last[a] = found
