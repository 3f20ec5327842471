"""The predictive part of the `model` controller: which flux to pump so that the finger's will be the desired one.

The estimated column is run ahead under the currents that are still on their way, and on from there.  What it would
do by itself and what each of a few hat functions of the pumped flux would add are compared with the desired flux of
the time to come; least squares gives the plan, of which the first value is sent.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

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
)
from itouch_thermal.flux import observer as at

#: Steps of the horizon after the delay, and knots of the plan in steps.
AHEAD, HATS = 24, 4
#: Before this [s] the flux counts less: no pump reaches the finger so soon.
EARLY = 0.1


@njit(cache=True, error_model="numpy")
def _hat(index: int, place: float) -> float:
    """Return the value of a hat function at a place in steps; knots at 0, 4, 11 and 24."""
    left = (0.0, 0.0, 4.0, 11.0)
    mid = (0.0, 4.0, 11.0, 24.0)
    right = (4.0, 11.0, 24.0, 25.0)
    if place <= mid[index]:
        return 1.0 if index == 0 else max(0.0, (place - left[index]) / (mid[index] - left[index]))
    return max(0.0, (right[index] - place) / (right[index] - mid[index]))


@njit(cache=True, error_model="numpy")
def _weight(age: float) -> float:
    """Return how much the flux counts at a time [s] after the begin: at first the stored heat alone acts."""
    return 1.0 if age >= EARLY else (age / EARLY) ** 4


@njit(cache=True, error_model="numpy")
def ahead(
    c: Any, tissue: Any, plate: Any, above: Any, below: Any, flux: float, pump: float, contact: float, gf: float,
    gp: float, tissue_self: float, plate_self: float, rest: float,
) -> float:  # fmt: skip
    """Advance a column without derivatives by one coarse step under a pumped flux; return the contact flux."""
    n, m = above.shape[0], below.shape[0]
    cover = c[at.O_COVER]
    s = rest
    for i in range(n):
        above[i] = tissue[F_DECAY, i] * above[i] - gf * tissue[F_BEGIN, i] * flux
        s += tissue[F_PORT, i] * above[i]
    for i in range(m):
        below[i] = plate[P_DECAY, i] * below[i] + gp * (cover * plate[P_BEGIN, i] * flux - plate[P_PUMP, i] * pump)
        s -= plate[P_PORT, i] * below[i]
    late = s / (contact + gf * tissue_self + gp * cover * plate_self)
    for i in range(n):
        above[i] -= gf * tissue[F_END, i] * late
    for i in range(m):
        below[i] += gp * cover * plate[P_END, i] * late
    return float(late)


@njit(cache=True, error_model="numpy")
def respond(c: Any, tissue: Any, plate: Any, theta: Any, scale: float, above: Any, below: Any, response: Any) -> None:
    """Fill ``response`` (HATS, AHEAD): the contact flux that each hat of the pumped flux would add."""
    contact = c[at.O_CONTACT] * math.exp(theta[at.RESISTANCE]) * (1.0 + (scale - 1.0) * math.exp(theta[at.PRESS]))
    gp, gf = 1.0 / (1.0 + theta[at.PLATE]), 1.0 / (1.0 + theta[at.TISSUE])
    tissue_self, plate_self = selves(tissue, plate)
    for hat in range(HATS):
        above[:] = 0.0
        below[:] = 0.0
        flux = 0.0
        for i in range(AHEAD):
            flux = ahead(
                c, tissue, plate, above, below, flux, _hat(hat, i + 0.5), contact, gf, gp, tissue_self, plate_self, 0.0
            )
            response[hat, i] = flux


@njit(cache=True, error_model="numpy")
def selves(tissue: Any, plate: Any) -> Any:
    """Return what each surface gains over a step from the end value of the flux."""
    tissue_self = plate_self = 0.0
    for i in range(tissue.shape[1]):
        tissue_self += tissue[F_PORT, i] * tissue[F_END, i]
    for i in range(plate.shape[1]):
        plate_self += plate[P_PORT, i] * plate[P_END, i]
    return tissue_self, plate_self


@njit(cache=True, error_model="numpy")
def plan(
    c: Any, tissue: Any, plate: Any, x: Any, theta: Any, memory: Any, scale: float, queue: Any, wanted: Any,
    response: Any, last: Any, above: Any, below: Any, work: Any, smooth: float, limit: float,
    age: float, step_time: float,
) -> Any:  # fmt: skip
    """Return the flux to pump [W/m2], and the back temperature [K] that the plate will have then.

    Parameters
    ----------
    queue
        Mean currents [A] of the coarse steps that are on their way, shape (d,).
    wanted
        Desired flux at the ends of the horizon's steps, shape (AHEAD,).
    last
        The plan's knots of the last time, shape (HATS,); changed.
    """
    n, m = tissue.shape[1], plate.shape[1]
    o = n + m
    contact = c[at.O_CONTACT] * math.exp(theta[at.RESISTANCE]) * (1.0 + (scale - 1.0) * math.exp(theta[at.PRESS]))
    gp, gf = 1.0 / (1.0 + theta[at.PLATE]), 1.0 / (1.0 + theta[at.TISSUE])
    seebeck, legs = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]), c[at.O_CONDUCTANCE] * (1.0 + theta[at.LEGS])
    ohmic = c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC])
    tissue_self, plate_self = selves(tissue, plate)
    for i in range(n):
        above[i] = x[0, i]
    for i in range(m):
        below[i] = x[0, n + i]
    flux, back, hot = x[0, o + at.X_FLUX], x[0, o + at.X_BACK], memory[at.M_SINK]
    rest = c[at.O_REST] - c[at.O_REFERENCE]
    for step in range(queue.shape[0]):
        current = queue[step]
        pump = (seebeck * back * current - 0.5 * current * current * ohmic - legs * (hot - back)) / c[at.O_AREA]
        pump += theta[at.FLUX]
        flux = ahead(c, tissue, plate, above, below, flux, pump, contact, gf, gp, tissue_self, plate_self, rest)
        back = c[at.O_REFERENCE]
        for i in range(m):
            back += plate[P_BACK, i] * below[i]
    # Errors that the last plan would leave; then the best change of it.
    for i in range(AHEAD):
        pump = 0.0
        for hat in range(HATS):
            pump += last[hat] * _hat(hat, i + 0.5)
        flux = ahead(c, tissue, plate, above, below, flux, pump, contact, gf, gp, tissue_self, plate_self, rest)
        work[HATS * HATS + HATS + i] = wanted[i] - flux
    for a in range(HATS):
        total = 0.0
        for i in range(AHEAD):
            total += response[a, i] * work[HATS * HATS + HATS + i] * _weight(age + (i + 1) * step_time)
        work[HATS * HATS + a] = total
        for b in range(HATS):
            total = 0.0
            for i in range(AHEAD):
                total += response[a, i] * response[b, i] * _weight(age + (i + 1) * step_time)
            work[a * HATS + b] = total
        work[a * HATS + a] += smooth
    _solve(work)
    for a in range(HATS):
        last[a] = min(limit, max(-limit, last[a] + work[HATS * HATS + a]))
    return last[0], back


@njit(cache=True, error_model="numpy")
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
