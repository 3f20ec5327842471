"""Compiled steps of the live solver on arrays that the caller owns.

A side's model is one flat read-only array (`pack`), its state another (`STATE_TAIL` numbers after the mode
coordinates); any number of states may share a model.  The steps are

* `contact_step`: finger and object touch through a resistance that is linear over the step;
* `air_step`: a side by itself under its film.

The first step of a touch, and every one of the first few at an unchanged resistance, is exact for the model:
the transform of the flux is known in closed form and is inverted on a contour.  The others use collocation.
A phase counter in the state tells a new touch from a continued one, so no other memory is needed.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit

from itouch_thermal.solver import collocation
from itouch_thermal.solver.contour import WEIGHTS, Z
from itouch_thermal.solver.lanes import dot, padded
from itouch_thermal.solver.layers import FINGER_FILM, ROOM, Film, Side
from itouch_thermal.solver.modes import Modes, side_modes
from itouch_thermal.solver.stack import Array
from itouch_thermal.solver.steady import initial_profile, resting_profile

#: Numbers behind the coordinates of a state: phase, last resistance, heat taken in through the contact [J/m2].
STATE_TAIL = 3
#: At an unchanged resistance this many steps after an onset are exact; later ones collocate.
EXACT_STEPS = 8

_STAGES = collocation.STAGES
_NODES = len(Z)
_HEAD = 16
_SCRATCH = 128

# Where the head of a packed model keeps its numbers.
_COUNT, _PERIOD, _REST, _FILM, _AMBIENT, _STATIC = range(6)

_Z_REAL, _Z_IMAG = np.ascontiguousarray(Z.real), np.ascontiguousarray(Z.imag)
_W_REAL, _W_IMAG = np.ascontiguousarray(WEIGHTS.real), np.ascontiguousarray(WEIGHTS.imag)
_POINTS = collocation.points()
_HEAT = collocation.quadrature()


def pack(modes: Modes, period: float, *, rest: float, film: Film | None) -> Array:
    """Return the flat model of a side for steps of ``period`` [s].

    Parameters
    ----------
    modes
        Of the side.
    rest
        Contact temperature [K] of the field from which the modes count.
    film
        Air on the bare surface, None for none.
    """
    count = len(modes.rates)
    size = padded(count)
    rates, port = modes.rates, modes.contact
    points = Z[:, None] / period
    kernel = port / (points + rates)
    gain = collocation.response(rates * period) * period
    head = np.zeros(_HEAD)
    head[: _STATIC + 1] = (
        size,
        period,
        rest,
        film.coefficient if film else 0.0,
        film.ambient if film else 0.0,
        port @ (port / np.maximum(rates, 1e-300)),
    )
    rows = np.concatenate(
        (
            np.stack((np.exp(-rates * period), port, modes.unit_rise)),
            collocation.memory(rates * period) * port,
            gain[-1] * port,
            kernel.real,
            kernel.imag,
        )
    )
    rows = np.pad(rows, ((0, 0), (0, size - count)))
    impedance = kernel @ port
    model = np.concatenate((head, rows.ravel(), (gain @ port**2).ravel(), impedance.real, impedance.imag))
    model.setflags(write=False)
    return model


def film_of(side: Side, *, finger: bool) -> Film | None:
    """Return the air on a bare surface: as given, as before the touch, else the default of a finger or none."""
    if side.air is not None:
        return side.air
    start = side.initial
    if start.coefficient is not None and start.ambient is not None:
        return Film(coefficient=start.coefficient, ambient=start.ambient)
    return Film(coefficient=FINGER_FILM, ambient=ROOM) if finger else None


@lru_cache(maxsize=256)
def side_model(side: Side, period: float, *, finger: bool) -> Array:
    """Return the packed model of a side; cached by content."""
    return pack(side_modes(side, period), period, rest=resting_profile(side).surface, film=film_of(side, finger=finger))


def state_size(model: Array) -> int:
    """Return how many numbers the state of a model has."""
    return int(model[_COUNT]) + STATE_TAIL


def initial_state(side: Side, period: float, *, finger: bool) -> Array:
    """Return the state of a side before any touch, shape (state_size,)."""
    modes, model = side_modes(side, period), side_model(side, period, finger=finger)
    state = np.zeros(state_size(model))
    start, rest = initial_profile(side), resting_profile(side)
    if side.initial.kind == "steady":
        state[: len(modes.rates)] = modes.unit_rise * (start.surface - rest.surface)
    else:
        deviation = start.temperature(modes.depths) - rest.temperature(modes.depths)
        state[: len(modes.rates)] = modes.project(deviation)
    return state


@njit(cache=True, error_model="numpy")
def surface_temperature(model: Array, state: Array) -> float:
    """Return the contact temperature [K] of a side."""
    n = int(model[_COUNT])
    return float(model[_REST] + dot(model, _HEAD + n, state, 0, n))


@njit(cache=True, error_model="numpy")
def shift_surface(model: Array, state: Array, change: float) -> None:
    """Add the stationary field that belongs to a change [K] of the contact temperature."""
    n = int(model[_COUNT])
    for i in range(n):
        state[i] += change * model[_HEAD + 2 * n + i]


@njit(cache=True, error_model="numpy")
def contact_step(finger: Array, finger_state: Array, body: Array, body_state: Array, resistance: float) -> float:
    """Advance finger and object by one step in contact; return the flux at its end [W/m2].

    Parameters
    ----------
    finger, body
        Packed models of both sides, for the same period.
    finger_state, body_state
        Their states, changed in place.
    resistance
        Contact resistance at the end of the step [K m2/W], finite, at least 0; linear since the last step, and
        constant over the first step of a touch.
    """
    return advance_contact(finger, finger_state, body, body_state, resistance, np.empty(_SCRATCH))


@njit(cache=True, error_model="numpy")
def air_step(model: Array, state: Array) -> None:
    """Advance a side by one step under its film, or insulated if it has none."""
    advance_air(model, state, np.empty(_SCRATCH))


@njit(cache=True, error_model="numpy")
def advance_contact(
    finger: Array, finger_state: Array, body: Array, body_state: Array, resistance: float, work: Any
) -> float:
    """Do `contact_step` with the caller's scratch of `_SCRATCH` numbers."""
    f, b = int(finger[_COUNT]), int(body[_COUNT])
    fresh = finger_state[f] <= 0.0 or body_state[b] <= 0.0
    before = finger_state[f + 1]
    if fresh:
        finger_state[f] = body_state[b] = 0.0
    if fresh or (resistance == before and finger_state[f] < EXACT_STEPS):
        flux = _contour_contact(finger, finger_state, body, body_state, resistance, work)
    else:
        flux = _collocate_contact(finger, finger_state, body, body_state, before, resistance, work)
    finger_state[f] += 1.0
    body_state[b] += 1.0
    finger_state[f + 1] = body_state[b + 1] = resistance
    return flux


