"""Channels: the named vectors that a device reads or obeys, and the standard vocabulary of them."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

#: Components of a pose (position, quaternion w x y z) and of a wrench (force, torque).
POSE_SIZE, TWIST_SIZE, WRENCH_SIZE = 7, 6, 6
#: Rotational components, in the numbering of a wrench or twist.
ROTATIONS = (3, 4, 5)


class Safe(enum.Enum):
    """What a command channel does when its device must be safe and a fixed value would not be."""

    HOLD = "hold"
    RETRACT = "retract"


HOLD, RETRACT = Safe.HOLD, Safe.RETRACT


@dataclass(frozen=True, slots=True)
class Channel:
    """A named vector that a device reads or obeys, in SI units.

    Attributes
    ----------
    name, size, unit
        ``size`` numbers in ``unit``.
    low, high
        Commands: the ceiling of the hardware; readings: outside means a trip.  Empty, or ``size`` numbers; given
        one of the two, the other is endless.
    magnitude
        Greatest length of the linear part (the first three components) of a wrench; scaled with its direction kept.
    slew
        Greatest change a second, ``size`` numbers; for a pose target the first three are its speed.
    safe
        A value, HOLD or RETRACT; a command channel must state it (zero is safe for a force, not for a pose).
        RETRACT goes down to ``low[2]``.
    locked
        Degrees of freedom, numbered 0..5 as in a wrench, that the mechanism cannot move or exert.
    """

    name: str
    size: int
    unit: str
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    magnitude: float | None = None
    slew: tuple[float, ...] = ()
    safe: tuple[float, ...] | Safe | None = None
    locked: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.name.replace("_", "").isalnum():
            raise ValueError(f"channel name '{self.name}' must consist of letters, digits and '_'")
        if self.size < 1:
            raise ValueError(f"channel '{self.name}' must have at least one component, not {self.size}")
        for label in ("low", "high", "slew"):
            length = len(getattr(self, label))
            if length not in (0, self.size):
                raise ValueError(f"channel '{self.name}': {label} has {length} numbers, it needs {self.size} or none")
        if bool(self.low) != bool(self.high):  # half-open: the other side is endless
            side, value = ("high", math.inf) if self.low else ("low", -math.inf)
            object.__setattr__(self, side, (value,) * self.size)
        if isinstance(self.safe, tuple) and len(self.safe) != self.size:
            raise ValueError(f"channel '{self.name}': safe has {len(self.safe)} numbers, it needs {self.size}")

    def with_locked(self, *locked: int) -> Channel:
        """Return the same channel with these degrees of freedom locked."""
        return replace(self, locked=tuple(sorted(set(locked))))


def pose(*, locked: tuple[int, ...] = ()) -> Channel:
    """Pose of the device's end in its own frame: position [m], quaternion w x y z; a reading."""
    return Channel("pose", POSE_SIZE, "m", locked=locked)


def twist(*, locked: tuple[int, ...] = ()) -> Channel:
    """Linear [m/s] and angular [rad/s] velocity; a reading."""
    return Channel("twist", TWIST_SIZE, "m/s", locked=locked)


def wrench(*, force: float, torque: float = 0.0, locked: tuple[int, ...] | None = None) -> Channel:
    """Wrench on the operator [N, N m], a command with its greatest force; without a torque the rotations are locked."""
    if force <= 0:
        raise ValueError(f"wrench: force = {force!r} must be more than 0 N")
    shut = (ROTATIONS if torque == 0.0 else ()) if locked is None else locked
    high = (force,) * 3 + (torque,) * 3
    low = tuple(-value for value in high)
    return Channel("wrench", WRENCH_SIZE, "N", low, high, magnitude=force, safe=(0.0,) * 6, locked=shut)


def measured_wrench(*, force: float = 1e3, locked: tuple[int, ...] = ()) -> Channel:
    """Wrench that the device feels [N, N m], a reading; beyond ``force`` it is not believed."""
    high = (force,) * 6
    return Channel("wrench", WRENCH_SIZE, "N", tuple(-value for value in high), high, locked=locked)


def pose_target(
    *,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    speed: float,
    safe: Safe = RETRACT,
    locked: tuple[int, ...] = ROTATIONS,
) -> Channel:
    """Pose that the device shall go to, a command: corners of its travel [m] and greatest speed [m/s]."""
    one = (1.0,) * 4
    slew = (speed,) * 3 + (float("inf"),) * 4
    return Channel(
        "pose_target", POSE_SIZE, "m", (*low, *(-v for v in one)), (*high, *one), slew=slew, safe=safe, locked=locked
    )


def temperature(name: str = "temperature", *, low: float = 263.15, high: float = 353.15) -> Channel:
    """Temperature [K], a reading; outside ``low``..``high`` the sensor is not believed."""
    return Channel(name, 1, "K", (low,), (high,))


def heat_flux(name: str = "heat_flux", *, full_scale: float = 1e5) -> Channel:
    """Heat flux out of the finger [W/m2], a reading."""
    return Channel(name, 1, "W/m^2", (-full_scale,), (full_scale,))


def current(name: str = "current", *, limit: float) -> Channel:
    """Electric current [A], a command; zero is safe."""
    if limit <= 0:
        raise ValueError(f"current: limit = {limit!r} must be more than 0 A")
    return Channel(name, 1, "A", (-limit,), (limit,), safe=(0.0,))
