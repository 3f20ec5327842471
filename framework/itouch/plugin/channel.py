"""Channels: the named vectors that a device reads or obeys, and functions that make the standard ones."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from itouch.plugin.quantity import Quantity, Role

#: Components of a pose (position, quaternion w x y z) and of a wrench (force, torque).
POSE_SIZE, TWIST_SIZE, WRENCH_SIZE = 7, 6, 6
#: Rotational components, in the numbering of a wrench or twist.
ROTATIONS = (3, 4, 5)


class Safe(enum.Enum):
    """What a command does when its device must be made safe and no fixed value is safe."""

    HOLD = "hold"
    RETRACT = "retract"


HOLD, RETRACT = Safe.HOLD, Safe.RETRACT


@dataclass(frozen=True, slots=True)
class Channel(Quantity):
    """A named vector that a device reads or obeys, in SI units.

    Attributes
    ----------
    name, size, unit, doc, role, show
        ``size`` numbers in ``unit``, what they are and what they are for: see `Quantity`.
    low, high
        Of a command: the limits of the hardware; of a reading: a value outside is a trip.  Empty, or ``size`` numbers;
        if only one of the two is given, the other is infinite.
    magnitude
        Greatest length of the linear part (the first three components) of a wrench; a longer one is scaled down, and
        keeps its direction.
    slew
        Greatest change per second, ``size`` numbers; for a pose target the first three are its speed.
    safe
        A value, HOLD or RETRACT; a command channel must state it (zero is safe for a force, not for a pose).
        RETRACT moves down to ``low[2]``.  If it is left out or HOLD, a force, a drive and any other command that acts
        by its size become zero, or the value of their range nearest to zero; a temperature target goes to the middle of
        the limits, unless the device has an output switch.  A surface for which it is left out retracts.
    locked
        Degrees of freedom, numbered 0..5 as in a wrench, that the mechanism cannot move or exert.
    harmless
        Of a command: why this drive cannot hurt, a sentence that ``check`` and every safety report print.  It only
        silences the error that nothing watches its effect, never a monitor or a limit; it is refused for temperatures,
        electrodes and ultrasound.
    """

    size: int = 1
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    magnitude: float | None = None
    slew: tuple[float, ...] = ()
    safe: tuple[float, ...] | Safe | None = None
    locked: tuple[int, ...] = ()
    harmless: str = ""

    def __post_init__(self) -> None:
        if not self.name.replace("_", "").isalnum():
            raise ValueError(f"channel name '{self.name}' must consist of letters, digits and '_'")
        if self.size < 1:
            raise ValueError(f"channel '{self.name}' must have at least one component, not {self.size}")
        for label in ("low", "high", "slew"):
            length = len(getattr(self, label))
            if length not in (0, self.size):
                raise ValueError(f"channel '{self.name}': {label} has {length} numbers, it needs {self.size} or none")
        for label, numbers in (("low", self.low), ("high", self.high), ("slew", self.slew), ("safe", self.safe)):
            if isinstance(numbers, tuple) and not all(_is_number(value) for value in numbers):
                raise ValueError(f"channel '{self.name}': {label} = {numbers!r} must consist of numbers")
        if any(low > high for low, high in zip(self.low, self.high, strict=False)):
            raise ValueError(f"channel '{self.name}': low = {self.low!r} is above high = {self.high!r}")
        if any(change < 0.0 for change in self.slew):
            raise ValueError(f"channel '{self.name}': slew = {self.slew!r} is the size of a change, never below 0")
        if self.magnitude is not None and not (_is_number(self.magnitude) and self.magnitude >= 0.0):
            raise ValueError(f"channel '{self.name}': magnitude = {self.magnitude!r} must be a length, 0 or more")
        if not set(self.locked) <= set(range(WRENCH_SIZE)):
            raise ValueError(f"channel '{self.name}': locked = {self.locked!r} has numbers that are none of 0..5")
        if bool(self.low) != bool(self.high):  # half-open: the other side is infinite
            side, value = ("high", math.inf) if self.low else ("low", -math.inf)
            object.__setattr__(self, side, (value,) * self.size)
        if isinstance(self.safe, tuple) and len(self.safe) != self.size:
            raise ValueError(f"channel '{self.name}': safe has {len(self.safe)} numbers, it needs {self.size}")

    def with_locked(self, *locked: int) -> Channel:
        """Return the same channel with these degrees of freedom locked."""
        return replace(self, locked=tuple(sorted(set(locked))))


def _is_number(value: object) -> bool:
    """Tell whether a value is a number, infinity included; NaN is none, and no limit either."""
    return isinstance(value, int | float | np.integer | np.floating) and not math.isnan(value)


def of_role(channels: Iterable[Channel], role: Role, unit: str = "") -> Channel | None:
    """Return the first channel with a role, and with a unit if one is given; or None."""
    return next((one for one in channels if one.role is role and unit in ("", one.unit)), None)


def pose(*, locked: tuple[int, ...] = ()) -> Channel:
    """Pose of the device's end in its own frame: position [m], quaternion w x y z; a reading."""
    return Channel(
        "pose", POSE_SIZE, "m", locked=locked, role=Role.TRACKED_POSE, show="no",
        doc="pose of the device's end in its own frame: position, quaternion w x y z",
    )  # fmt: skip


