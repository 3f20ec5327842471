"""The table's twin: three axes with mass, dry friction, position control, end stops and a force sensor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Bound, Field, Record, Twin, TwinInputs


class XyzTableTwin(Twin):
    """Axes under position control with velocity feed-forward, limited in speed and acceleration."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        from itouch_xyz_table import axes

        x, y, z = params.travel
        drag = params.friction * (1.0 - axes.COMPENSATED)
        omega = 2.0 * math.pi * params.bandwidth
        ends = (-x / 2, -y / 2, 0.0, x / 2, y / 2, z)
        rows = (omega, params.speed, params.acceleration, params.mass, drag, *ends, params.force_noise)
        self._parameters = np.array(rows)
        self._move, self._sense = axes.move, axes.sense
        words = np.zeros(1, np.uint64)  # compiles now, not in the first tick
        axes.move(self._parameters, np.zeros(7), np.zeros((3, 3)), np.zeros(6), words, np.zeros(6), 1e-3)

    def fields(self) -> tuple[Field, ...]:
        """Return the axes' position, velocity and last goal, the sensors' readings, and the noise generator."""
        return (
            Field(
                "axes",
                "f8",
                (3, 3),
                unit="mixed",
                doc="position [m], velocity [m/s] and last goal [m] of the axes, one row each",
            ),
            Field(
                "sensed",
                "f8",
                6,
                unit="mixed",
                doc="position [m] and force [N], as its encoders and its force sensor give them",
            ),
            Field("noise", "u8", 1, unit="1", doc="word of the noise generator"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Put the table at the bottom of the middle of its travel, at rest."""
        state["axes"] = 0.0
        state["sensed"] = 0.0
        state["noise"] = rng.integers(0, 1 << 63)

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the true position of the plate's carrier [m], shape (3,)."""
        place: NDArray[np.float64] = state["axes"][0]
        return place

    def bound_step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> Bound:
        """Bind the step to these views as one compiled call."""
        return Bound(
            self._move, self._parameters, command["pose_target"], state["axes"], state["sensed"], state["noise"],
            touch.wrench, period,
        )  # fmt: skip

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance the axes by one period [s]."""
        self.bound_step(state, command, touch, period)()

    def bound_read(self, state: Record, reading: Record) -> Bound:
        """Bind the reading of these views as one compiled call."""
        felt = np.zeros(6) if self.params.tmcl else reading["wrench"]  # steppers measure no force
        return Bound(self._sense, state["sensed"], reading["pose"], felt)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Write the position from the encoders, and the force sensor's noisy reading."""
        self.bound_read(state, reading)()
        return True
