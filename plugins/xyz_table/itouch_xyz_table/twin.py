"""The table's twin: three axes with mass, dry friction, position control, end stops and a force sensor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from itouch.plugin import Field, Record, Touch, Twin, gaussian

_ENCODER = 1e-6
#: Adding and subtracting it rounds a number to an integer, and leaves NaN what it is.
_TO_INTEGER = 1.5 * 2.0**52


class XyzTableTwin(Twin):
    """Axes under position control with velocity feed-forward, limited in speed and acceleration."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        from itouch_xyz_table import axes

        x, y, z = params.travel
        drag = params.friction * (1.0 - axes.COMPENSATED)
        omega = 2.0 * math.pi * params.bandwidth
        rows = (omega, params.speed, params.acceleration, params.mass, drag, -x / 2, -y / 2, 0.0, x / 2, y / 2, z)
        self._parameters = np.array(rows)
        self._parameters.setflags(write=False)
        self._move = axes.move
        a, b, c, d = (np.zeros(3) for _ in range(4))
        axes.move(self._parameters, np.zeros(7), a, b, c, d, np.zeros(6), 1e-3)  # compiled now, not in the first tick

    def fields(self) -> tuple[Field, ...]:
        """Return positions, velocities, the last target, the load and the noise generator's word."""
        return (
            Field("position", "f8", 3),
            Field("velocity", "f8", 3),
            Field("target", "f8", 3),
            Field("load", "f8", 3),
            Field("noise", "u8"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Stand in the middle of the travel, at the bottom."""
        for name in ("position", "velocity", "target", "load"):
            state[name] = 0.0
        state["noise"] = rng.integers(0, 1 << 63)

    def pose(self, state: Record) -> tuple[float, float, float] | None:
        """Return where the plate's carrier truly is."""
        x, y, z = state["position"].tolist()
        return x, y, z

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Move the axes by one period."""
        self._move(
            self._parameters, command["pose_target"], state["position"], state["velocity"], state["target"],
            state["load"], touch.wrench, period,
        )  # fmt: skip

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give encoder positions and the force sensor's noisy reading."""
        x, y, z = state["position"].tolist()
        fx, fy, fz = state["load"].tolist()
        steps = [(value / _ENCODER + _TO_INTEGER - _TO_INTEGER) * _ENCODER for value in (x, y, z)]
        reading["pose"] = (*steps, 1.0, 0.0, 0.0, 0.0)
        reading["wrench"] = (fx, fy, fz + self.params.force_noise * gaussian(state, "noise"), 0.0, 0.0, 0.0)
        return True
