"""The operator's twin: a fingertip mass on the spring of a hand that follows minimum-jerk targets.

It is mechanical only, and feels the arm's wrench and the plate's force on the finger pad, never the virtual force
itself.  Minimum-jerk paths: Flash and Hogan 1985.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence

from itouch.plugin import Record
from itouch.scene.elements import Operator

Vector = tuple[float, float, float]
_LEAD_SPEED = 0.08


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

    def at(self, time: float) -> tuple[Vector, Vector]:
        """Return position [m] and velocity [m/s] of the target at a time [s]."""
        if not self._pieces:
            return self.start, (0.0, 0.0, 0.0)
        begin, duration, here, there = self._pieces[max(0, bisect.bisect_right(self._begins, time) - 1)]
        s = (time - begin) / duration
        if s >= 1.0:
            return there, (0.0, 0.0, 0.0)
        blend = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration
        (ax, ay, az), (bx, by, bz) = here, there
        dx, dy, dz = bx - ax, by - ay, bz - az
        return (ax + blend * dx, ay + blend * dy, az + blend * dz), (rate * dx, rate * dy, rate * dz)


class Hand:
    """Moves the finger of one probe on its part of State."""

    def __init__(self, operator: Operator, name: str, state: Record, period: float) -> None:
        self.operator, self.path, self._period = operator, Path(operator), period
        self.position, self.velocity = state[f"{name}.hand.position"], state[f"{name}.hand.velocity"]
        self.target, self.ticks = state[f"{name}.hand.target"], state[f"{name}.hand.ticks"]
        self.offset = state[f"{name}.hand.offset"]

    def reset(self) -> None:
        """Rest at the first target."""
        self.position[:] = self.path.start
        self.target[:] = self.path.start
        self.velocity[:] = 0.0
        self.offset[...] = 0.0
        self.ticks[...] = 0

    @property
    def done(self) -> bool:
        """Whether the scripted motion has ended."""
        return bool(self.ticks.item() * self._period >= self.path.duration)

    def lower(self, offset: float) -> None:
        """Move the hand's target towards a height above (or below) its path [m], as slowly as a person would."""
        step = _LEAD_SPEED * self._period
        now = float(self.offset)
        self.offset[...] = now + max(-step, min(step, offset - now))

    def step(self, forces: Sequence[float], moving: bool) -> None:
        """Advance by one period under the forces on the finger [N], world frame; the target moves if ``moving``."""
        period, operator = self._period, self.operator
        ticks = self.ticks.item()
        if moving:
            ticks += 1
            self.ticks[...] = ticks
        (x, y, z), pace = self.path.at(ticks * period)
        there = (x, y, z + self.offset.item())
        position, velocity = self.position.tolist(), self.velocity.tolist()
        for i in range(3):
            pull = operator.stiffness * (there[i] - position[i]) + operator.damping * (pace[i] - velocity[i])
            velocity[i] += period * (pull + forces[i]) / operator.mass
            position[i] += period * velocity[i]
        self.position[:] = position
        self.velocity[:] = velocity
        self.target[:] = there

    def pad_force(self, gap: float, rate: float) -> float:
        """Return the force of a plate on the finger pad [N]; ``gap`` [m] and its rate [m/s], negative: pressing."""
        if gap >= 0.0:
            return 0.0
        return max(0.0, -self.operator.pad_stiffness * gap - self.operator.pad_damping * rate)
