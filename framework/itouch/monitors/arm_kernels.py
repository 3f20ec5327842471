"""What an arm may do to a finger, compiled: the arithmetic of `Arm`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from itouch.compiling import kernel

Floats = NDArray[np.float64]


class Pushing(NamedTuple):
    """Greatest force [N] and torque [N m] that can have been sent; speeds [m/s] from which forces fade, and that trip.

    ``torque`` is infinite where there is none; ``finger_force``, ``finger_torque``, ``speed``: the codes of the trips.
    """

    force: float
    torque: float
    slow: float
    fast: float
    finger_force: int
    finger_torque: int
    speed: int


@kernel
def check(pushing: Any, wrench: Floats, speed: float, figure: Floats) -> float:
    """Return the share of the force that the finger's speed [m/s] allows, or minus the code of a trip.

    ``pushing``: a `Pushing`; ``wrench`` (6,): what was sent [N, N m]; ``figure`` (1,): the value that tripped, written.
    """
    force = math.sqrt(wrench[0] * wrench[0] + wrench[1] * wrench[1] + wrench[2] * wrench[2])
    if force > pushing.force:  # a force that was limited can't be greater
        figure[0] = force
        return -float(pushing.finger_force)
    if pushing.torque < math.inf:
        torque = math.sqrt(wrench[3] * wrench[3] + wrench[4] * wrench[4] + wrench[5] * wrench[5])
        if torque > pushing.torque:
            figure[0] = torque
            return -float(pushing.finger_torque)
    if speed <= pushing.slow:
        return 1.0
    if not speed <= pushing.fast:
        figure[0] = speed
        return -float(pushing.speed)
    return float((pushing.fast - speed) / (pushing.fast - pushing.slow))
