"""Elements `<materials>`, `<material>`, `<contact>` and `<visual>`: what a surface is for touch and sight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.scene.elements.document import PluginPart
from itouch.scene.elements.sound import Sound
from itouch.scene.elements.surface import Magnetic, Softness, StickSlip, Texture, Vibration, Viscosity
from itouch.schema.fields import child, children, choice, flag, name, plugin_parts, quantity, ref


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
            raise ValueError(f"dynamic-friction {dynamic:g} is above static-friction {static:g}")


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
            raise ValueError(f"a layer's stiffness, {stiffest:g} N/m, is above that of <contact>, {core:g} N/m")


@dataclass(frozen=True, slots=True)
class Materials:
    """A list of materials."""

    TAG: ClassVar[str] = "materials"
    materials: tuple[Material, ...] = children(Material)
