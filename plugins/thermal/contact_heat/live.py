"""Compiled steps of the live solver on arrays that the caller owns; `packing` describes their layout.

* `contact_step`: finger and object touch through a resistance that is linear over the step;
* `air_step`: a side by itself under its film;
* `surface_temperature`, `shift_surface`: read the contact face's temperature, add a stationary field.

The first step of a touch, and each of the first few at an unchanged resistance, is exact for the model: the transform
of the flux is known in closed form and is inverted on a contour.  All other steps use collocation.  A phase counter in
the state tells a new touch from a continued one, so no other memory is needed.

In every function ``work`` (SCRATCH,) is scratch memory of the caller: the unit of its entries changes from use to use.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from contact_heat import collocation
from contact_heat.contour import WEIGHTS, Z
from contact_heat.dot_product import dot, scratch
from contact_heat.hosting import kernel
from contact_heat.packing import (
    AMBIENT,
    DECAY,
    DRIVE,
    FILM,
    HEAD,
    HEAT,
    KERNEL,
    MEMORY,
    NODES,
    PERIOD,
    PHASE,
    PORT,
    RESISTANCE,
    REST,
    RISE,
    ROWS,
    SIZE,
    STAGES,
    TAIL,
    initial_state,
    side_model,
    state_size,
)
from contact_heat.stack import Array

__all__ = [
    "EXACT_STEPS",
    "SCRATCH",
    "TINY",
    "air_step",
    "contact_step",
    "initial_state",
    "shift_surface",
    "side_model",
    "state_size",
    "surface_temperature",
]

#: Number of steps after an onset that are exact at an unchanged resistance; later ones use collocation.
EXACT_STEPS = 8
#: Adding and subtracting this turns a fading value into zero before it becomes subnormal, which would be slow.
TINY = 1e-200
#: Size of the scratch array that a step needs.
SCRATCH = 128

_Z_REAL, _Z_IMAG = np.ascontiguousarray(Z.real), np.ascontiguousarray(Z.imag)
_Z_SIZE = _Z_REAL**2 + _Z_IMAG**2
_W_REAL, _W_IMAG = np.ascontiguousarray(WEIGHTS.real), np.ascontiguousarray(WEIGHTS.imag)
_POINTS = collocation.points()
_HEAT = collocation.quadrature()
_SQUARE = STAGES * STAGES


@kernel
def surface_temperature(model: Array, state: Array) -> float:
    """Return the contact temperature [K] of a side.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; see there for units.
    """
    n = int(model[SIZE])
    return float(model[REST] + dot(model, HEAD + PORT * n, state, 0, n))


@kernel
def shift_surface(model: Array, state: Array, change: float) -> None:
    """Add the stationary field for a change [K] of the contact temperature.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the state is changed in place.
    """
    n = int(model[SIZE])
    for i in range(n):
        state[i] += change * model[HEAD + RISE * n + i]


@kernel
def contact_step(finger: Array, finger_state: Array, body: Array, body_state: Array, resistance: float) -> float:
    """Advance finger and object by one step in contact; return the flux at its end [W/m2].

    Parameters
    ----------
    finger, body
        Packed models of both sides, (n,), laid out as in `packing`, for the same period.
    finger_state, body_state
        Their states, changed in place.
    resistance
        Contact resistance at the end of the step [K m2/W], finite, at least 0; linear since the last step, and
        constant over the first step of a touch.
    """
    work = scratch(SCRATCH)
    f, b = int(finger[TAIL]), int(body[TAIL])
    fresh = finger_state[f] <= 0.0 or body_state[b] <= 0.0
    before = finger_state[f + RESISTANCE]
    if fresh:
        finger_state[f] = body_state[b] = 0.0
    if fresh or (resistance == before and finger_state[f] < EXACT_STEPS):
        flux, heat = _contour_contact(finger, finger_state, body, body_state, resistance, work)
    else:
        flux, heat = _collocate_contact(finger, finger_state, body, body_state, before, resistance, work)
    finger_state[f + PHASE] += 1.0
    body_state[b + PHASE] += 1.0
    finger_state[f + RESISTANCE] = body_state[b + RESISTANCE] = resistance
    finger_state[f + HEAT] -= heat
    body_state[b + HEAT] += heat
    return flux


@kernel
def air_step(model: Array, state: Array) -> None:
    """Advance a side by one step under its film, or insulated if it has none.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the state is changed in place.  The model holds
    the film [W/m2K] and the ambient temperature [K].
    """
    advance_air(model, state, scratch(SCRATCH))


@kernel
def advance_air(model: Array, state: Array, work: Any) -> None:
    """Do `air_step` with the caller's scratch memory.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the state is changed in place.  The model holds
    the film [W/m2K] and the ambient temperature [K].
    """
    tail = int(model[TAIL])
    if state[tail] > 0.0:
        state[tail] = 0.0
    if model[FILM] == 0.0:
        for i in range(int(model[SIZE])):
            state[i] = (state[i] * model[HEAD + DECAY + i] + TINY) - TINY
    elif -state[tail] < EXACT_STEPS:
        contour(model, state, 1.0 / model[FILM], work)
    else:
        collocate(model, state, 1.0 / model[FILM], 1.0 / model[FILM], work)
    state[tail] -= 1.0


@kernel
def contour(model: Array, state: Array, resistance: float, work: Any) -> tuple[float, float]:
    """Step one model exactly, its port joined to the ambient by a resistance; return inward flux and heat.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; ``resistance`` [K m2/W], flux [W/m2] and heat
    [J/m2].
    """
    n = int(model[SIZE])
    z = HEAD + ROWS * n + _SQUARE
    open_port(model, state, work)
    for k in range(NODES):
        scale = model[AMBIENT] * model[PERIOD] / _Z_SIZE[k]
        re, im = scale * _Z_REAL[k] - work[k], -scale * _Z_IMAG[k] - work[NODES + k]
        _divide(re, im, model[z + k] + resistance, model[z + NODES + k], work, k)
    absorb(model, state, work, 1.0)
    return flux_of(work, model[PERIOD])


@kernel
def collocate(model: Array, state: Array, before: float, after: float, work: Any) -> tuple[float, float]:
    """Step one model with its port joined to the ambient; the resistance changes linearly from before to after.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; resistances [K m2/W], flux [W/m2] and heat
    [J/m2].
    """
    n = int(model[SIZE])
    square = model[HEAD + ROWS * n : HEAD + ROWS * n + _SQUARE]
    level = model[AMBIENT] - model[REST]
    for a in range(STAGES):
        work[a] = level - dot(model, HEAD + (MEMORY + a) * n, state, 0, n)
    for a in range(_SQUARE):
        work[STAGES + a] = square[a]
    heat = _solve(before, after, work) * model[PERIOD]
    drive(model, state, work, 1.0)
    return work[STAGES - 1], heat


@njit(error_model="numpy", inline="always")
def _contour_contact(
    finger: Array, finger_state: Array, body: Array, body_state: Array, resistance: float, work: Any
) -> tuple[float, float]:
    f, b = int(finger[SIZE]), int(body[SIZE])
    zf, zb = HEAD + ROWS * f + _SQUARE, HEAD + ROWS * b + _SQUARE
    other = work[2 * NODES :]
    open_port(finger, finger_state, work)
    open_port(body, body_state, other)
    for k in range(NODES):
        re, im = work[k] - other[k], work[NODES + k] - other[NODES + k]
        real, imag = finger[zf + k] + body[zb + k] + resistance, finger[zf + NODES + k] + body[zb + NODES + k]
        _divide(re, im, real, imag, work, k)
    absorb(finger, finger_state, work, -1.0)
    absorb(body, body_state, work, 1.0)
    return flux_of(work, finger[PERIOD])


@njit(error_model="numpy", inline="always")
def _collocate_contact(
    finger: Array, finger_state: Array, body: Array, body_state: Array, before: float, after: float, work: Any
) -> tuple[float, float]:
    f, b = int(finger[SIZE]), int(body[SIZE])
    one = finger[HEAD + ROWS * f : HEAD + ROWS * f + _SQUARE]
    two = body[HEAD + ROWS * b : HEAD + ROWS * b + _SQUARE]
    for a in range(STAGES):
        work[a] = finger[REST] + dot(finger, HEAD + (MEMORY + a) * f, finger_state, 0, f)
        work[a] -= body[REST] + dot(body, HEAD + (MEMORY + a) * b, body_state, 0, b)
    for a in range(_SQUARE):
        work[STAGES + a] = one[a] + two[a]
    heat = _solve(before, after, work) * finger[PERIOD]
    drive(finger, finger_state, work, -1.0)
    drive(body, body_state, work, 1.0)
    return work[STAGES - 1], heat


@kernel
def open_port(model: Array, state: Array, work: Any) -> None:
    """Put the transform of the contact temperature at zero flux into work[0:NODES], [NODES:2 NODES] (re, im).

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the transform is in [K s].
    """
    n = int(model[SIZE])
    for k in range(2 * NODES):
        work[k] = dot(model, HEAD + (KERNEL + k) * n, state, 0, n)
    for k in range(NODES):
        scale = model[REST] * model[PERIOD] / _Z_SIZE[k]
        work[k] += scale * _Z_REAL[k]
        work[NODES + k] -= scale * _Z_IMAG[k]


@njit(error_model="numpy", inline="always")
def _divide(re: float, im: float, real: float, imag: float, work: Any, k: int) -> None:
    size = 1.0 / (real * real + imag * imag)
    work[k], work[NODES + k] = (re * real + im * imag) * size, (im * real - re * imag) * size


@kernel
def flux_of(work: Any, period: float) -> tuple[float, float]:
    """Return the flux at the end of a step [W/m2] and its integral [J/m2] from its transform in work [J/m2]."""
    flux = heat = 0.0
    for k in range(NODES):
        re = _W_REAL[k] * work[k] - _W_IMAG[k] * work[NODES + k]
        im = _W_REAL[k] * work[NODES + k] + _W_IMAG[k] * work[k]
        flux += re
        heat += (re * _Z_REAL[k] + im * _Z_IMAG[k]) / _Z_SIZE[k]
    return flux / period, heat


@kernel
def absorb(model: Array, state: Array, work: Any, sign: float) -> None:
    """Decay a state and add the flux whose transform is in work, with a sign: -1 if it leaves the side.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the state is changed in place.  ``work`` holds
    the transform of the flux [J/m2] at the nodes, (2 NODES,), as `flux_of` takes it.
    """
    n = int(model[SIZE])
    for i in range(n):
        state[i] *= model[HEAD + DECAY + i]
    for k in range(NODES):
        scale = sign / model[PERIOD]
        p = (_W_REAL[k] * work[k] - _W_IMAG[k] * work[NODES + k]) * scale
        q = (_W_REAL[k] * work[NODES + k] + _W_IMAG[k] * work[k]) * scale
        one = model[HEAD + (KERNEL + k) * n : HEAD + (KERNEL + k + 1) * n]
        two = model[HEAD + (KERNEL + NODES + k) * n : HEAD + (KERNEL + NODES + k + 1) * n]
        for i in range(len(one)):
            state[i] += p * one[i] - q * two[i]


@njit(error_model="numpy", inline="always")
def _solve(before: float, after: float, work: Any) -> float:
    """Solve the stage equations in place: work[0:STAGES] becomes the flux; return its integral over a unit step."""
    m = STAGES
    for k in range(m):
        work[m + k * (m + 1)] += before + (after - before) * _POINTS[k]
    for k in range(m):
        work[m + k * m + k] = 1.0 / work[m + k * m + k]
        for i in range(k + 1, m):
            factor = work[m + i * m + k] * work[m + k * m + k]
            for j in range(k + 1, m):
                work[m + i * m + j] -= factor * work[m + k * m + j]
            work[i] -= factor * work[k]
    heat = 0.0
    for k in range(m - 1, -1, -1):
        for j in range(k + 1, m):
            work[k] -= work[m + k * m + j] * work[j]
        work[k] *= work[m + k * m + k]
        heat += _HEAT[k] * work[k]
    return heat


@njit(error_model="numpy", inline="always")
def drive(model: Array, state: Array, work: Any, sign: float) -> None:
    """Decay a state and add the flux at the stages, with a sign: -1 if it leaves the side.

    ``model`` (n,) and ``state`` (size,) are laid out as in `packing`; the state is changed in place.  ``work`` holds
    the flux [W/m2] at the stages, (STAGES,).
    """
    n = int(model[SIZE])
    a0, a1, a2 = sign * work[0], sign * work[1], sign * work[2]
    a3, a4, a5 = sign * work[3], sign * work[4], sign * work[5]
    g = HEAD + DRIVE * n
    for i in range(n):
        early = (model[g + i] * a0 + model[g + n + i] * a1) + model[g + 2 * n + i] * a2
        late = (model[g + 3 * n + i] * a3 + model[g + 4 * n + i] * a4) + model[g + 5 * n + i] * a5
        state[i] = model[HEAD + DECAY + i] * state[i] + (early + late)
