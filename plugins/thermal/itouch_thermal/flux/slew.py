"""What a driver's slew rate, by which its current changes, leaves of a command.

A command beyond what flows before the next one leaves is not obeyed now but later, when nobody wants it any more.  A
loop that asks for ever more while the current is on its way swings between the ends of the slew.
"""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin.kernels import linked
from itouch_thermal.flux import observer as at

#: The share of the driver's slew rate that is planned with.
USED = 0.8
#: The least of the rate of a module without resistance that counts.  At the best current of a real one it is nothing.
LEAST = 0.1


@linked
def rate(c: Any, theta: Any, current: float, back: float) -> float:
    """Return how fast the pumped flux may change [W/m2 per second] around a current [A]; 0: at any rate.

    ``c`` (O_CONSTANTS,) and ``theta`` (p,) are the estimator's, each number in its own unit; ``back`` is the
    temperature [K] of the plate's back.  While heat is pumped into the plate, the flux changes faster with the current
    than at rest.  It counts as at rest: so slowly it changes at the end of a way back to none.
    """
    change = pull = c[at.O_SEEBECK] * (1.0 + theta[at.SEEBECK]) * back
    change -= c[at.O_RESISTANCE] * (1.0 + theta[at.OHMIC]) * max(0.0, current)
    return float(USED * c[at.O_SLEW] * max(LEAST * pull, change) / c[at.O_AREA])


@linked
def reached(current: float, flows: float, most: float) -> float:
    """Return the current [A] to ask for, so that the mean of what flows while it is held is ``current``, or nearest.

    ``flows`` is the current [A] that flows before, ``most`` [A] by how much it may change while the new one is held; 0:
    by any amount.  A ramp by ``d`` in the time ``d / most`` of that, and rest, is ``d**2 / (2 most)`` less in the mean.
    """
    if most <= 0.0:
        return current
    change = min(0.5 * most, abs(current - flows))
    ramp = most * (1.0 - math.sqrt(max(0.0, 1.0 - 2.0 * change / most)))
    return float(flows + math.copysign(ramp, current - flows))


@linked
def braked(heat: float, within: float, most: float) -> float:
    """Return the flux [W/m2] that takes ``heat`` [J/m2] away, within a time [s] where its rate of change allows.

    ``most`` is that rate [W/m2 per second]; 0: any.  From further away it is the flux that, falling at this rate from
    now on, joins the other by the time that little heat is left.
    """
    if most <= 0.0 or abs(heat) <= most * within * within:
        return heat / within
    return float(math.copysign(math.sqrt(most * (2.0 * abs(heat) - most * within * within)), heat))


@linked
def way(heat: float, span: float, most: float) -> float:
    """Return by how much a plan of the length ``span`` [s] may depart [W/m2] from the flux that holds a temperature.

    ``heat`` [J/m2] is to be moved, at a flux that may change by ``most`` [W/m2 per second].  From further away the flux
    could not be back when the heat is moved; a plan does not see that if it ends before.  What can be back within half
    the plan is always allowed.
    """
    return float(max(0.5 * most * span, math.sqrt(2.0 * most * abs(heat))))
