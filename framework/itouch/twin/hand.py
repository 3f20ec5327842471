"""The operator's hand: its target follows minimum-jerk paths, and its finger is moved by what acts on it.

Minimum-jerk paths: Flash and Hogan 1985.
"""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.scene.elements import Operator

Vector = tuple[float, float, float]
#: Speed at which a hand is led away from its path for a calibration, and back [m/s].
LEAD_SPEED = 0.08


class Path:
    """The motion of the hand's target: pieces of minimum jerk, each followed by a rest."""

    def __init__(self, operator: Operator) -> None:
        targets = operator.motion.targets
        self.start: Vector = targets[0].pos if targets else (0.0, 0.0, 0.0)
        self._pieces: list[tuple[float, float, Vector, Vector]] = []
        self._begins: list[float] = []
        here, time = self.start, 0.0
        for target in targets:
            self._begins.append(time)
            self._pieces.append((time, target.in_, here, target.pos))
            time += target.in_ + target.hold
            here = target.pos
        self.duration = time

    def at(self, time: float) -> tuple[float, float, float, float, float, float]:
        """Return position [m] and velocity [m/s] of the target at a time [s]."""
        if not self._pieces:
            return (*self.start, 0.0, 0.0, 0.0)
        begin, duration, here, there = self._pieces[max(0, bisect.bisect_right(self._begins, time) - 1)]
        s = (time - begin) / duration
        if s >= 1.0:
            return (*there, 0.0, 0.0, 0.0)
        blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration
        (ax, ay, az), (bx, by, bz) = here, there
        dx, dy, dz = bx - ax, by - ay, bz - az
        return ax + blend * dx, ay + blend * dy, az + blend * dz, rate * dx, rate * dy, rate * dz


class Hand:
    """The target of one probe's hand, and the finger's motion, on their part of State."""

    def __init__(self, operator: Operator, name: str, state: Record, period: float) -> None:
        self.operator, self.path, self._period = operator, Path(operator), period
        self.ticks, self.offset = state[f"{name}.hand.ticks"], state[f"{name}.hand.offset"]
        self.motion: NDArray[np.float64] = state.flat(f"{name}.hand.position", f"{name}.hand.target")

    def reset(self) -> None:
        """Rest at the first target."""
        self.motion[:] = (*self.path.start, 0.0, 0.0, 0.0, *self.path.start)
        self.offset[...] = 0.0
        self.ticks[...] = 0

    @property
    def done(self) -> bool:
        """Whether the scripted motion has ended."""
        return bool(self.ticks.item() * self._period >= self.path.duration)

    def lower(self, offset: float) -> None:
        """Move the hand's target towards a height above (or below) its path [m], as slowly as a person would."""
        now = self.offset.item()
        if now != offset:
            step = LEAD_SPEED * self._period
            self.offset[...] = now + max(-step, min(step, offset - now))

    def goal(self, moving: bool) -> tuple[float, ...]:
        """Return the target's position and velocity for the next step; it moves on if ``moving``."""
        ticks = self.ticks.item()
        if moving:
            ticks += 1
            self.ticks[...] = ticks
        x, y, z, u, v, w = self.path.at(ticks * self._period)
        return x, y, z + self.offset.item(), u, v, w
