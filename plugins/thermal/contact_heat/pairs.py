"""Compiled steps of finger and object in contact through any history of resistances, in closed or open loop.

The state of a pair is that of the finger, then that of the object, then `MEMORY` numbers, then the amplitudes of the
closed loop's modes while it is closed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from contact_heat import live
from contact_heat.dot_product import dot
from contact_heat.hosting import kernel
from contact_heat.packing import HEAT, PERIOD, PHASE, RESISTANCE, SIZE, TAIL
from contact_heat.stack import Array

#: Number of steps at one resistance after which the closed loop takes over.
SETTLED = 6

#: Indices after the pair in the state: steps at this resistance, whether the loop is closed, steps and heat since then.
RUN, CLOSED, COUNT, BASE = range(4)
MEMORY = 8


class Loop(NamedTuple):
    """A `ClosedLoop`, as the compiled steps take it: ``flux`` [W/m2] is the steady one."""

    decay: Array
    gain: Array
    vectors: Array
    rest: Array
    flux: float
    heat: Array


@kernel
def enter_loop(state: Array, vectors: Array, rest: Array, size: int) -> None:
    """Write the amplitudes of the closed loop's modes after the pair in the state.

    ``state`` (size + MEMORY + modes,); ``vectors`` (modes, size) and ``rest`` (size,) of `ClosedLoop`; coordinates
    as in `packing`.
    """
    for k in range(len(vectors)):
        total = 0.0
        for i in range(size):
            # The modes do not include the tails of both sides, where the vectors are zero.
            total += vectors[k, i] * (state[i] - rest[i])
        state[size + MEMORY + k] = total


@kernel
def leave_loop(
    state: Array, vectors: Array, rest: Array, flux: float, heat: Array, size: int, f: int, b: int, period: float
) -> None:
    """Restore the coordinates of the pair, the phases and the heat from the closed loop.

    ``state`` (size + MEMORY + modes,); ``vectors`` (modes, size), ``rest`` (size,), ``flux`` [W/m2] and ``heat``
    (modes,) [J/m2] of `ClosedLoop`; ``f`` and ``b`` are the indices of the tails of finger and object; ``period`` [s].
    """
    count = state[size + COUNT]
    tails = np.empty(6)
    for n in range(3):
        tails[n], tails[3 + n] = state[f + n], state[b + n]
    total = state[size + BASE] + flux * count * period
    for i in range(size):
        state[i] = rest[i]
    for k in range(len(vectors)):
        amplitude = state[size + MEMORY + k]
        total -= heat[k] * amplitude
        for i in range(size):
            state[i] += amplitude * vectors[k, i]
    for n in range(3):
        state[f + n], state[b + n] = tails[n], tails[3 + n]
    state[f + PHASE] += count
    state[b + PHASE] += count
    state[f + HEAT] += state[b + HEAT] - total
    state[b + HEAT] = total
    state[size + CLOSED] = 0.0
    state[size + RUN] = 0.0


@kernel
def advance_pair(
    pair: Array,
    finger: Array,
    body: Array,
    state: Array,
    resistances: Array,
    flux: Array,
    first: int,
    loop: Loop,
) -> int:
    """Step to the end, or until the loop must be closed; return the number of steps done.

    ``pair``, ``finger`` and ``body`` are models (n,), ``state`` is (size + MEMORY + modes,); ``resistances``
    (steps,) [K m2/W] and ``flux`` (steps,) [W/m2], written from step ``first`` on.
    """
    decay, gain = loop.decay, loop.gain
    work = np.empty(live.SCRATCH)
    split, size = int(finger[SIZE]), int(pair[SIZE])
    f, b = int(finger[TAIL]), split + int(body[TAIL])
    finger_state, body_state = state[:split], state[split:size]
    modes = state[size + MEMORY : size + MEMORY + len(decay)]
    step = first
    while step < len(resistances):
        resistance, before = resistances[step], state[f + RESISTANCE]
        if state[size + CLOSED] > 0.0:
            start = step
            while step < len(resistances) and resistances[step] == before:
                for k in range(len(modes)):
                    modes[k] = (modes[k] * decay[k] + live.TINY) - live.TINY
                flux[step] = loop.flux + dot(gain, 0, modes, 0, len(modes))
                step += 1
            state[size + COUNT] += step - start
            if step < len(resistances):
                leave_loop(state, loop.vectors, loop.rest, loop.flux, loop.heat, size, f, b, pair[PERIOD])
            continue
        if resistance == np.inf:
            live.advance_air(finger, finger_state, work)
            live.advance_air(body, body_state, work)
            flux[step] = state[size + RUN] = 0.0
            step += 1
            continue
        fresh = state[f + PHASE] <= 0.0 or state[b + PHASE] <= 0.0
        same = resistance == before and not fresh
        if same and state[size + RUN] >= SETTLED:
            return step
        if fresh:
            state[f + PHASE] = state[b + PHASE] = 0.0
        if fresh or (same and state[f + PHASE] < live.EXACT_STEPS):
            flux[step], heat = live.contour(pair, state, resistance, work)
        else:
            flux[step], heat = live.collocate(pair, state, before, resistance, work)
        state[size + RUN] = state[size + RUN] + 1.0 if same else 1.0
        state[f + PHASE] += 1.0
        state[b + PHASE] += 1.0
        state[f + RESISTANCE] = state[b + RESISTANCE] = resistance
        state[f + HEAT] -= heat
        state[b + HEAT] += heat
        step += 1
    return step
