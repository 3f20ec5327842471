"""Classes that describe a side of a contact: layers, back, initial state, film, probes.

The same classes define the XML grammar, the Python interface and the case file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from contact_heat import declared

SideName = Literal["finger", "object"]

#: Greatest number of layers of a side.
MOST_LAYERS = 16

#: Default film on the bare finger between touches [W/m2K], and default temperature of the room [K].
FINGER_FILM = 10.0
ROOM = 296.15


@dataclass(frozen=True, slots=True)
class Layer:
    """One homogeneous layer of tissue or material."""

    TAG: ClassVar[str] = "layer"

    name: str = declared.text(default="", doc="what it is")
    thickness: float | None = declared.quantity(
        "m",
        low=1e-9,
        high=100.0,
        default=None,
        doc="thickness; without it semi-infinite, which only the last layer of what is touched may be",
    )
    conductivity: float = declared.quantity("W/(m*K)", low=1e-4, high=1e4, doc="thermal conductivity")
    density: float = declared.quantity("kg/m^3", low=1e-2, high=3e4, doc="density")
    specific_heat: float = declared.quantity("J/(kg*K)", low=1.0, high=2e4, doc="specific heat")
    perfusion: float = declared.quantity(
        "W/(m^3*K)", low=0.0, high=1e7, default=0.0, doc="blood mass flow per volume times its specific heat"
    )

    def __post_init__(self) -> None:
        declared.validate(self)

    @property
    def heat_capacity(self) -> float:
        """Density times specific heat [J/m3K]."""
        return self.density * self.specific_heat

    @property
    def effusivity(self) -> float:
        """Thermal effusivity [W s^1/2 / m2K]."""
        return float((self.conductivity * self.heat_capacity) ** 0.5)


def check_layers(layers: Sequence[Layer], tag: str, *, finger: bool = True) -> None:
    """Check the layers that a file gives for one side, before a side is made of them.

    Parameters
    ----------
    layers
        From the contact inwards; none is right, too.
    tag
        Their element, for the message.
    finger
        Whether they are a finger's, behind which its core has a temperature; else a sample's under a film, whose last
        layer may be semi-infinite, and which has no blood.

    Raises
    ------
    ValueError
        If there are too many, a thickness is missing, or a sample has blood.
    """
    most = MOST_LAYERS if finger else MOST_LAYERS - 1
    if len(layers) > most:
        raise ValueError(f"there are {len(layers)} <{tag}>, and at most {most} may be: join some of them")
    for number, layer in enumerate(layers, 1):
        which = f"<{tag}> {layer.name or number}"
        if layer.thickness is None and finger:
            raise ValueError(f"{which} has no thickness: each layer of a finger needs one")
        if layer.thickness is None and number < len(layers):
            raise ValueError(f"{which} has no thickness: only the last <{tag}> may go on without end")
        if layer.perfusion > 0.0 and not finger:
            raise ValueError(f"{which} has a perfusion: only a finger has blood, so remove it")


@dataclass(frozen=True, slots=True)
class Back:
    """What holds the back face of a finite side: a temperature, convection, or insulation."""

    TAG: ClassVar[str] = "back"

    kind: Literal["temperature", "convection", "insulated"] = declared.choice(
        "temperature", "convection", "insulated", doc="held temperature, convection or insulation"
    )
    temperature: float | None = declared.temperature(default=None, doc="held or ambient temperature")
    coefficient: float | None = declared.quantity(
        "W/(m^2*K)", low=0.0, high=1e9, default=None, doc="convection coefficient"
    )

    def __post_init__(self) -> None:
        declared.validate(self)
        wanted = {"temperature": ("temperature",), "convection": ("temperature", "coefficient"), "insulated": ()}
        check_choice("back", self.kind, tuple(wanted))
        _check_given(self, "back", self.kind, wanted[self.kind], ("temperature", "coefficient"))


@dataclass(frozen=True, slots=True)
class Initial:
    """The temperature field before the touch: uniform, or steady in air, or steady under a known surface."""

    TAG: ClassVar[str] = "initial"

    kind: Literal["uniform", "steady"] = declared.choice("uniform", "steady", doc="uniform or steady profile")
    temperature: float | None = declared.temperature(default=None, doc="of a uniform start")
    coefficient: float | None = declared.quantity(
        "W/(m^2*K)", low=0.0, high=1e9, default=None, doc="film on the surface before the touch"
    )
    ambient: float | None = declared.temperature(default=None, doc="of the air before the touch")
    surface: float | None = declared.temperature(
        default=None, doc="surface temperature before the touch; then the film does not matter"
    )

    def __post_init__(self) -> None:
        declared.validate(self)
        check_choice("initial", self.kind, ("uniform", "steady"))
        if self.kind == "uniform":
            _check_given(self, "initial", "uniform", ("temperature",), ("coefficient", "ambient", "surface"))
        elif self.temperature is not None:
            raise ValueError("initial: 'temperature' belongs to a uniform start, not to a steady one")
        elif self.surface is None and (self.coefficient is None or self.ambient is None):
            raise ValueError("initial: a steady start needs 'surface', or both 'coefficient' and 'ambient'")


@dataclass(frozen=True, slots=True)
class Film:
    """The air on a surface that touches nothing."""

    TAG: ClassVar[str] = "air"

    coefficient: float = declared.quantity("W/(m^2*K)", low=0.0, high=1e9, doc="film coefficient")
    ambient: float = declared.temperature(doc="air temperature")

    def __post_init__(self) -> None:
        declared.validate(self)


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a contact: its layers from the contact inwards, its back, start and film."""

    layers: tuple[Layer, ...] = declared.children(Layer)
    initial: Initial = declared.child(Initial)
    back: Back | None = declared.child(Back)
    arterial: float | None = declared.temperature(default=None, doc="arterial temperature")
    air: Film | None = declared.child(Film)

    def __post_init__(self) -> None:
        declared.validate(self)
        if not 1 <= len(self.layers) <= MOST_LAYERS:
            raise ValueError(f"layers: {len(self.layers)} given; there may be 1 to {MOST_LAYERS}")
        if any(layer.thickness is None for layer in self.layers[:-1]):
            raise ValueError("layers: only the last layer may be semi-infinite (without thickness)")
        if not isinstance(self.initial, Initial):
            raise ValueError("initial: missing; give a uniform or a steady start")
        if self.semi_infinite and self.back is not None:
            raise ValueError("back: a semi-infinite side has none")
        if not self.semi_infinite and self.back is None:
            raise ValueError("back: missing; a finite side needs temperature, convection or insulated")
        if self.arterial is None and any(layer.perfusion > 0.0 for layer in self.layers):
            raise ValueError("arterial: missing; a perfused layer needs the arterial temperature")
        if self.initial.kind == "steady" and self.initial.surface is None and self.initial.coefficient == 0.0:
            self._check_held()

    def _check_held(self) -> None:
        """Check that a temperature is held behind a surface that no film cools, so that there is one steady field."""
        back = self.back
        held = back is not None and (back.kind == "temperature" or (back.coefficient or 0.0) > 0.0)
        if not held and not any(layer.perfusion > 0.0 for layer in self.layers):
            raise ValueError(
                "initial: with a film of 0 any temperature is steady, as neither back nor blood holds one; give "
                "'surface', a film above 0, or a uniform start"
            )

    @property
    def semi_infinite(self) -> bool:
        """Whether the last layer has no end."""
        return self.layers[-1].thickness is None

    @property
    def depth(self) -> float:
        """Thickness of all layers [m], infinite for a semi-infinite side."""
        return sum(float("inf") if layer.thickness is None else layer.thickness for layer in self.layers)


