"""The three axes of the table's twin, compiled: position control against mass and dry friction."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Part of the dry friction that the drive's feed-forward makes up for, and damping ratio of its control.
COMPENSATED, DAMPING_RATIO = 0.8, 0.9

# Where the parameters stand in the array that `move` takes.
OMEGA, SPEED, ACCELERATION, MASS, DRAG, LOW, HIGH = 0, 1, 2, 3, 4, 5, 8
PARAMETERS = 11


@njit(cache=True, error_model="numpy")
def move(
    parameters: Floats,
    goal: Floats,
    position: Floats,
    velocity: Floats,
    target: Floats,
    load: Floats,
    wrench: Floats,
    period: float,
) -> None:
    """Advance the axes by one period.

    Parameters
    ----------
    parameters
        Shape (PARAMETERS,).
    goal, wrench
        Commanded pose (7,) and what presses on the table (6,).
    position, velocity, target, load
        State of the axes, each shape (3,); ``target`` is the goal of the step before.
    period
        Length of the step [s].
    """
    omega, speed, acceleration = parameters[OMEGA], parameters[SPEED], parameters[ACCELERATION]
    for i in range(3):
        pace = max(-speed, min(speed, (goal[i] - target[i]) / period))
        pull = omega * omega * (goal[i] - position[i]) + 2.0 * DAMPING_RATIO * omega * (pace - velocity[i])
        pull = max(-acceleration, min(acceleration, pull))
        drag = math.copysign(min(parameters[DRAG], abs(velocity[i]) * 1e3), velocity[i])
        rate = velocity[i] + period * (pull + (wrench[i] - drag) / parameters[MASS])
        rate = max(-speed, min(speed, rate))
        place = position[i] + period * rate
        low, high = parameters[LOW + i], parameters[HIGH + i]
        if place < low or place > high:  # an end stop
            place, rate = min(max(place, low), high), 0.0
        position[i], velocity[i] = place, rate
        target[i], load[i] = goal[i], wrench[i]
