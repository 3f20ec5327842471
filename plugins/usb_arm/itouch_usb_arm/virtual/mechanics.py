"""The moving parts of the virtual arm: grip mass, inertia of the legs, friction, end stops and motors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from itouch_usb_arm import kinematics
from itouch_usb_arm.kinematics import CENTRE, Matrix, Vector
from itouch_usb_arm.virtual.hand import Hand, Pusher

#: Longest integration step [s], and longest time [s] that one call catches up on.
STEP, CATCH_UP = 1e-3, 0.25
#: The workspace inside the end stops: range of z, and greatest distance from the z axis [m].
LOW, HIGH, RADIUS = 0.072, 0.178, 0.060


@dataclass(slots=True)
class Mechanics:
    """A delta arm held by a hand.

    Attributes
    ----------
    mass, inertia, drag
        Mass of grip and finger [kg], inertia of a leg about its motor [kg m2], friction at the grip [N s/m].
    counts_per_torque
        The true force scale [counts/(N m)], unknown to the driver.
    """

    mass: float = 0.12
    inertia: float = 1.0e-4
    drag: float = 0.5
    counts_per_torque: float = 2500.0
    hand: Pusher = field(default_factory=Hand)
    position: Vector = CENTRE
    velocity: Vector = (0.0, 0.0, 0.0)
    motors: tuple[int, int, int] = (0, 0, 0)
    _now: float | None = None

    def advance(self, now: float) -> None:
        """Advance to a time [s]."""
        if self._now is None:
            self._now = now
        self._now = max(self._now, now - CATCH_UP)
        while now - self._now > 1e-9:
            step = min(STEP, now - self._now)
            self._step(step)
            self._now += step

    def counts(self) -> tuple[int, int, int]:
        """Return the encoder counts that a homed arm would have here."""
        one, two, three = (round(count) for count in kinematics.counts_of(kinematics.inverse(self.position)))
        return one, two, three

    def motor_force(self) -> Vector:
        """Return the force of the motors on the operator [N]."""
        one, two, three = (-motor / self.counts_per_torque for motor in self.motors)
        return kinematics.push(self.position, (one, two, three))

    def _step(self, step: float) -> None:
        pushes = self.hand.force(self._now or 0.0, self.position, self.velocity)
        motors = self.motor_force() if any(self.motors) else (0.0, 0.0, 0.0)
        total = tuple(p + m - self.drag * v for p, m, v in zip(pushes, motors, self.velocity, strict=True))
        ax, ay, az = kinematics.solve(self._inertia(), (total[0], total[1], total[2]))
        vx, vy, vz = self.velocity
        vx, vy, vz = vx + step * ax, vy + step * ay, vz + step * az
        x, y, z = self.position
        self.position, self.velocity = _stopped((x + step * vx, y + step * vy, z + step * vz), (vx, vy, vz))

    def _inertia(self) -> Matrix:
        """Return the mass matrix at the grip: M = m + J^T I J."""
        rows = kinematics.jacobian(self.position)
        one, two, three = (
            tuple(
                (self.mass if i == j else 0.0) + self.inertia * sum(row[i] * row[j] for row in rows) for j in range(3)
            )
            for i in range(3)
        )
        return (one[0], one[1], one[2]), (two[0], two[1], two[2]), (three[0], three[1], three[2])


def _stopped(position: Vector, velocity: Vector) -> tuple[Vector, Vector]:
    """Keep the grip inside the end stops."""
    x, y, z = position
    vx, vy, vz = velocity
    if not LOW <= z <= HIGH:
        z, vz = min(max(z, LOW), HIGH), 0.0
    reach = min(RADIUS, 0.01 + (0.185 - z) * 2.0)
    distance = math.hypot(x, y)
    if distance > reach:
        x, y, vx, vy = x * reach / distance, y * reach / distance, 0.0, 0.0
    return (x, y, z), (vx, vy, vz)
