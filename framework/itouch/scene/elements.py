"""The scene language: frozen descriptions in SI, one class an element; the fields are the grammar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from itouch.schema.fields import (
    Spec,
    child,
    children,
    choice,
    flag,
    integer,
    name,
    plugin_parts,
    quantity,
    ref,
    temperature,
    text,
)

#: Format version that this program writes, and the newest that it reads.
VERSION = "1.0"

_POS = "position of its origin in the world"
_QUAT = "orientation as a quaternion w x y z"
_RPY = "orientation as rotations about the fixed x, then y, then z axes"


@dataclass(frozen=True, slots=True)
class PluginPart:
    """An element of a plugin's namespace: ``<plugin:local>`` with the plugin's own parameters.

    ``name`` is that of a modality (default: the local name), empty elsewhere.
    """

    plugin: str
    local: str
    params: Any
    name: str = ""


@dataclass(frozen=True, slots=True)
class Include:
    """Another complete scene document whose content joins this one."""

    TAG: ClassVar[str] = "include"
    file: str = text(doc="path relative to this file, inside the scene's folder")
    prefix: str = text(default="", doc="put before every name that the included file defines")


@dataclass(frozen=True, slots=True)
class ContactMaterial:
    """How a surface resists the finger."""

    TAG: ClassVar[str] = "contact"
    stiffness: float = quantity("N/m", positive=True, high=1e6, doc="stiffness of the virtual coupling")
    damping: float = quantity("N*s/m", low=0.0, high=1e4, default=0.0, doc="damping of the virtual coupling")
    static_friction: float = quantity("", low=0.0, high=5.0, default=0.0, doc="coefficient of static friction")
    dynamic_friction: float = quantity("", low=0.0, high=5.0, default=0.0, doc="coefficient of dynamic friction")

    def __post_init__(self) -> None:
        if self.dynamic_friction > self.static_friction:
            static, dynamic = self.static_friction, self.dynamic_friction
            raise ValueError(f"dynamic-friction {dynamic:g} is above static-friction {static:g}")


@dataclass(frozen=True, slots=True)
class Visual:
    """How a surface looks."""

    TAG: ClassVar[str] = "visual"
    color: tuple[float, float, float] = quantity("", size=3, low=0.0, high=1.0, doc="red, green and blue, 0 to 1")


@dataclass(frozen=True, slots=True)
class Material:
    """A name under which the properties of every modality are kept."""

    TAG: ClassVar[str] = "material"
    name: str = name()
    base: str = ref("material", default="", doc="material whose properties hold where this one says nothing")
    contact: ContactMaterial | None = child(ContactMaterial)
    visual: Visual | None = child(Visual)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="properties for plugins, <PLUGIN:material>")


@dataclass(frozen=True, slots=True)
class _Placed:
    """What every object has."""

    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("quat", "rpy"),)
    name: str = name()
    pos: tuple[float, float, float] = quantity("m", size=3, low=-100, high=100, default=(0.0, 0.0, 0.0), doc=_POS)
    quat: tuple[float, ...] | None = quantity("", size=4, low=-1e3, high=1e3, default=None, doc=_QUAT)
    rpy: tuple[float, ...] | None = quantity("rad", size=3, low=-100, high=100, default=None, doc=_RPY)
    material: str = ref("material", doc="what it is made of")
    temperature: float | None = temperature(
        low=173.15, high=673.15, default=None, doc="its temperature; default: the room's"
    )


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
    """An endless plane through its origin; its own z axis points out of the solid."""

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


#: The kinds of object that may stand in a world.
OBJECTS: tuple[type, ...] = (Box, Sphere, Plane, Capsule, Cylinder)


@dataclass(frozen=True, slots=True)
class WorldElement:
    """The virtual objects, and the room they stand in."""

    TAG: ClassVar[str] = "world"
    temperature: float = temperature(low=253.15, high=323.15, default=296.15, doc="temperature of the room")
    objects: tuple[Any, ...] = children(OBJECTS, doc="what can be touched")


@dataclass(frozen=True, slots=True)
class Mount:
    """Where a device stands: its frame in the world, or in the frame of the device that carries it."""

    TAG: ClassVar[str] = "mount"
    EXCLUSIVE: ClassVar[tuple[tuple[str, ...], ...]] = (("quat", "rpy"),)
    on: str = ref("device", default="", doc="the device that carries it")
    pos: tuple[float, float, float] = quantity("m", size=3, low=-10, high=10, default=(0.0, 0.0, 0.0), doc=_POS)
    quat: tuple[float, ...] | None = quantity("", size=4, low=-1e3, high=1e3, default=None, doc=_QUAT)
    rpy: tuple[float, ...] | None = quantity("rad", size=3, low=-100, high=100, default=None, doc=_RPY)
    mount_error: tuple[float, float, float] = quantity(
        "m", size=3, low=-0.05, high=0.05, default=(0.0, 0.0, 0.0),
        doc="twin only: how far the true mount is from what is written here",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one device; they may only be tighter than the defaults and the device's own."""

    TAG: ClassVar[str] = "limits"
    force: float | None = quantity("N", positive=True, default=None, doc="greatest force on the operator")
    speed: float | None = quantity("m/s", positive=True, default=None, doc="greatest speed")
    current: float | None = quantity("A", positive=True, default=None, doc="greatest current")
    temperature: tuple[float, float] | None = temperature(
        size=2, low=200, high=400, default=None, doc="lowest and highest commanded plate temperature"
    )


@dataclass(frozen=True, slots=True)
class Calibration:
    """How the device's mount is found at start."""

    TAG: ClassVar[str] = "calibration"
    method: str = choice("touch-off", "none", default="touch-off", doc="touch-off: the plate rises until it is felt")
    points: int = integer(low=3, high=9, default=3, doc="how many points of the plate are touched")
    stored_in: str = text(
        default="", doc="file with an earlier result; it only seeds the mount until the next touch-off"
    )


