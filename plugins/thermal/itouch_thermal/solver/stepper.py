"""The live stepper of one contact: any history of resistances, one flux a step.

While the resistance changes, a step is that of `live` on the pair of sides.  After `SETTLED` steps at one value the
state is carried over into the modes of the closed loop at that value, in which a step is one product a mode, and
back when the value changes.  The rule looks only at the state, so that cutting a history into calls changes no bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from itouch_thermal.solver import live
from itouch_thermal.solver.closed import ClosedLoop, close_loop
from itouch_thermal.solver.lanes import dot
from itouch_thermal.solver.layers import Contact
from itouch_thermal.solver.packing import HEAT, PHASE, RESISTANCE, SIZE, TAIL, pair_of
from itouch_thermal.solver.stack import Array

#: Steps at one resistance after which the closed loop takes over.
SETTLED = 6

#: Behind the pair in the state: steps at this resistance, whether the loop is closed, steps and heat since.
_RUN, _CLOSED, _COUNT, _BASE = range(4)
_MEMORY = 8

_KEPT_LOOPS = 16


class Stepper:
    """Steps a contact through time.

    Parameters
    ----------
    contact
        The two sides; its own resistance is not used.
    period
        Step [s], 1 us to 1 s.

    Raises
    ------
    ValueError
        If the period is out of range.
    """

    def __init__(self, contact: Contact, period: float) -> None:
        if not 1e-6 <= period <= 1.0:
            raise ValueError(f"period = {period!r} is out of range: 1e-06 to 1 s")
        self.contact = contact
        self.period = period
        self._finger = live.side_model(contact.finger, period, finger=True)
        self._object = live.side_model(contact.object, period, finger=False)
        self._pair = pair_of(contact.finger, contact.object, period)
        self._split = live.state_size(self._finger)
        self._size = len(self._pair.rates)
        self._loops: dict[float, ClosedLoop] = {}
        self._state = np.zeros(2 * self._size + _MEMORY)
        self._state[: self._split] = live.initial_state(contact.finger, period, finger=True)
        self._state[self._split : self._size] = live.initial_state(contact.object, period, finger=False)

    @property
    def state(self) -> Array:
        """Everything that changes, flat and writable; assign to it, or into it, to restore."""
        return self._state

    @state.setter
    def state(self, value: ArrayLike) -> None:
        given = np.asarray(value, dtype=np.float64)
        if given.shape != self._state.shape:
            raise ValueError(f"state: shape {given.shape} given, {self._state.shape} needed")
        self._state[:] = given

    def step(self, resistance: float) -> float:
        """Advance one step; return the contact flux at its end [W/m2].

        Parameters
        ----------
        resistance
            Contact resistance at the end of the step [K m2/W]; infinite for a step apart.

        Raises
        ------
        ValueError
            If the resistance is negative or not a number.
        """
        return float(self.advance(resistance, 1)[0])

    def advance(self, resistances: ArrayLike, steps: int | None = None) -> Array:
        """Advance many steps; return the contact flux at the end of each [W/m2], shape (steps,).

        Parameters
        ----------
        resistances
            One value a step, or one value for all ``steps`` [K m2/W]; infinite for steps apart.
        steps
            How many, for one value.

        Raises
        ------
        ValueError
            If a resistance is negative or not a number, or the count is missing or does not fit.
        """
        given = history(resistances, steps)
        flux = np.empty(len(given))
        done = 0
        while done < len(given):
            loop = self._loop(float(self._state[int(self._finger[TAIL]) + RESISTANCE]))
            done = _advance(
                self._pair.model,
                self._finger,
                self._object,
                self._state,
                given,
                flux,
                done,
                loop.decay,
                loop.gain,
                loop.vectors,
                loop.rest,
                loop.flux,
                loop.heat,
            )
            if done < len(given):
                self._enter(float(given[done]))
        return flux

    def _loop(self, resistance: float) -> ClosedLoop:
        """Return the closed loop in use, or an empty one."""
        if self._state[self._size + _CLOSED] == 0.0:
            return _OPEN
        if resistance not in self._loops:
            if len(self._loops) >= _KEPT_LOOPS:
                del self._loops[next(iter(self._loops))]
            pair = self._pair
            self._loops[resistance] = close_loop(pair.rates, pair.port, pair.level, resistance, self.period)
        return self._loops[resistance]

    def _enter(self, resistance: float) -> None:
        """Carry the state over into the modes of the closed loop."""
        size, state = self._size, self._state
        state[size + _CLOSED] = 1.0
        loop = self._loop(resistance)
        _enter(state, loop.vectors, loop.rest, size)
        state[size + _COUNT] = 0.0
        modes = state[size + _MEMORY : size + _MEMORY + len(loop.heat)]
        state[size + _BASE] = state[self._split + int(self._object[TAIL]) + HEAT] + loop.heat @ modes

    def _sides(self) -> Array:
        """Return the state of the pair as it is now, shape (size,)."""
        state = self._state.copy()
        if state[self._size + _CLOSED]:
            loop = self._loop(float(state[int(self._finger[TAIL]) + RESISTANCE]))
            tails = (int(self._finger[TAIL]), self._split + int(self._object[TAIL]))
            _leave(state, loop.vectors, loop.rest, loop.flux, loop.heat, self._size, *tails, self.period)
        return state[: self._size]

    @property
    def skin_temperature(self) -> float:
        """Temperature of the finger's contact face [K]."""
        return float(live.surface_temperature(self._finger, self._sides()[: self._split]))

    @property
    def object_temperature(self) -> float:
        """Temperature of the object's contact face [K]."""
        return float(live.surface_temperature(self._object, self._sides()[self._split :]))

    @property
    def heat(self) -> float:
        """Heat that the finger has given through the contact so far [J/m2]."""
        return float(self._sides()[self._split + int(self._object[TAIL]) + HEAT])


