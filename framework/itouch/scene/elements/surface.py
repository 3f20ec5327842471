"""Surface effects inside `<material>`: `<texture>`, `<layer>`, `<stick-slip>`, `<viscosity>`, `<magnetic>`, ...."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import children, choice, file, quantity


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
