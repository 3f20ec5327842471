"""Elements `<materials>`, `<material>`, `<contact>`, `<visual>` and effects: what a surface is for touch and sight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.scene.elements.include import PluginPart
from itouch.scene.elements.sound import Sound
from itouch.schema.fields import ParameterError, child, children, choice, file, flag, name, plugin_parts, quantity, ref


@dataclass(frozen=True, slots=True)
class Texture:
    """A height map carved into the surface; it repeats, and needs no texture coordinates."""

    TAG: ClassVar[str] = "texture"
    file: str = file(doc="its PNG, PGM or .npy file, relative to this one; white is high")
    depth: float = quantity("m", low=1e-6, high=5e-3, default=2e-4, doc="how deep black is carved")
    width: float = quantity("m", low=1e-4, high=10.0, default=0.02, doc="width of the map on the surface")
    projection: str = choice(
        "triplanar",
        "x",
        "y",
        "z",
        default="triplanar",
        doc="axis of the object along which it is projected; triplanar: all three",
    )


@dataclass(frozen=True, slots=True)
class Layer:
    """A soft layer below the surface."""

    TAG: ClassVar[str] = "layer"
    thickness: float = quantity("m", low=1e-5, high=0.05, doc="how thick it is")
    stiffness: float = quantity("N/m", positive=True, high=1e6, doc="its stiffness; at most that of <contact>")


@dataclass(frozen=True, slots=True)
class Softness:
    """Soft layers over the stiffness of ``<contact>``, the outermost first: a force that grows piecewise with depth."""

    TAG: ClassVar[str] = "softness"
    layers: tuple[Layer, ...] = children(Layer, doc="from the outside in")


@dataclass(frozen=True, slots=True)
class StickSlip:
    """A spring along the surface that holds the finger up to a force, lets go, and takes hold again."""

    TAG: ClassVar[str] = "stick-slip"
    stiffness: float = quantity("N/m", positive=True, high=2e3, default=300.0, doc="stiffness of the spring")
    force: float = quantity(
        "N", positive=True, high=3.0, doc="force at which it lets go; never more than the normal force"
    )


@dataclass(frozen=True, slots=True)
class Viscosity:
    """Drag in proportion to the speed along the surface."""

    TAG: ClassVar[str] = "viscosity"
    damping: float = quantity("N*s/m", positive=True, high=20.0, doc="force over speed")


@dataclass(frozen=True, slots=True)
class Magnetic:
    """Attraction towards the surface, which falls smoothly to zero at the end of its range."""

    TAG: ClassVar[str] = "magnetic"
    force: float = quantity("N", positive=True, high=3.0, doc="force at the surface")
    range: float = quantity("m", low=1e-4, high=0.2, default=0.01, doc="how far it reaches; at most the probe's `near`")


@dataclass(frozen=True, slots=True)
class Vibration:
    """Vibration along the normal while touched: a steady one, and one that a tap starts."""

    TAG: ClassVar[str] = "vibration"
    amplitude: float = quantity("N", low=0.0, high=1.0, default=0.0, doc="amplitude of the steady vibration")
    frequency: float = quantity("Hz", low=1.0, high=500.0, default=100.0, doc="frequency of the steady vibration")
    tap: float = quantity(
        "N*s/m", low=0.0, high=20.0, default=0.0, doc="amplitude of the vibration after a tap, over the speed of impact"
    )
    tap_frequency: float = quantity("Hz", low=1.0, high=500.0, default=250.0, doc="after a tap")
    tap_decay: float = quantity("s", low=1e-3, high=1.0, default=0.02, doc="time constant after a tap")

    def __post_init__(self) -> None:
        if self.amplitude == 0.0 and self.tap == 0.0:
            raise ValueError("it has neither amplitude nor tap")


@dataclass(frozen=True, slots=True)
class ContactMaterial:
    """How a surface resists the finger."""

    TAG: ClassVar[str] = "contact"
    stiffness: float = quantity("N/m", positive=True, high=1e6, doc="stiffness of the virtual coupling")
    damping: float = quantity("N*s/m", low=0.0, high=1e4, default=0.0, doc="damping of the virtual coupling")
    static_friction: float = quantity("", low=0.0, high=5.0, default=0.0, doc="coefficient of static friction")
    dynamic_friction: float = quantity("", low=0.0, high=5.0, default=0.0, doc="coefficient of dynamic friction")
    shading: bool = flag(default=False, doc="whether meshes of it feel smooth: force turned to the vertex normals")

    def __post_init__(self) -> None:
        if self.dynamic_friction > self.static_friction:
            static, dynamic = self.static_friction, self.dynamic_friction
            sentence = f"dynamic-friction {dynamic:g} is above static-friction {static:g}"
            raise ParameterError(
                "dynamic_friction", sentence, "what slides is held by less than what sticks: swap them"
            )


@dataclass(frozen=True, slots=True)
class Visual:
    """How a surface looks."""

    TAG: ClassVar[str] = "visual"
    color: tuple[float, float, float] = quantity("", size=3, low=0.0, high=1.0, doc="red, green and blue, 0 to 1")
    finish: str = choice(
        "matte", "metal", "glass", "wood", "foam", default="matte",
        doc="how it reflects light in the window; nothing that is felt or measured depends on it",
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Material:
    """A material: its properties for every modality, under one name."""

    TAG: ClassVar[str] = "material"
    name: str = name()
    base: str = ref("material", default="", doc="material whose properties hold where this one says nothing")
    contact: ContactMaterial | None = child(ContactMaterial)
    texture: Texture | None = child(Texture)
    softness: Softness | None = child(Softness)
    stick_slip: StickSlip | None = child(StickSlip)
    viscosity: Viscosity | None = child(Viscosity)
    magnetic: Magnetic | None = child(Magnetic)
    vibration: Vibration | None = child(Vibration)
    visual: Visual | None = child(Visual)
    sound: Sound | None = child(Sound)
    parts: tuple[PluginPart, ...] = plugin_parts(doc="properties for plugins, <PLUGIN:material>")

    def __post_init__(self) -> None:
        if self.softness is None or self.contact is None or not self.softness.layers:
            return
        stiffest = max(layer.stiffness for layer in self.softness.layers)
        if stiffest > self.contact.stiffness:
            core = self.contact.stiffness
            sentence = f"a layer's stiffness, {stiffest:g} N/m, is above that of <contact>, {core:g} N/m"
            advice = f"give the layer {core:g} N/m at most, or <contact> more"
            raise ParameterError("softness", sentence, advice)


@dataclass(frozen=True, slots=True)
class Materials:
    """A list of materials."""

    TAG: ClassVar[str] = "materials"
    materials: tuple[Material, ...] = children(Material)