def twist(*, locked: tuple[int, ...] = ()) -> Channel:
    """Linear [m/s] and angular [rad/s] velocity; a reading."""
    return Channel(
        "twist", TWIST_SIZE, "m/s", locked=locked, role=Role.TRACKED_TWIST, show="no",
        doc="linear and angular velocity of the device's end",
    )  # fmt: skip


def wrench(*, force: float, torque: float = 0.0, locked: tuple[int, ...] | None = None) -> Channel:
    """Wrench on the operator [N, N m], a command, with its greatest force and torque; torque 0 locks the rotations."""
    if not force > 0:
        raise ValueError(f"wrench: force = {force!r} must be more than 0 N")
    shut = (ROTATIONS if torque == 0.0 else ()) if locked is None else locked
    high = (force,) * 3 + (torque,) * 3
    low = tuple(-value for value in high)
    return Channel(
        "wrench", WRENCH_SIZE, "N", low, high, magnitude=force, safe=(0.0,) * 6, locked=shut,
        role=Role.FORCE_ON_OPERATOR, show="no", doc="force and torque on the operator",
    )  # fmt: skip


def measured_wrench(*, force: float = 1e3, locked: tuple[int, ...] = ()) -> Channel:
    """Wrench that the device measures [N, N m], a reading; beyond ``force`` it is not believed."""
    high = (force,) * 6
    return Channel(
        "wrench", WRENCH_SIZE, "N", tuple(-value for value in high), high, locked=locked,
        role=Role.CONTACT_FORCE, show="no", doc="force and torque that the device feels",
    )  # fmt: skip


def pose_target(
    *,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    speed: float,
    safe: Safe = RETRACT,
    locked: tuple[int, ...] = ROTATIONS,
) -> Channel:
    """Pose to which the device moves, a command: corners of its travel [m] and greatest speed [m/s]."""
    one = (1.0,) * 4
    slew = (speed,) * 3 + (float("inf"),) * 4
    return Channel(
        "pose_target", POSE_SIZE, "m", (*low, *(-v for v in one)), (*high, *one), slew=slew, safe=safe, locked=locked,
        role=Role.SURFACE_POSE, show="no", doc="where the device shall bring its surface: position, quaternion w x y z",
    )  # fmt: skip


_TEMPERATURES = {
    Role.SKIN_CONTACT_TEMPERATURE: "temperature of what the skin touches",
    Role.SKIN_TEMPERATURE: "temperature of the skin",
    Role.HEAT_SINK_TEMPERATURE: "temperature of the heat sink",
    Role.OTHER_TEMPERATURE: "temperature of something that nobody touches",
}


