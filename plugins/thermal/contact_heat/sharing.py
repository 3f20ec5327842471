"""A compiled step of a finger that touches two objects at once, each with a share of its contact disc.

The finger has one skin temperature, and each object draws from it through a resistance of its own, as two resistors in
parallel do; the finger loses the mean of both fluxes, weighted by the shares.  Stepping it on either object alone and
taking the mean of the states is not the same: within each step the skin would follow one object, and be torn back to
the mean at the end, so that the flux would depend on the length of the step.

Steps are those of `live`: exact if an exchange begins or nothing changes, else by collocation, with resistances and
shares linear over the step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from contact_heat.collocation import points, quadrature
from contact_heat.dot_product import dot, scratch
from contact_heat.hosting import kernel
from contact_heat.live import absorb, drive, flux_of, open_port
from contact_heat.packing import HEAD, HEAT, MEMORY, NODES, PERIOD, PHASE, REST, ROWS, SIZE, STAGES, TAIL, TAIL_LENGTH
from contact_heat.stack import Array

_POINTS = points()
_HEAT = quadrature()
_SQUARE, _WORK = STAGES * STAGES, 6 * NODES
#: Unknowns of a step: the flux into either object at each stage.
_BOTH = 2 * STAGES


def air_beside(ambient: float, period: float) -> tuple[Array, Array]:
    """Return model and state of air in the place of an object: it stays at ``ambient`` [K], whatever it is given.

    ``period`` [s] is that of the other models.  The resistance of the film between skin and air is passed to
    `shared_step`, as that to an object is.
    """
    model, state = np.zeros(HEAD + _SQUARE + 2 * NODES), np.zeros(TAIL_LENGTH)
    model[PERIOD], model[REST] = period, ambient
    state[PHASE] = 1.0
    return model, state


@kernel
def shared_step(
    finger: Array, finger_state: Array, first: Array, first_state: Array, second: Array, second_state: Array,
    parts: Any, before: Any, after: Any,
) -> float:  # fmt: skip
    """Advance a finger and the two objects that it touches by one step; return the flux out of it at its end [W/m2].

    Parameters
    ----------
    finger, first, second
        Packed models, (n,), laid out as in `packing`, for the same period.
    finger_state, first_state, second_state
        Their states, changed in place.
    parts
        The second object's share of the contact disc [1] at the start and at the end of the step, shape (2,).
    before, after
        Resistances [K m2/W] to the first and to the second object, shape (2,), at the start and at the end.
    """
    work = scratch(_WORK)
    f, a, b = int(finger[TAIL]), int(first[TAIL]), int(second[TAIL])
    begins = finger_state[f] <= 0.0 or first_state[a] <= 0.0 or second_state[b] <= 0.0
    if begins or (parts[0] == parts[1] and before[0] == after[0] and before[1] == after[1]):
        _transform(finger, finger_state, first, first_state, second, second_state, parts[1], after, work)
        part, period = parts[1], finger[PERIOD]
        one, two = work[2 * NODES :], work[4 * NODES :]
        for k in range(2 * NODES):
            work[k] = (1.0 - part) * one[k] + part * two[k]
        flux, heat = flux_of(work, period)
        _, first_heat = flux_of(one, period)
        _, second_heat = flux_of(two, period)
        absorb(finger, finger_state, work, -1.0)
        absorb(first, first_state, one, 1.0)
        absorb(second, second_state, two, 1.0)
    else:
        found = _stages(finger, finger_state, first, first_state, second, second_state, parts, before, after)
        one, two = found[:STAGES], found[STAGES:]
        heat = first_heat = second_heat = 0.0
        for k in range(STAGES):
            part = parts[0] + (parts[1] - parts[0]) * _POINTS[k]
            work[k] = (1.0 - part) * one[k] + part * two[k]
            heat += _HEAT[k] * work[k] * finger[PERIOD]
            first_heat += _HEAT[k] * one[k] * finger[PERIOD]
            second_heat += _HEAT[k] * two[k] * finger[PERIOD]
        flux = work[STAGES - 1]
        drive(finger, finger_state, work, -1.0)
        drive(first, first_state, one, 1.0)
        drive(second, second_state, two, 1.0)
    # The next step may be on one object alone, which changes what the finger meets at once: an exact step can do that.
    finger_state[f + PHASE] = first_state[a + PHASE] = second_state[b + PHASE] = 1.0
    finger_state[f + HEAT] -= heat
    first_state[a + HEAT] += first_heat
    second_state[b + HEAT] += second_heat
    return float(flux)


@kernel
def _transform(
    finger: Array, finger_state: Array, first: Array, first_state: Array, second: Array, second_state: Array,
    part: float, resistance: Any, work: Any,
) -> None:  # fmt: skip
    """Put the transforms of the fluxes into both objects into work[2 NODES:] and work[4 NODES:], each (re, im).

    Models and states are those of `shared_step`; ``resistance`` [K m2/W] has shape (2,), ``work`` (6 NODES,).
    """
    zf, za, zb = _impedance(finger), _impedance(first), _impedance(second)
    one, two = work[2 * NODES :], work[4 * NODES :]
    open_port(finger, finger_state, work)
    open_port(first, first_state, one)
    open_port(second, second_state, two)
    for k in range(NODES):
        skin = complex(finger[zf + k], finger[zf + NODES + k])
        own = complex(first[za + k] + resistance[0], first[za + NODES + k])
        beside = complex(second[zb + k] + resistance[1], second[zb + NODES + k])
        left = complex(work[k] - one[k], work[NODES + k] - one[NODES + k])
        right = complex(work[k] - two[k], work[NODES + k] - two[NODES + k])
        below = own * beside + skin * ((1.0 - part) * beside + part * own)
        scale = below.conjugate() * (1.0 / (below.real * below.real + below.imag * below.imag))
        apart = skin * (left - right)
        into = (left * beside + part * apart) * scale
        one[k], one[NODES + k] = into.real, into.imag
        into = (right * own - (1.0 - part) * apart) * scale
        two[k], two[NODES + k] = into.real, into.imag


@kernel
def _impedance(model: Array) -> int:
    """Return where the impedance at the nodes begins in a model (n,), laid out as in `packing` [1]."""
    return HEAD + ROWS * int(model[SIZE]) + _SQUARE


@kernel
def _stages(
    finger: Array, finger_state: Array, first: Array, first_state: Array, second: Array, second_state: Array,
    parts: Any, before: Any, after: Any,
) -> Array:  # fmt: skip
    """Return the fluxes [W/m2] into the first and into the second object at the stages, (2 STAGES,).

    The arguments are those of `shared_step`.
    """
    n, m, o = int(finger[SIZE]), int(first[SIZE]), int(second[SIZE])
    square = _impedance(finger) - _SQUARE
    own, beside = _impedance(first) - _SQUARE, _impedance(second) - _SQUARE
    matrix, found = np.zeros((_BOTH, _BOTH)), np.empty(_BOTH)
    for i in range(STAGES):
        skin = finger[REST] + dot(finger, HEAD + (MEMORY + i) * n, finger_state, 0, n)
        found[i] = skin - first[REST] - dot(first, HEAD + (MEMORY + i) * m, first_state, 0, m)
        found[STAGES + i] = skin - second[REST] - dot(second, HEAD + (MEMORY + i) * o, second_state, 0, o)
        for j in range(STAGES):
            part = parts[0] + (parts[1] - parts[0]) * _POINTS[j]
            answer = finger[square + i * STAGES + j]
            matrix[i, j] = (1.0 - part) * answer + first[own + i * STAGES + j]
            matrix[i, STAGES + j] = part * answer
            matrix[STAGES + i, j] = (1.0 - part) * answer
            matrix[STAGES + i, STAGES + j] = part * answer + second[beside + i * STAGES + j]
        matrix[i, i] += before[0] + (after[0] - before[0]) * _POINTS[i]
        matrix[STAGES + i, STAGES + i] += before[1] + (after[1] - before[1]) * _POINTS[i]
    for k in range(_BOTH):
        for i in range(k + 1, _BOTH):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, _BOTH):
                matrix[i, j] -= factor * matrix[k, j]
            found[i] -= factor * found[k]
    for k in range(_BOTH - 1, -1, -1):
        for j in range(k + 1, _BOTH):
            found[k] -= matrix[k, j] * found[j]
        found[k] /= matrix[k, k]
    return found