@dataclass(frozen=True, slots=True)
class Probe:
    """A named output: temperature ``T`` [K] or flux ``j`` [W/m2] at a depth [m] of a side."""

    name: str
    side: SideName
    depth: float
    what: Literal["T", "j"] = "T"

    def __post_init__(self) -> None:
        check_choice("probes.side", self.side, ("finger", "object"))
        check_choice("probes.what", self.what, ("T", "j"))
        if not self.name or not self.name.isprintable() or set(self.name) & set(',"'):
            raise ValueError(
                f"probes.name = {self.name!r} can't head a column: characters other than , and \" are needed"
            )
        if not (isinstance(self.depth, (int, float)) and 0.0 <= self.depth < float("inf")):
            raise ValueError(f"probes.depth = {self.depth!r} is out of range: 0 m to the depth of the side")


def check_choice(field: str, given: str, allowed: tuple[str, ...]) -> None:
    """Check that a word is among those allowed.

    Raises
    ------
    ValueError
        If it is not; the message names the field and the allowed words.
    """
    if given not in allowed:
        raise ValueError(f"{field} = {given!r} is unknown; allowed: {', '.join(allowed)}")


def _check_given(value: object, what: str, kind: str, wanted: tuple[str, ...], others: tuple[str, ...]) -> None:
    """Check that the fields of a kind are given, and no others."""
    for name in wanted:
        if getattr(value, name) is None:
            raise ValueError(f"{what}: kind '{kind}' needs '{name}'")
    for name in others:
        if name not in wanted and getattr(value, name) is not None:
            raise ValueError(f"{what}: kind '{kind}' does not take '{name}'")