@njit(cache=True, error_model="numpy")
def advance_air(model: Array, state: Array, work: Any) -> None:
    """Do `air_step` with the caller's scratch of `_SCRATCH` numbers."""
    n = int(model[_COUNT])
    if state[n] > 0.0:
        state[n] = 0.0
    if model[_FILM] == 0.0:
        for i in range(n):
            state[i] *= model[_HEAD + i]
    elif -state[n] < EXACT_STEPS:
        _contour_air(model, state, work)
    else:
        _collocate_air(model, state, work)
    state[n] -= 1.0


@njit(cache=True, error_model="numpy")
def _open(model: Array, state: Array, work: Any) -> None:
    """Put the transform of the contact temperature without flux into work[0:NODES], [NODES:2 NODES] (re, im)."""
    n = int(model[_COUNT])
    first = _HEAD + (3 + 2 * _STAGES) * n
    for k in range(2 * _NODES):
        work[k] = dot(model, first + k * n, state, 0, n)
    for k in range(_NODES):
        scale = model[_REST] * model[_PERIOD] / (_Z_REAL[k] ** 2 + _Z_IMAG[k] ** 2)
        work[k] += scale * _Z_REAL[k]
        work[_NODES + k] -= scale * _Z_IMAG[k]


@njit(cache=True, error_model="numpy")
def _absorb(model: Array, state: Array, work: Any, first: int, sign: float) -> float:
    """Take in the flux whose transform stands at work[first:] (re, im); return the heat it brought [J/m2]."""
    n = int(model[_COUNT])
    rows = _HEAD + (3 + 2 * _STAGES) * n
    scale = sign / model[_PERIOD]
    heat = 0.0
    for i in range(n):
        state[i] *= model[_HEAD + i]
    for k in range(_NODES):
        re, im = work[first + k], work[first + _NODES + k]
        p = (_W_REAL[k] * re - _W_IMAG[k] * im) * scale
        q = (_W_REAL[k] * im + _W_IMAG[k] * re) * scale
        one, two = rows + k * n, rows + (_NODES + k) * n
        for i in range(n):
            state[i] += p * model[one + i] - q * model[two + i]
        size = _Z_REAL[k] ** 2 + _Z_IMAG[k] ** 2
        heat += (p * _Z_REAL[k] + q * _Z_IMAG[k]) * model[_PERIOD] / size
    return float(heat)