@dataclass(frozen=True, slots=True)
class DeviceElement:
    """A device: the plugin that drives it, where it stands, its limits."""

    TAG: ClassVar[str] = "device"
    name: str = name()
    plugin: str = text(doc="the device plugin's name; `itouch-py devices` lists them")
    optional: bool = flag(default=False, doc="whether the session may go on without it")
    twin: bool = flag(default=True, doc="whether its simulated twin runs instead of the hardware")
    mount: Mount = child(Mount, default=Mount())
    limits: Limits = child(Limits, default=Limits())
    calibration: Calibration | None = child(Calibration)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="the plugin's parameters, <PLUGIN:hardware>")


@dataclass(frozen=True, slots=True)
class Probe:
    """What touches: a finger of a given radius bound to devices."""

    TAG: ClassVar[str] = "probe"
    name: str = name()
    radius: float = quantity("m", low=0.0, high=0.1, default=0.008, doc="radius of the fingertip; 0 is a point")
    pose_from: str = ref("device", reads=("pose",), doc="the device that tracks it")
    force_to: str = ref("device", commands=("wrench",), default="", doc="the device that gives it contact forces")
    surface_to: str = ref(
        "device", reads=("pose",), commands=("pose_target",), default="", doc="the table that carries surfaces to it"
    )
    clearance: float = quantity(
        "m", low=1e-3, high=0.05, default=0.005, doc="how far the plate stays below in free space"
    )
    plate_angle: float = quantity(
        "rad",
        low=0.0,
        high=1.0,
        default=0.4363323129985824,
        doc="greatest angle between surface and plate that the plate renders",
    )
    near: float = quantity(
        "m", low=1e-3, high=1.0, default=0.05, doc="distance at which an object counts as approached"
    )
    hand_damping: float = quantity(
        "N*s/m", low=0.0, high=50, default=5.0, doc="damping that the hand is counted on for"
    )


@dataclass(frozen=True, slots=True)
class To:
    """A target of the hand: go there in a time, on a minimum-jerk path, then hold."""

    TAG: ClassVar[str] = "to"
    pos: tuple[float, float, float] = quantity("m", size=3, low=-10, high=10, doc="target of the fingertip's centre")
    in_: float = quantity("s", positive=True, high=3600, doc="duration of the movement")
    hold: float = quantity("s", low=0.0, high=3600, default=0.0, doc="how long to stay there")


@dataclass(frozen=True, slots=True)
class Motion:
    """What the operator's hand does; the first target is where it starts."""

    TAG: ClassVar[str] = "motion"
    targets: tuple[To, ...] = children(To, doc="one after the other")


@dataclass(frozen=True, slots=True)
class Operator:
    """The operator's twin: a fingertip mass on a hand spring that follows a motion."""

    TAG: ClassVar[str] = "operator"
    probe: str = ref("probe", doc="the probe that it moves")
    mass: float = quantity("kg", low=1e-3, high=10, default=0.08, doc="moving mass of finger and hand")
    stiffness: float = quantity("N/m", low=1.0, high=1e5, default=300.0, doc="stiffness of the hand")
    damping: float = quantity("N*s/m", low=0.0, high=1e3, default=6.0, doc="damping of the hand")
    skin_temperature: float = temperature(low=283.15, high=313.15, default=306.15, doc="of the fingertip at start")
    pad_stiffness: float = quantity("N/m", low=10, high=1e5, default=1000.0, doc="of the finger pad against the plate")
    pad_damping: float = quantity("N*s/m", low=0.0, high=100, default=2.0, doc="of the finger pad against the plate")
    motion: Motion = child(Motion, default=Motion())


@dataclass(frozen=True, slots=True)
class Interaction:
    """What touches, who moves it, and the modalities of plugins."""

    TAG: ClassVar[str] = "interaction"
    probes: tuple[Probe, ...] = children(Probe)
    operators: tuple[Operator, ...] = children(Operator)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="modalities, <PLUGIN:MODALITY>")


@dataclass(frozen=True, slots=True)
class Rates:
    """Rates of the servo loop and, by name, of modalities; each must divide the servo rate."""

    TAG: ClassVar[str] = "rates"
    OPEN: ClassVar[str] = "modalities"
    OPEN_SPEC: ClassVar[Spec] = Spec("quantity", "rate of a modality", "Hz", low=1e-3, high=4000)
    servo: float = quantity("Hz", low=100, high=4000, default=1000.0, doc="rate of the servo loop")
    modalities: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Safety:
    """Limits for the whole scene; they may only be tighter than the defaults."""

    TAG: ClassVar[str] = "safety"
    force: float | None = quantity("N", positive=True, default=None, doc="greatest force of any device on the operator")
    speed: float | None = quantity("m/s", positive=True, default=None, doc="greatest speed of any carried surface")
    temperature: tuple[float, float] | None = temperature(
        size=2, low=200, high=400, default=None, doc="lowest and highest plate temperature"
    )
    servo_overrun: str = choice("stop", "warn", default="warn", doc="what happens when the loop falls behind real time")
    watchdog: float | None = quantity("s", positive=True, default=None, doc="greatest age of a device's reading")


@dataclass(frozen=True, slots=True)
class Materials:
    """A list of materials."""

    TAG: ClassVar[str] = "materials"
    materials: tuple[Material, ...] = children(Material)


@dataclass(frozen=True, slots=True)
class Devices:
    """A list of devices: a rig."""

    TAG: ClassVar[str] = "devices"
    devices: tuple[DeviceElement, ...] = children(DeviceElement)
