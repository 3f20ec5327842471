"""Elements `<interaction>`, `<probe>` (stiffness, clearance, plate angle) and `<operator>` with its motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.scene.elements.include import PluginPart
from itouch.schema.fields import child, children, file, hold, name, plugin_parts, quantity, ref, temperature, text
from itouch.schema.hold_until import Until
from itouch.schema.roles import Role


@dataclass(frozen=True, slots=True)
class Probe:
    """What touches: a finger of a given radius bound to devices."""

    TAG: ClassVar[str] = "probe"
    REQUIRES: ClassVar[tuple[tuple[str, str], ...]] = (("carrier", "surface_to"),)
    name: str = name()
    radius: float = quantity("m", low=0.0, high=0.1, default=0.008, doc="radius of the fingertip; 0 is a point")
    pose_from: str = ref("device", reads=(Role.TRACKED_POSE,), doc="the device that tracks it")
    force_to: str = ref(
        "device", commands=(Role.FORCE_ON_OPERATOR,), default="", doc="the device that gives it contact forces"
    )
    surface_to: str = ref(
        "device",
        reads=(Role.TRACKED_POSE,),
        commands=(Role.SURFACE_POSE,),
        default="",
        doc="the table that carries surfaces to it",
    )
    carrier: str = text(
        default="",
        doc="what brings the surface to it where no modality of the scene does: a name of the entry-point group "
        "itouch.carriers; default: the encountered surface that comes with the program",
    )
    clearance: float = quantity(
        "m", low=1e-3, high=0.05, default=0.005, doc="distance that the plate keeps below the surfaces in free space"
    )
    plate_angle: float = quantity(
        "rad",
        low=0.0,
        high=1.0,
        default=0.4363323129985824,
        doc="steepest surface, against the plate, that the plate still renders",
    )
    near: float = quantity(
        "m", low=1e-3, high=1.0, default=0.05, doc="distance at which an object counts as approached"
    )
    hand_damping: float = quantity(
        "N*s/m",
        low=0.0,
        high=50,
        default=5.0,
        doc="damping that the hand can be relied on to add, for the stability of the virtual coupling",
    )
    modulus: float = quantity(
        "Pa", low=1e3, high=1e12, default=5e4, doc="effective modulus of the fingertip, for the area of contact (Hertz)"
    )


@dataclass(frozen=True, slots=True)
class To:
    """A target of the hand, reached on a minimum-jerk path in a given time; there it stays, or waits for its skin."""

    TAG: ClassVar[str] = "to"
    pos: tuple[float, float, float] = quantity("m", size=3, low=-10, high=10, doc="target of the fingertip's centre")
    in_: float = quantity("s", positive=True, high=3600, doc="duration of the movement")
    hold: float | Until = hold(
        high=3600,
        default=0.0,
        doc="how long it stays there; or how near the skin must come to its temperature at the session's start before "
        "the hand goes on, after 60 s at the latest",
    )


@dataclass(frozen=True, slots=True)
class Motion:
    """How the operator's hand moves: from target to target, starting at the first one, or as it was recorded."""

    TAG: ClassVar[str] = "motion"
    REQUIRES: ClassVar[tuple[tuple[str, str], ...]] = (("recorded_probe", "file"),)
    file: str = file(default="", doc="a recording (.mcap): the hand goes where the finger was")
    recorded_probe: str = text(default="", doc="the probe of the recording; default: the one of this operator's name")
    targets: tuple[To, ...] = children(To, doc="one after the other")

    def __post_init__(self) -> None:
        if self.file and self.targets:
            raise ValueError("a recorded motion has no targets of its own: give file, or <to>")


@dataclass(frozen=True, slots=True)
class Operator:
    """The operator's twin: a fingertip mass on a hand spring that follows a motion."""

    TAG: ClassVar[str] = "operator"
    probe: str = ref("probe", doc="the probe that it moves")
    mass: float = quantity("kg", low=1e-3, high=10, default=0.08, doc="moving mass of finger and hand")
    stiffness: float = quantity("N/m", low=1.0, high=1e5, default=300.0, doc="stiffness of the hand")
    damping: float = quantity("N*s/m", low=0.0, high=1e3, default=6.0, doc="damping of the hand")
    skin_temperature: float = temperature(
        low=283.15, high=313.15, default=306.15, doc="skin temperature of the fingertip at the start"
    )
    pad_stiffness: float = quantity(
        "N/m", low=10, high=1e5, default=1000.0, doc="stiffness of the finger pad against the plate"
    )
    pad_damping: float = quantity(
        "N*s/m", low=0.0, high=100, default=2.0, doc="damping of the finger pad against the plate"
    )
    motion: Motion = child(Motion, default=Motion())


@dataclass(frozen=True, slots=True)
class Interaction:
    """What touches, who moves it, and the modalities of plugins."""

    TAG: ClassVar[str] = "interaction"
    probes: tuple[Probe, ...] = children(Probe)
    operators: tuple[Operator, ...] = children(Operator)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="modalities, <PLUGIN:MODALITY>")
