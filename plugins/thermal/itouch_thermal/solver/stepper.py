"""The live stepper of one contact: any history of resistances, one flux a step."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from itouch_thermal.solver import live
from itouch_thermal.solver.layers import Contact
from itouch_thermal.solver.packing import HEAT, PHASE, RESISTANCE, TAIL, pair_model
from itouch_thermal.solver.stack import Array


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
        self._pair = pair_model(contact.finger, contact.object, period)
        self._split = live.state_size(self._finger)
        self._state = np.concatenate(
            (
                live.initial_state(contact.finger, period, finger=True),
                live.initial_state(contact.object, period, finger=False),
            )
        )

    @property
    def state(self) -> Array:
        """Everything that changes, flat and writable; assign to it, or into it, to restore."""
        return self._state

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._state[:] = value

    def step(self, resistance: float) -> float:
        """Advance one step; return the contact flux at its end [W/m2].

        Parameters
        ----------
        resistance
            Contact resistance at the end of the step [K m2/W]; infinite for a step apart.
        """
        return float(self.advance(resistance, 1)[0])

    def advance(self, resistances: ArrayLike, steps: int | None = None) -> Array:
        """Advance many steps; return the contact flux at the end of each [W/m2], shape (steps,).

        Parameters
        ----------
        resistances
            One value a step, or one value for all ``steps`` [K m2/W]; infinite for a step apart.
        steps
            How many, for one value.

        Raises
        ------
        ValueError
            If a resistance is negative or not a number, or the count is missing or does not fit.
        """
        given = np.array(resistances, dtype=np.float64)
        if given.ndim == 0:
            given = np.full(1 if steps is None else steps, float(given))
        if not np.all(given >= 0.0):
            raise ValueError("resistances: each must be 0 or more, infinite for a step apart")
        flux = np.empty(len(given))
        _advance(self._pair, self._finger, self._object, self._state, given, flux)
        return flux

    @property
    def skin_temperature(self) -> float:
        """Temperature of the finger's contact face [K]."""
        return float(live.surface_temperature(self._finger, self._state[: self._split]))

    @property
    def object_temperature(self) -> float:
        """Temperature of the object's contact face [K]."""
        return float(live.surface_temperature(self._object, self._state[self._split :]))


@njit(cache=True, error_model="numpy")
def _advance(pair: Array, finger: Array, body: Array, state: Array, resistances: Array, flux: Array) -> None:
    work = np.empty(live.SCRATCH)
    split = int(finger[0])
    f, b = int(finger[TAIL]), split + int(body[TAIL])
    finger_state, body_state = state[:split], state[split:]
    for step in range(len(resistances)):
        resistance = resistances[step]
        if resistance == np.inf:
            live.advance_air(finger, finger_state, work)
            live.advance_air(body, body_state, work)
            flux[step] = 0.0
            continue
        fresh = state[f] <= 0.0 or state[b] <= 0.0
        before = state[f + RESISTANCE]
        if fresh:
            state[f + PHASE] = state[b + PHASE] = 0.0
        if fresh or (resistance == before and state[f] < live.EXACT_STEPS):
            flux[step], heat = live.contour(pair, state, resistance, work)
        else:
            flux[step], heat = live.collocate(pair, state, before, resistance, work)
        state[f + PHASE] += 1.0
        state[b + PHASE] += 1.0
        state[f + RESISTANCE] = state[b + RESISTANCE] = resistance
        state[f + HEAT] -= heat
        state[b + HEAT] += heat
