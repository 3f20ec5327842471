"""Elements `<world>` with the room's temperature, and its objects: `<box>`, `<sphere>`, `<plane>`, ..., `<mesh>`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.scene.elements.motion import Dynamics, ObjectMotion
from itouch.schema.fields import child, children, choice, file, name, quantity, ref, temperature
from itouch.schema.roles import Role

POS = "position of its origin in the world"
QUAT = "orientation as a quaternion w x y z"
RPY = "orientation as rotations about the fixed x, then y, then z axes"


@dataclass(frozen=True, slots=True)
class _Placed:
    """What every object has."""

    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("quat", "rpy"),)
    name: str = name()
    pos: tuple[float, float, float] = quantity("m", size=3, low=-100, high=100, default=(0.0, 0.0, 0.0), doc=POS)
    quat: tuple[float, ...] | None = quantity("", size=4, low=-1e3, high=1e3, default=None, doc=QUAT)
    rpy: tuple[float, ...] | None = quantity("rad", size=3, low=-100, high=100, default=None, doc=RPY)
    material: str = ref("material", doc="what it is made of")
    temperature: float | None = temperature(
        low=173.15, high=673.15, default=None, doc="its temperature; default: the room's"
    )
    pose_from: str = ref(
        "device",
        reads=(Role.TRACKED_POSE,),
        default="",
        doc="the device that carries it; pos and quat are then in what it carries",
    )
    motion: ObjectMotion | None = child(ObjectMotion)
    dynamics: Dynamics | None = child(Dynamics)


@dataclass(frozen=True, slots=True)
class Box(_Placed):
    """A box centred on its origin."""

    TAG: ClassVar[str] = "box"
    size: tuple[float, float, float] = quantity("m", size=3, low=1e-5, high=100, doc="full lengths of its edges")


@dataclass(frozen=True, slots=True)
class Sphere(_Placed):
    """A ball centred on its origin."""

    TAG: ClassVar[str] = "sphere"
    radius: float = quantity("m", low=1e-5, high=100, doc="its radius")


@dataclass(frozen=True, slots=True)
class Plane(_Placed):
    """An infinite plane through its origin; its own z axis points out of the solid."""

    TAG: ClassVar[str] = "plane"


@dataclass(frozen=True, slots=True)
class Capsule(_Placed):
    """A cylinder along its own z axis with round ends, centred on its origin."""

    TAG: ClassVar[str] = "capsule"
    radius: float = quantity("m", low=1e-5, high=100, doc="its radius")
    length: float = quantity("m", low=1e-5, high=100, doc="distance between the centres of its ends")


@dataclass(frozen=True, slots=True)
class Cylinder(_Placed):
    """A cylinder along its own z axis with flat ends, centred on its origin."""

    TAG: ClassVar[str] = "cylinder"
    radius: float = quantity("m", low=1e-5, high=100, doc="its radius")
    length: float = quantity("m", low=1e-5, high=100, doc="distance between its ends")


@dataclass(frozen=True, slots=True)
class Mesh(_Placed):
    """A triangle mesh from a file, about the file's origin."""

    TAG: ClassVar[str] = "mesh"
    file: str = file(doc="its file, relative to this one: STL, OBJ, PLY, GLB, glTF or OFF")
    scale: float = quantity(
        "m", positive=True, high=1e4, default=1.0, doc="length of one unit of the file, such as `1 mm`, or a factor"
    )
    sides: str = choice(
        "one", "two", default="one", doc="whether it is touched from the front only, or from both sides"
    )


#: The kinds of object that a world may contain.
OBJECTS: tuple[type, ...] = (Box, Sphere, Plane, Capsule, Cylinder, Mesh)


@dataclass(frozen=True, slots=True)
class WorldElement:
    """The virtual objects, and the room that they are in."""

    TAG: ClassVar[str] = "world"
    temperature: float = temperature(low=253.15, high=323.15, default=296.15, doc="temperature of the room")
    gravity: tuple[float, float, float] = quantity(
        "m/s^2", size=3, low=-100, high=100, default=(0.0, 0.0, -9.81), doc="acceleration of what falls freely"
    )
    objects: tuple[Any, ...] = children(OBJECTS, doc="what can be touched")
