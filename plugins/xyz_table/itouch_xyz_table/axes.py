"""Compiled kernels of the table's twin: the motion of its three axes, and its sensors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.kernels import Block, gaussian, kernel

Floats = NDArray[np.float64]
Words = NDArray[np.uint64]

#: Share of the dry friction that the drive's feed-forward compensates, and damping ratio of its control.
COMPENSATED, DAMPING_RATIO = 0.8, 0.9
#: Resolution of the encoders [m].
ENCODER = 1e-6

# Indices of the parameters in the array that `move` takes; LOW and HIGH begin three entries each.
_parameters = Block()
OMEGA, SPEED, ACCELERATION, MASS, DRAG, LOW, HIGH, NOISE = _parameters.parts(1, 1, 1, 1, 1, 3, 3, 1)
PARAMETERS = _parameters.width


@kernel
def move(
    parameters: Floats,
    goal: Floats,
    axes: Floats,
    sensed: Floats,
    words: Words,
    wrench: Floats,
    period: float,
) -> int:
    """Advance the axes by one period and take the sensors' readings; return 0.

    Parameters
    ----------
    parameters
        Shape (PARAMETERS,).
    goal, wrench
        Commanded pose, shape (7,), and the wrench that presses on the table, shape (6,).
    axes
        Position, velocity and the previous step's goal, shape (3, 3).
    sensed
        Position from the encoders and force from the sensor, shape (6,); written.
    words
        The noise generator's state, shape (1,).
    period
        Length of the step [s].
    """
    omega, speed, acceleration = parameters[OMEGA], parameters[SPEED], parameters[ACCELERATION]
    for i in range(3):
        place, rate = axes[0, i], axes[1, i]
        pace = max(-speed, min(speed, (goal[i] - axes[2, i]) / period))
        pull = omega * omega * (goal[i] - place) + 2.0 * DAMPING_RATIO * omega * (pace - rate)
        pull = max(-acceleration, min(acceleration, pull))
        drag = math.copysign(min(parameters[DRAG], abs(rate) * 1e3), rate)
        rate += period * (pull + (wrench[i] - drag) / parameters[MASS])
        rate = max(-speed, min(speed, rate))
        place += period * rate
        low, high = parameters[LOW + i], parameters[HIGH + i]
        if place < low or place > high:  # an end stop
            place, rate = min(max(place, low), high), 0.0
        axes[0, i], axes[1, i], axes[2, i] = place, rate, goal[i]
        sensed[i] = np.rint(place / ENCODER) * ENCODER
        sensed[3 + i] = wrench[i]
    sensed[5] += parameters[NOISE] * gaussian(words)
    return 0


@kernel
def sense(sensed: Floats, pose: Floats, wrench: Floats) -> int:
    """Write the pose (7,) [m; quaternion] and wrench (6,) [N, N m] from the sensors' readings (6,) [m, N]; return 0."""
    for i in range(3):
        pose[i], wrench[i] = sensed[i], sensed[3 + i]
        pose[4 + i] = wrench[3 + i] = 0.0
    pose[3] = 1.0
    return 0
