"""The least time that the plate needs from one uniform temperature to another."""

from __future__ import annotations

import math

import numpy as np

from itouch_thermal.display.column import P_BACK, P_DECAY, P_PORT, P_PUMP, REACH, Array, column, plate_capacity
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.peltier import pumped_heat
from itouch_thermal.heat import FINGER

#: The plate has arrived when face and base stay this close [K] to the new temperature.
CLOSE = 0.05
#: Resolution [s], longest time tried beyond what the heat alone needs [s], and time in which the plate evens out [s].
STEP, EXTRA, SETTLING = 1e-3, 0.06, 0.04
#: A switch that takes longer than this [s] is limited by the heat alone.
SLOW = 5.0


def least_time(display: DisplayParams, begin: float, end: float, *, limit: float | None = None) -> float:
    """Return the least time [s] to bring face and base from one uniform temperature [K] to another, without the delay.

    The greatest flux is applied all the way and, at the end, its opposite for the best duration: with one slow and one
    fast mode that matter, time-optimal pumping changes sign once.

    Parameters
    ----------
    display
        The plate, and the greatest flux that a controller demands.
    begin, end
        Temperatures [K].
    limit
        Greatest flux [W/m2]; default: the display's.
    """
    change, flux = abs(end - begin), limit or display.flux_limit
    if change <= CLOSE:
        return 0.0
    extra, heat = round(EXTRA / STEP), (change - CLOSE) * plate_capacity(display.plate)
    if heat / flux > SLOW:
        return heat / flux
    pushed = math.ceil(heat / flux / STEP)
    count = pushed + 2 * extra + round(SETTLING / STEP)
    face, base = _rises(display, flux, count)
    best = math.inf
    for forward in range(pushed, pushed + extra):
        for back in range(extra):
            away = np.maximum(
                np.abs(_pulse(face, forward, back) - change), np.abs(_pulse(base, forward, back) - change)
            )
            late = np.flatnonzero(away > CLOSE)
            last = int(late[-1]) + 1 if late.size else 0
            if last < count:
                best = min(best, last * STEP)
            if forward + back > best / STEP:
                break
    return best


def strongest(display: DisplayParams, ceiling: float) -> float:
    """Return the greatest flux [W/m2] that currents up to ``ceiling`` [A] pump from a plate as warm as the sink."""
    cold = 296.15
    current = min(ceiling, display.seebeck * cold / display.resistance)
    heat = pumped_heat(display.seebeck, display.resistance, display.conductance, current, cold, cold)
    return max(1e-3, min(display.flux_limit, heat / display.area))


def _rises(display: DisplayParams, flux: float, count: int) -> tuple[Array, Array]:
    """Return the rise [K] of face and base during ``count`` steps of a flux [W/m2], each of shape (count,)."""
    rows = column(FINGER, 310.15, 306.15, display.plate, STEP, REACH / STEP).plate
    modes = np.zeros(rows.shape[1])
    found = np.empty((2, count))
    for i in range(count):
        modes = rows[P_DECAY] * modes + rows[P_PUMP] * flux
        found[:, i] = rows[P_PORT] @ modes, rows[P_BACK] @ modes
    return found[0], found[1]


def _pulse(rise: Array, forward: int, back: int) -> Array:
    """Return the response to ``forward`` steps of the greatest flux and ``back`` steps of its opposite."""
    found = rise.copy()
    found[forward:] -= 2.0 * rise[: len(rise) - forward]
    found[forward + back :] += rise[: len(rise) - forward - back]
    return found
