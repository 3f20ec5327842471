"""The operator's hand on the virtual arm: a spring and damper that lead the grip along a path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from itouch_usb_arm.kinematics import CENTRE, Vector

#: A path: time [s] to position [m].
Path = Callable[[float], Sequence[float]]


class Pusher(Protocol):
    """Anything that pushes the grip."""

    def force(self, now: float, position: Vector, velocity: Vector) -> Vector:
        """Return its force on the grip [N]."""
        ...


@dataclass(frozen=True, slots=True)
class Rest:
    """A path that stays at one place [m]."""

    place: Vector = CENTRE

    def __call__(self, now: float) -> Vector:
        """Return the place."""
        return self.place


@dataclass(slots=True)
class Hand:
    """A hand with stiffness [N/m] and damping [N s/m] that follows a path; ``pull``, a position [m], overrides it."""

    path: Path = field(default_factory=Rest)
    stiffness: float = 300.0
    damping: float = 6.0
    pull: Vector | None = None

    def force(self, now: float, position: Vector, velocity: Vector) -> Vector:
        """Return the hand's force on the grip [N]."""
        x, y, z = self.pull if self.pull is not None else self.path(now)
        px, py, pz = position
        vx, vy, vz = velocity
        k, d = self.stiffness, self.damping
        return (k * (x - px) - d * vx, k * (y - py) - d * vy, k * (z - pz) - d * vz)
