"""The force with which a contact is felt: that of the plate where it is present, else the virtual one."""

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
)
from itouch.plugin.carried_surfaces import TOUCH

Floats = NDArray[np.float64]

#: How long [s] the virtual force stands in for a plate that is not felt yet, and in what time it blends into the
#: plate's.
WAIT, BLEND = 0.080, 0.020
#: Least felt force [N] of a contact that the plate renders.
LEAST = 1e-3


@kernel
def feel(c: Floats, figures: Floats, memory: Floats, load: float, touching: bool) -> None:
    """Write with what force [N] the finger feels the contact: the plate's where the plate is present, else the virtual.

    Until the plate is felt it is the virtual force, which is then blended into the plate's.

    ``c`` (CONSTANTS,) and ``figures`` (FIGURES,), ``memory`` (MEMORY,) of the surface; ``load``: the force that the
    plate reads [N]; a finger that presses makes it negative.
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
    """Remember the longest time [s] for which the plate was felt after a virtual contact had ended, and when that was.

    ``c`` (CONSTANTS,), ``memory`` (MEMORY,) of the surface; ``load``: the force that the plate reads [N], negative when
    pressed; ``time`` of the tick [s].
    """
    if touching:
        memory[LINGERS] = 0.0
    elif memory[LINGERS] >= 0.0 and -load > TOUCH:
        memory[LINGERS] += c[PERIOD]
        if memory[LINGERS] > memory[LINGERED]:
            memory[LINGERED], memory[LINGERED_AT] = memory[LINGERS], time
    else:
        memory[LINGERS] = -1.0