def history(resistances: ArrayLike, steps: int | None) -> Array:
    """Return one resistance a step [K m2/W], shape (steps,).

    Raises
    ------
    ValueError
        If one is negative or not a number, or the count is missing or does not fit.
    """
    given = np.array(resistances, dtype=np.float64)
    if given.ndim == 0:
        if steps is None or steps < 0:
            raise ValueError(f"steps = {steps!r}: one resistance needs a number of steps, 0 or more")
        given = np.full(steps, float(given))
    elif given.ndim != 1 or steps not in (None, len(given)):
        raise ValueError(f"resistances: shape {given.shape} does not fit {steps} steps")
    if not np.all(given >= 0.0):
        raise ValueError("resistances: each must be 0 or more, infinite for a step apart")
    return given


_OPEN = ClosedLoop(np.zeros(8), np.zeros(8), np.zeros(8), np.zeros((8, 8)), np.zeros(8), 0.0)


@njit(cache=True, error_model="numpy")
def _enter(state: Array, vectors: Array, rest: Array, size: int) -> None:
    for k in range(len(vectors)):
        total = 0.0
        for i in range(size):
            # Unknown to the modes are the tails of both sides, where the vectors are zero.
            total += vectors[k, i] * (state[i] - rest[i])
        state[size + _MEMORY + k] = total


@njit(cache=True, error_model="numpy")
def _leave(
    state: Array, vectors: Array, rest: Array, flux: float, heat: Array, size: int, f: int, b: int, period: float
) -> None:
    """Put the coordinates of the pair, phases and heat in order again."""
    count = state[size + _COUNT]
    tails = np.empty(6)
    for n in range(3):
        tails[n], tails[3 + n] = state[f + n], state[b + n]
    total = state[size + _BASE] + flux * count * period
    for i in range(size):
        state[i] = rest[i]
    for k in range(len(vectors)):
        amplitude = state[size + _MEMORY + k]
        total -= heat[k] * amplitude
        for i in range(size):
            state[i] += amplitude * vectors[k, i]
    for n in range(3):
        state[f + n], state[b + n] = tails[n], tails[3 + n]
    state[f + PHASE] += count
    state[b + PHASE] += count
    state[f + HEAT] += state[b + HEAT] - total
    state[b + HEAT] = total
    state[size + _CLOSED] = 0.0
    state[size + _RUN] = 0.0


@njit(cache=True, error_model="numpy")
def _advance(
    pair: Array,
    finger: Array,
    body: Array,
    state: Array,
    resistances: Array,
    flux: Array,
    first: int,
    decay: Array,
    gain: Array,
    vectors: Array,
    rest: Array,
    steady: float,
    heat_of: Array,
) -> int:
    """Step until the end, or until the loop must be closed; return how far it came."""
    work = np.empty(live.SCRATCH)
    split, size = int(finger[SIZE]), int(pair[SIZE])
    f, b = int(finger[TAIL]), split + int(body[TAIL])
    finger_state, body_state = state[:split], state[split:size]
    modes = state[size + _MEMORY : size + _MEMORY + len(decay)]
    step = first
    while step < len(resistances):
        resistance, before = resistances[step], state[f + RESISTANCE]
        if state[size + _CLOSED] > 0.0:
            start = step
            while step < len(resistances) and resistances[step] == before:
                for k in range(len(modes)):
                    modes[k] = (modes[k] * decay[k] + live.TINY) - live.TINY
                flux[step] = steady + dot(gain, 0, modes, 0, len(modes))
                step += 1
            state[size + _COUNT] += step - start
            if step < len(resistances):
                _leave(state, vectors, rest, steady, heat_of, size, f, b, pair[1])
            continue
        if resistance == np.inf:
            live.advance_air(finger, finger_state, work)
            live.advance_air(body, body_state, work)
            flux[step] = state[size + _RUN] = 0.0
            step += 1
            continue
        fresh = state[f + PHASE] <= 0.0 or state[b + PHASE] <= 0.0
        same = resistance == before and not fresh
        if same and state[size + _RUN] >= SETTLED:
            return step
        if fresh:
            state[f + PHASE] = state[b + PHASE] = 0.0
        if fresh or (same and state[f + PHASE] < live.EXACT_STEPS):
            flux[step], heat = live.contour(pair, state, resistance, work)
        else:
            flux[step], heat = live.collocate(pair, state, before, resistance, work)
        state[size + _RUN] = state[size + _RUN] + 1.0 if same else 1.0
        state[f + PHASE] += 1.0
        state[b + PHASE] += 1.0
        state[f + RESISTANCE] = state[b + RESISTANCE] = resistance
        state[f + HEAT] -= heat
        state[b + HEAT] += heat
        step += 1
    return step
