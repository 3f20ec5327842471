"""Virtual coupling of an arm behind a wire: the older the pose and the force, the softer the coupling.

A sampled spring K that acts on where the finger was a time d ago adds energy as a damper of -K d would: with the hand's
and the device's damping b it is passive up to K <= (b - B) / (T / 2 + d), where B is the damping that is rendered and T
the servo period (Colgate and Schenkel 1997 for d = 0; Gil et al. 2009, "Stability boundary for haptic rendering", for
a delay).  `world.coupling` keeps to that bound with d = 0, which is right for a device that is read and written in
every tick.  Behind a wire, d is the age of the pose plus the time for which the newest command has acted, and both are
known only while running: without this correction a finger that rests on a surface begins to circle around its place.

What must be remembered is in State, so that a restored or a replayed session renders the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel, linked
from itouch.plugin import Record
from itouch.safety.latch import ENABLED
from itouch.world import Model

Floats = NDArray[np.float64]

#: Over how long the delay is averaged [s]: a few periods of a finger that begins to vibrate.  It is the mean delay that
#: adds energy; a single late exchange does no harm.
MEAN = 0.25
#: Greatest relative change of the stiffness in a tick: some 0.04 N of a press of 2 N.
CHANGE = 0.02
#: Longest time [s] that is counted as a delay: older readings stop the device (W1).
LONGEST = 0.1


class Late(NamedTuple):
    """How late a coupling is, and what that has cost: fields of State, (1,) each.

    Delay of pose and command together [s], smoothed; the greatest part of its stiffness [1] that a touched object was
    rendered without, and the index of that object.
    """

    delay: Any
    lost: Any
    lost_object: Any


@linked
def allowed(stiffness: float, damping: float, relied: float, late: float) -> tuple[float, float]:
    """Return the stiffness [N/m] and damping [N s/m] that are passive at a delay; damping is lowered before stiffness.

    ``relied``: damping of hand and device that is relied on [N s/m]; ``late``: half a period plus the delay [s].
    """
    damping = min(damping, max(0.0, relied - stiffness * late))
    return min(stiffness, (relied - damping) / late), damping


@kernel
def ease(
    tick: Any, measured: Any, left: Any, status: Any, found: Late, touched: Any, coupling: Floats, relied: float,
    period: float, stiffness: Floats, damping: Floats,
) -> int:  # fmt: skip
    """Write the coupling with each object as the delay allows it; arrays have shape (1,) unless said otherwise.

    Parameters
    ----------
    tick, measured, left, status
        This tick; the tick in which the pose was measured; the one in which the arm's newest command left; the arm's
        status.
    found
        How late it is, and what that has cost; written.
    touched
        Index of the object that was touched in the last tick, -1: none.
    coupling
        Stiffness and damping of the objects without a delay, shape (objects, 2) [N/m, N s/m].
    relied, period
        Damping of hand and device that is relied on [N s/m]; length of a tick [s].
    stiffness, damping
        Written, shape (objects,).
    """
    delay, lost = found.delay, found.lost
    age = max(0, tick[0] - measured[0])
    acts = left[0] > 0 and status[0] == ENABLED  # a disabled arm gets no commands; that does not make it later
    held = max(0, tick[0] - left[0]) if acts else age
    more = min((age + held) * period, LONGEST) - delay[0]
    more *= period / MEAN
    delay[0] += min(more, CHANGE * (0.5 * period + delay[0]))
    late = 0.5 * period + delay[0]
    for i in range(coupling.shape[0]):
        stiffness[i], damping[i] = allowed(coupling[i, 0], coupling[i, 1], relied, late)
    one = touched[0]
    if one >= 0 and stiffness[one] < (1.0 - lost[0]) * coupling[one, 0]:
        lost[0], found.lost_object[0] = 1.0 - stiffness[one] / coupling[one, 0], one
    return 0


#: The lost part of a stiffness [1] from which on the report has a notice of it.
SAID = 0.05


def late_couplings(model: Model, state: Record) -> tuple[str, ...]:
    """Return a sentence for each probe to which an object was rendered softer because its arm is late."""
    found = []
    for probe in model.probes:
        name = f"{probe.name}.coupling"
        if probe.relied is None or state[f"{name}.lost"].item() < SAID:
            continue
        one, delay = state[f"{name}.lost_object"].item(), state[f"{name}.delay"].item()
        own = probe.coupling[one].stiffness
        found.append(
            f"'{model.objects[one]}' was rendered to '{probe.name}' with {own * (1.0 - state[f'{name}.lost']):.0f} "
            f"N/m at least, instead of {own:g}: pose and force of '{probe.scene.force_to}' are some "
            f"{1e3 * delay:.1f} ms late, and a stiffer surface could begin to oscillate; a faster exchange, or a "
            "measured hand-damping, allows more"
        )
    return tuple(found)
