"""The live stepper of one contact: any history of resistances in, one flux per step out.

While the resistance changes, a step is that of `live` on the pair of sides.  After `pairs.SETTLED` steps at one value
the state is converted to the modes of the closed loop at that value, where a step is one product per mode, and back
when the value changes.  The rule depends only on the state, so that dividing a history into calls changes no bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from contact_heat import live
from contact_heat.blas import one_thread
from contact_heat.closed_loop import ClosedLoop, close_loop
from contact_heat.contact import Contact
from contact_heat.layers import Side, SideName
from contact_heat.modes import Modes, side_modes
from contact_heat.packing import HEAT, PHASE, RESISTANCE, TAIL, pair_of
from contact_heat.pairs import BASE, CLOSED, COUNT, MEMORY, Loop, advance_pair, enter_loop, leave_loop
from contact_heat.stack import Array, stack_of
from contact_heat.steady import initial_profile

_KEPT_LOOPS = 16


class Stepper:
    """Steps a contact through time.

    Parameters
    ----------
    contact
        The two sides; its own resistance is ignored.
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
        self._tail = int(self._finger[TAIL])
        self._one, self._flux = np.empty(1), np.empty(1)
        self._loops: dict[float, ClosedLoop] = {}
        self._state = np.zeros(2 * self._size + MEMORY)
        self._state[: self._split] = live.initial_state(contact.finger, period, finger=True)
        self._state[self._split : self._size] = live.initial_state(contact.object, period, finger=False)

    @property
    def state(self) -> Array:
        """The whole State, flat and writable; assign to it, or to its elements, to restore."""
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
            Contact resistance at the end of the step [K m2/W]; infinite for a step out of contact.

        Raises
        ------
        ValueError
            If the resistance is negative or not a number.
        """
        if not resistance >= 0.0:
            raise ValueError(f"resistance = {resistance!r} is out of range: 0 or more, infinite for a step apart")
        self._one[0] = resistance
        self._run(self._one, self._flux)
        return float(self._flux[0])

    def advance(self, resistances: ArrayLike, steps: int | None = None) -> Array:
        """Advance many steps; return the contact flux at the end of each [W/m2], shape (steps,).

        Parameters
        ----------
        resistances
            One value per step, or one value for all ``steps`` [K m2/W]; infinite for steps out of contact.
        steps
            Number of steps, if one value is given.

        Raises
        ------
        ValueError
            If a resistance is negative or not a number, or the count is missing or does not match.
        """
        given = history(resistances, steps)
        flux = np.empty(len(given))
        self._run(given, flux)
        return flux

    def _run(self, given: Array, flux: Array) -> None:
        """Step through a history; whenever a resistance has settled, close the loop and continue."""
        done = 0
        while done < len(given):
            loop = self._loop(float(self._state[self._tail + RESISTANCE]))
            done = advance_pair(
                self._pair.model,
                self._finger,
                self._object,
                self._state,
                given,
                flux,
                done,
                Loop(loop.decay, loop.gain, loop.vectors, loop.rest, loop.flux, loop.heat),
            )
            if done < len(given):
                self._enter(float(given[done]))

    def settle(self, resistance: float) -> tuple[ClosedLoop, Array]:
        """Return the closed loop at a finite resistance and the current amplitudes of its modes, shape (modes,).

        This works at any time: from here on, a constant resistance is exact in these modes.
        """
        self._state[: self._size] = self._sides()
        self._state[self._size :] = 0.0
        self._enter(resistance)
        loop = self._loop(resistance)
        return loop, self._state[self._size + MEMORY :][: len(loop.decay)].copy()

    def resume(self, resistance: float, amplitudes: Array, steps: int) -> None:
        """Continue from amplitudes, shape (modes,), reached ``steps`` steps after `settle`."""
        memory = self._state[self._size :]
        memory[MEMORY : MEMORY + len(amplitudes)] = amplitudes
        memory[COUNT] = steps

    def _loop(self, resistance: float) -> ClosedLoop:
        """Return the closed loop in use, or an empty one."""
        if self._state[self._size + CLOSED] == 0.0:
            return _OPEN
        if resistance not in self._loops:
            if len(self._loops) >= _KEPT_LOOPS:
                del self._loops[next(iter(self._loops))]
            pair = self._pair
            with one_thread():
                self._loops[resistance] = close_loop(pair.rates, pair.port, pair.level, resistance, self.period)
        return self._loops[resistance]

    def _enter(self, resistance: float) -> None:
        """Convert the state to the modes of the closed loop."""
        size, state = self._size, self._state
        for tail in (self._tail, self._split + int(self._object[TAIL])):
            state[tail + PHASE] = max(state[tail + PHASE], 0.0)
            state[tail + RESISTANCE] = resistance
        state[size + CLOSED] = 1.0
        loop = self._loop(resistance)
        enter_loop(state, loop.vectors, loop.rest, size)
        state[size + COUNT] = 0.0
        given = state[self._split + int(self._object[TAIL]) + HEAT]
        state[size + BASE] = given + loop.coming @ np.where(self._pair.port == 0.0, 0.0, state[:size] - loop.rest)

    def _sides(self) -> Array:
        """Return the current state of the pair, with the loop open, shape (size,)."""
        state = self._state.copy()
        if state[self._size + CLOSED]:
            loop = self._loop(float(state[self._tail + RESISTANCE]))
            tails = (self._tail, self._split + int(self._object[TAIL]))
            leave_loop(state, loop.vectors, loop.rest, loop.flux, loop.heat, self._size, *tails, self.period)
        return state[: self._size]

    @property
    def skin_temperature(self) -> float:
        """Temperature of the finger's contact face [K]."""
        return float(live.surface_temperature(self._finger, self._sides()[: self._split]))

    @property
    def object_temperature(self) -> float:
        """Temperature of the object's contact face [K]."""
        return float(live.surface_temperature(self._object, self._sides()[self._split :]))

    def temperature(self, side: SideName, depth: float) -> float:
        """Return the temperature [K] at a depth [m] from the contact.

        Raises
        ------
        ValueError
            If the side is unknown or the depth is outside it.
        """
        body, modes, moved = self._moved(side, depth)
        return float(initial_profile(body).temperature(np.array([depth]))[0] + modes.row(depth) @ moved)

    def flux_at(self, side: SideName, depth: float) -> float:
        """Return the flux [W/m2] at a depth [m]; positive from the finger's core towards the object's.

        Raises
        ------
        ValueError
            If the side is unknown or the depth is outside it.
        """
        body, modes, moved = self._moved(side, depth)
        stack = stack_of(body)
        conductivity = float(stack.conductivity[stack.locate(depth)[0]])
        inward = initial_profile(body).flux_at(depth) - conductivity * float(modes.slope(depth) @ moved)
        return inward if side == "object" else -inward

    def _moved(self, side: SideName, depth: float) -> tuple[Side, Modes, Array]:
        """Return a side, its modes, and the change of their coordinates since the start, shape (n,)."""
        body = self.contact.side(side)
        if not 0.0 <= depth <= min(body.depth, 1e6):
            raise ValueError(f"depth = {depth!r} is out of range: 0 to {body.depth:g} m on the {side}")
        finger = side == "finger"
        modes = side_modes(body, self.period)
        first = 0 if finger else self._split
        now = self._sides()[first : first + len(modes.rates)]
        return body, modes, now - live.initial_state(body, self.period, finger=finger)[: len(now)]

    @property
    def heat(self) -> float:
        """Heat that the finger has lost through the contact so far [J/m2]."""
        return float(self._sides()[self._split + int(self._object[TAIL]) + HEAT])


def history(resistances: ArrayLike, steps: int | None) -> Array:
    """Return one resistance per step [K m2/W], shape (steps,).

    Raises
    ------
    ValueError
        If one is negative or not a number, or the count is missing or does not match.
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


_NONE = np.zeros(8)
_OPEN = ClosedLoop(_NONE, _NONE, _NONE, _NONE, np.zeros((8, 8)), _NONE, 0.0)
