"""With what force a contact is felt: that of the plate where it is there, else the virtual one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel
from itouch.loop.render import HAS_LOAD, NORMAL_FORCE, PERIOD
from itouch.loop.surface.memory import (
    FELT,
    FELT_FORCE,
    FELT_WEIGHT,
    LINGERED,
    LINGERED_AT,
    LINGERS,
    PRESENT,
    PRESSED,
    TOUCH,
)

Floats = NDArray[np.float64]

#: How long [s] the virtual force stands for one that is not felt yet, and in which time it is blended into the other.
WAIT, BLEND = 0.080, 0.020
#: Least force [N] that a contact is said to be felt with.
LEAST = 1e-3


@kernel
def feel(c: Floats, figures: Floats, memory: Floats, load: float, touching: bool) -> None:
    """Say with what force [N] the finger feels the contact: the plate's where the plate renders, else the virtual one.

    At first it is the virtual one, until the plate is felt, and then it is blended into the other.

    ``c`` (CONSTANTS,) and ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``load``: the force that the
    plate reads [N].
    """
    if not touching:
        memory[PRESSED] = memory[FELT] = memory[FELT_WEIGHT] = memory[FELT_FORCE] = 0.0
        return
    memory[PRESSED] += c[PERIOD]
    pressed = max(0.0, -load)
    if pressed > TOUCH or memory[PRESSED] > WAIT:
        memory[FELT] = 1.0
    real = c[HAS_LOAD] > 0.0 and memory[PRESENT] > 0.0 and memory[FELT] > 0.0
    way = c[PERIOD] / BLEND
    weight = min(1.0, memory[FELT_WEIGHT] + way) if real else max(0.0, memory[FELT_WEIGHT] - way)
    memory[FELT_WEIGHT] = weight
    if weight > 0.0:
        memory[FELT_FORCE] = max(LEAST, (1.0 - weight) * figures[NORMAL_FORCE] + weight * pressed)
    else:
        memory[FELT_FORCE] = figures[NORMAL_FORCE]


@kernel
def linger(c: Floats, memory: Floats, load: float, touching: bool, time: float) -> None:
    """Remember for how long the plate was felt at most after a virtual contact had ended [s], and when that was.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``load``: the force that the plate reads [N]; ``time`` of
    the tick [s].
    """
    if touching:
        memory[LINGERS] = 0.0
    elif memory[LINGERS] >= 0.0 and -load > TOUCH:
        memory[LINGERS] += c[PERIOD]
        if memory[LINGERS] > memory[LINGERED]:
            memory[LINGERED], memory[LINGERED_AT] = memory[LINGERS], time
    else:
        memory[LINGERS] = -1.0
