"""Materials: under one name, the properties of a surface for every modality."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.scene.elements.document import PluginPart
from itouch.schema.fields import child, children, name, plugin_parts, quantity, ref


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
class Materials:
    """A list of materials."""

    TAG: ClassVar[str] = "materials"
    materials: tuple[Material, ...] = children(Material)
