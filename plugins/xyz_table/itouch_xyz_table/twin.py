"""The table's twin: three axes with mass, dry friction, position control, end stops and a force sensor."""

from __future__ import annotations

import math

import numpy as np

from itouch.plugin import Field, Record, Touch, Twin, gaussian

_ENCODER = 1e-6
#: Part of the dry friction that the drive's feed-forward makes up for.
_COMPENSATED = 0.8
_DAMPING_RATIO = 0.9


class XyzTableTwin(Twin):
    """Axes under position control with velocity feed-forward, limited in speed and acceleration."""

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
        p = self.params
        omega = 2.0 * math.pi * p.bandwidth
        targets, last = command["pose_target"].tolist(), state["target"].tolist()
        position, velocity = state["position"].tolist(), state["velocity"].tolist()
        load = touch.wrench.tolist()
        drag = p.friction * (1.0 - _COMPENSATED)
        for i in range(3):
            pace = max(-p.speed, min(p.speed, (targets[i] - last[i]) / period))
            pull = omega * omega * (targets[i] - position[i]) + 2.0 * _DAMPING_RATIO * omega * (pace - velocity[i])
            pull = max(-p.acceleration, min(p.acceleration, pull))
            push = (load[i] - math.copysign(min(drag, abs(velocity[i]) * 1e3), velocity[i])) / p.mass
            speed = max(-p.speed, min(p.speed, velocity[i] + period * (pull + push)))
            position[i], velocity[i] = _stopped(position[i] + period * speed, speed, *self._ends(i))
        state["position"], state["velocity"] = position, velocity
        state["target"], state["load"] = targets[:3], load[:3]

    def _ends(self, axis: int) -> tuple[float, float]:
        travel = self.params.travel[axis]
        return (0.0, travel) if axis == 2 else (-travel / 2, travel / 2)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give encoder positions and the force sensor's noisy reading."""
        x, y, z = (round(value / _ENCODER) * _ENCODER for value in state["position"].tolist())
        reading["pose"] = (x, y, z, 1.0, 0.0, 0.0, 0.0)
        fx, fy, fz = state["load"].tolist()
        reading["wrench"] = (fx, fy, fz + self.params.force_noise * gaussian(state, "noise"), 0.0, 0.0, 0.0)
        return True


def _stopped(position: float, speed: float, low: float, high: float) -> tuple[float, float]:
    """Stop at the end stops."""
    if position < low:
        return low, 0.0
    return (high, 0.0) if position > high else (position, speed)