def temperature(
    name: str = "temperature", role: Role | None = None, *, low: float = 263.15, high: float = 353.15, doc: str = ""
) -> Channel:
    """Temperature [K], a reading; outside ``low``..``high`` the sensor is not believed.

    Parameters
    ----------
    name
        Any name.
    role
        What is measured: ``Role.SKIN_CONTACT_TEMPERATURE`` for whatever a finger can touch, ``SKIN_TEMPERATURE``,
        ``HEAT_SINK_TEMPERATURE`` or ``OTHER_TEMPERATURE``.  There is no default, because a plate that is taken for
        something else would not be supervised.
    low, high
        Range in which the sensor is believed [K].
    doc
        One sentence; by default it describes the role.

    Raises
    ------
    ValueError
        If the role is not that of a temperature.
    """
    if role is None or role not in _TEMPERATURES:
        known = ", ".join(f"Role.{known.name}" for known in _TEMPERATURES)
        given = "" if role is None else f", not {role}"
        raise ValueError(f"temperature '{name}': say what is measured by one of {known}{given}")
    show = "no" if role is Role.HEAT_SINK_TEMPERATURE else ""  # it would hide what the skin feels
    return Channel(name, 1, "K", (low,), (high,), role=role, doc=doc or _TEMPERATURES[role], show=show)


def plate_temperature(name: str = "plate_temperature", *, low: float = 263.15, high: float = 353.15) -> Channel:
    """Temperature of the body that the skin touches [K], a reading."""
    return temperature(name, Role.SKIN_CONTACT_TEMPERATURE, low=low, high=high)


def skin_temperature(name: str = "skin_temperature", *, low: float = 263.15, high: float = 353.15) -> Channel:
    """Temperature of the skin [K], measured without touching it, a reading."""
    return temperature(name, Role.SKIN_TEMPERATURE, low=low, high=high)


def sink_temperature(name: str = "sink_temperature", *, low: float = 263.15, high: float = 353.15) -> Channel:
    """Temperature of the heat sink behind a thermal drive [K], a reading."""
    return temperature(name, Role.HEAT_SINK_TEMPERATURE, low=low, high=high)


def heat_flux(name: str = "heat_flux", *, full_scale: float = 1e5) -> Channel:
    """Heat flux out of the finger [W/m2], a reading."""
    return Channel(
        name, 1, "W/m^2", (-full_scale,), (full_scale,), role=Role.HEAT_FLUX,
        show="heat flux out of the finger", doc="heat flux out of the finger through the surface that it touches",
    )  # fmt: skip


def current(name: str = "current", *, limit: float, harmless: str = "") -> Channel:
    """Electric current [A], a command; zero is safe.

    If it heats and cools a plate, a positive current cools.  ``harmless``: why nothing needs to watch its effect.
    """
    if not limit > 0:
        raise ValueError(f"current: limit = {limit!r} must be more than 0 A")
    return Channel(
        name, 1, "A", (-limit,), (limit,), safe=(0.0,), role=Role.DRIVE, doc="electric current of the drive",
        harmless=harmless,
    )  # fmt: skip


def temperature_target(
    name: str = "temperature_target", *, low: float = 288.15, high: float = 313.15, safe: float | Safe = HOLD
) -> Channel:
    """Temperature [K] to which the device brings its surface by its own control loop, a command."""
    value = safe if isinstance(safe, Safe) else (safe,)
    return Channel(
        name, 1, "K", (low,), (high,), safe=value, role=Role.TEMPERATURE_TARGET, show="wish:",
        doc="temperature that the device shall bring its surface to",
    )  # fmt: skip


def deadman(name: str = "deadman") -> Channel:
    """Dead-man's switch, a reading: not 0 while a person holds it."""
    return Channel(name, 1, "1", role=Role.DEADMAN, show="no", doc="1 while a person holds the switch")
