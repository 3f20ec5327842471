"""Contact resistance as a function of force, as a scene declares it; for the laws see `contact_heat.resistance`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from contact_heat.resistance import (
    AREA_AT_1N,
    AREA_EXPONENT,
    DEFAULT_RESISTANCE,
    SPREAD,
    ConstantResistance,
    PressureResistance,
    ResistanceLaw,
    TableResistance,
)
from itouch.plugin import schema

__all__ = ["ConstantLaw", "ForceLaw", "ForcePoint", "PressureLaw", "TableLaw", "law_of", "press_factor"]

_DEFAULT = PressureResistance()


@dataclass(frozen=True, slots=True)
class ConstantLaw:
    """The same contact resistance at any force."""

    TAG: ClassVar[str] = "constant-resistance"

    resistance: float = schema.quantity(
        "m^2*K/W", low=0.0, high=1.0, default=DEFAULT_RESISTANCE, doc="contact resistance between skin and object"
    )

    def __post_init__(self) -> None:
        schema.validate(self)

    def law(self) -> ConstantResistance:
        """Return the law."""
        return ConstantResistance(self.resistance)

    @property
    def spread(self) -> tuple[float, float]:
        """Contact area at 1 N [m2], and exponent of the force in it."""
        return SPREAD


@dataclass(frozen=True, slots=True)
class PressureLaw:
    """Skin that yields: 1/R = base + slope p^exponent, p the force in N over the contact area in m2."""

    TAG: ClassVar[str] = "pressure-resistance"

    base: float = schema.quantity(
        "W/(m^2*K)", low=0.0, high=1e5, default=_DEFAULT.base, doc="conductance without pressure, by moisture and air"
    )
    slope: float = schema.quantity(
        "", low=0.0, high=1e5, default=_DEFAULT.slope, doc="conductance [W/(m^2*K)] at a pressure of 1 Pa"
    )
    exponent: float = schema.quantity(
        "", low=1e-3, high=2.0, default=_DEFAULT.exponent, doc="exponent of the pressure in Pa"
    )
    contact_area: float = schema.quantity(
        "m^2", low=1e-7, high=1e-2, default=AREA_AT_1N, doc="contact area of the fingertip at 1 N"
    )
    area_exponent: float = schema.quantity(
        "", low=0.0, high=1.0, default=AREA_EXPONENT, doc="exponent of the force in the contact area; Hertz: a third"
    )

    def __post_init__(self) -> None:
        schema.validate(self)
        if self.base == 0.0 and self.slope == 0.0:
            raise ValueError("base and slope are both 0: nothing would be conducted at any force")

    def law(self) -> PressureResistance:
        """Return the law."""
        return PressureResistance(self.base, self.slope, self.exponent, self.contact_area, self.area_exponent)

    @property
    def spread(self) -> tuple[float, float]:
        """Contact area at 1 N [m2], and exponent of the force in it."""
        return self.contact_area, self.area_exponent


@dataclass(frozen=True, slots=True)
class ForcePoint:
    """A point of the table: a force, and the contact resistance that was measured at it."""

    TAG: ClassVar[str] = "point"

    force: float = schema.quantity("N", low=1e-6, high=100.0, doc="normal force")
    resistance: float = schema.quantity("m^2*K/W", low=0.0, high=1.0, doc="contact resistance at that force")

    def __post_init__(self) -> None:
        schema.validate(self)


@dataclass(frozen=True, slots=True)
class TableLaw:
    """Contact resistances at forces, linear between them and constant outside; forces ascend."""

    TAG: ClassVar[str] = "table-resistance"

    points: tuple[ForcePoint, ...] = schema.children(ForcePoint, doc="at least one")

    def __post_init__(self) -> None:
        self.law()

    def law(self) -> TableResistance:
        """Return the law.

        Raises
        ------
        ValueError
            If there is no point, or the forces do not ascend.
        """
        if not self.points:
            raise ValueError('a table needs at least one <point force="..." resistance="..."/>')
        return TableResistance(
            tuple(point.force for point in self.points), tuple(point.resistance for point in self.points)
        )

    @property
    def spread(self) -> tuple[float, float]:
        """Contact area at 1 N [m2], and exponent of the force in it."""
        return SPREAD


ForceLaw = ConstantLaw | PressureLaw | TableLaw
#: The elements of which a finger's element may contain one.
KINDS: tuple[type, ...] = (ConstantLaw, PressureLaw, TableLaw)


def law_of(laws: tuple[ForceLaw, ...], resistance: float) -> ResistanceLaw:
    """Return the given law, or the constant resistance [K m2/W] if none is given."""
    return laws[0].law() if laws else ConstantResistance(resistance)


def check_laws(laws: tuple[ForceLaw, ...], resistance: float) -> None:
    """Check that there is at most one law, and that no constant resistance is given besides.

    Raises
    ------
    ValueError
        If there is; the message names what is there.
    """
    names = [f"<{law.TAG}>" for law in laws]
    if len(names) > 1:
        raise ValueError(f"only one force law may stand here, not {' and '.join(names)}")
    if names and resistance != DEFAULT_RESISTANCE:
        raise ValueError(f"contact-resistance and {names[0]} say the same thing: remove one of them")


def press_factor(time: float, press: float) -> float:
    """Return the factor on the resistance while the skin flattens: ``1 / (1 - exp(-time / press))``.

    Parameters
    ----------
    time
        Time since the touch began [s], more than 0.
    press
        Time constant [s]; 0: no flattening.
    """
    return 1.0 if press <= 0.0 else 1.0 / -math.expm1(-time / press)
