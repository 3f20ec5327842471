"""Elements of objects that move: `<motion>` by a script or with a device, `<dynamics>` for rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import children, file, flag, quantity


@dataclass(frozen=True, slots=True)
class Key:
    """Where an object moves next, on a minimum-jerk path in a given time; there it stays for a while."""

    TAG: ClassVar[str] = "to"
    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("quat", "rpy"),)
    pos: tuple[float, ...] | None = quantity(
        "m", size=3, low=-100, high=100, default=None, doc="position of its origin in the world; default: as before"
    )
    quat: tuple[float, ...] | None = quantity(
        "", size=4, low=-1e3, high=1e3, default=None, doc="orientation w x y z; default: as before"
    )
    rpy: tuple[float, ...] | None = quantity(
        "rad", size=3, low=-100, high=100, default=None, doc="orientation about the fixed x, then y, then z axes"
    )
    in_: float = quantity("s", positive=True, high=3600, doc="duration of the movement")
    hold: float = quantity("s", low=0.0, high=3600, default=0.0, doc="how long it stays there")


@dataclass(frozen=True, slots=True)
class ObjectMotion:
    """How an object moves from its initial pose; the velocity of its surface is felt."""

    TAG: ClassVar[str] = "motion"
    file: str = file(
        default="", doc="table of t x y z, or t x y z qw qx qy qz, in SI: .csv (a header may name units), or .npy"
    )
    repeat: bool = flag(default=False, doc="whether it starts again; it must end where it starts")
    keys: tuple[Key, ...] = children(Key, doc="one after the other")


@dataclass(frozen=True, slots=True)
class Dynamics:
    """A free rigid body: the object falls, can be pushed and lifted, and presses on others (MuJoCo)."""

    TAG: ClassVar[str] = "dynamics"
    mass: float = quantity("kg", low=1e-3, high=100, doc="its mass")
    inertia: tuple[float, ...] | None = quantity(
        "kg*m^2", size=3, low=1e-12, high=1e3, default=None,
        doc="about its centre of mass, along its own x, y and z axes; default: that of its shape at even density",
    )  # fmt: skip
    friction: float | None = quantity(
        "",
        low=0.0,
        high=5.0,
        default=None,
        doc="coefficient of friction against other objects; default: the material's dynamic friction",
    )
    damping: float = quantity("1/s", low=0.0, high=100, default=0.1, doc="rate at which a free motion dies away")