@njit(cache=True, error_model="numpy")
def _contour_contact(
    finger: Array, finger_state: Array, body: Array, body_state: Array, resistance: float, work: Any
) -> float:
    f, b = int(finger[_COUNT]), int(body[_COUNT])
    zf = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * f + _STAGES * _STAGES
    zb = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * b + _STAGES * _STAGES
    _open(finger, finger_state, work)
    other = work[2 * _NODES :]
    _open(body, body_state, other)
    flux = 0.0
    for k in range(_NODES):
        re, im = work[k] - other[k], work[_NODES + k] - other[_NODES + k]
        zr = finger[zf + k] + body[zb + k] + resistance
        zi = finger[zf + _NODES + k] + body[zb + _NODES + k]
        size = zr * zr + zi * zi
        work[k], work[_NODES + k] = (re * zr + im * zi) / size, (im * zr - re * zi) / size
        flux += _W_REAL[k] * work[k] - _W_IMAG[k] * work[_NODES + k]
    finger_state[f + 2] += _absorb(finger, finger_state, work, 0, -1.0)
    body_state[b + 2] += _absorb(body, body_state, work, 0, 1.0)
    return float(flux / finger[_PERIOD])


@njit(cache=True, error_model="numpy")
def _contour_air(model: Array, state: Array, work: Any) -> None:
    n = int(model[_COUNT])
    impedance = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * n + _STAGES * _STAGES
    _open(model, state, work)
    for k in range(_NODES):
        scale = model[_AMBIENT] * model[_PERIOD] / (_Z_REAL[k] ** 2 + _Z_IMAG[k] ** 2)
        re, im = scale * _Z_REAL[k] - work[k], -scale * _Z_IMAG[k] - work[_NODES + k]
        zr, zi = model[impedance + k] + 1.0 / model[_FILM], model[impedance + _NODES + k]
        size = zr * zr + zi * zi
        work[k], work[_NODES + k] = (re * zr + im * zi) / size, (im * zr - re * zi) / size
    _absorb(model, state, work, 0, 1.0)


@njit(cache=True, error_model="numpy")
def _collocate_contact(
    finger: Array, finger_state: Array, body: Array, body_state: Array, before: float, after: float, work: Any
) -> float:
    f, b = int(finger[_COUNT]), int(body[_COUNT])
    wf = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * f
    wb = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * b
    for a in range(_STAGES):
        work[a] = finger[_REST] + dot(finger, _HEAD + (3 + a) * f, finger_state, 0, f)
        work[a] -= body[_REST] + dot(body, _HEAD + (3 + a) * b, body_state, 0, b)
    for a in range(_STAGES * _STAGES):
        work[_STAGES + a] = finger[wf + a] + body[wb + a]
    for a in range(_STAGES):
        work[_STAGES + a * (_STAGES + 1)] += before + (after - before) * _POINTS[a]
    _solve(work)
    heat = _drive(finger, finger_state, work, -1.0)
    finger_state[f + 2] += heat
    body_state[b + 2] -= heat
    _drive(body, body_state, work, 1.0)
    return float(work[_STAGES - 1])


@njit(cache=True, error_model="numpy")
def _collocate_air(model: Array, state: Array, work: Any) -> None:
    n = int(model[_COUNT])
    w = _HEAD + (3 + 2 * _STAGES + 2 * _NODES) * n
    for a in range(_STAGES):
        work[a] = model[_AMBIENT] - model[_REST] - dot(model, _HEAD + (3 + a) * n, state, 0, n)
    for a in range(_STAGES * _STAGES):
        work[_STAGES + a] = model[w + a]
    for a in range(_STAGES):
        work[_STAGES + a * (_STAGES + 1)] += 1.0 / model[_FILM]
    _solve(work)
    _drive(model, state, work, 1.0)


@njit(cache=True, error_model="numpy")
def _solve(work: Any) -> None:
    """Solve the stage equations in place: work[0:STAGES] becomes the flux at the stages."""
    m = _STAGES
    for k in range(m):
        pivot = 1.0 / work[m + k * m + k]
        for i in range(k + 1, m):
            factor = work[m + i * m + k] * pivot
            for j in range(k + 1, m):
                work[m + i * m + j] -= factor * work[m + k * m + j]
            work[i] -= factor * work[k]
    for k in range(m - 1, -1, -1):
        for j in range(k + 1, m):
            work[k] -= work[m + k * m + j] * work[j]
        work[k] /= work[m + k * m + k]


@njit(cache=True, error_model="numpy")
def _drive(model: Array, state: Array, work: Any, sign: float) -> float:
    """Decay a state and add the flux at the stages; return the heat it brought [J/m2]."""
    n = int(model[_COUNT])
    g = _HEAD + (3 + _STAGES) * n
    heat = 0.0
    for a in range(_STAGES):
        heat += _HEAT[a] * work[a]
    a0, a1, a2 = sign * work[0], sign * work[1], sign * work[2]
    a3, a4, a5 = sign * work[3], sign * work[4], sign * work[5]
    for i in range(n):
        early = (model[g + i] * a0 + model[g + n + i] * a1) + model[g + 2 * n + i] * a2
        late = (model[g + 3 * n + i] * a3 + model[g + 4 * n + i] * a4) + model[g + 5 * n + i] * a5
        state[i] = model[_HEAD + i] * state[i] + (early + late)
    return float(sign * heat * model[_PERIOD])
