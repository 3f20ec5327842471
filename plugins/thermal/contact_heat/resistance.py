"""Thermal contact resistance and heat-conducting area of a fingertip as functions of the force.

Skin touches smooth objects only in part; pressure flattens its ridges.  Measured drops of skin temperature on metal
imply a few times 1e-3 m2K/W in a light touch, which is the default here; the useful range is 1e-5 to 1e-2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

#: Contact resistance of a light touch [K m2/W].
DEFAULT_RESISTANCE = 2e-3

#: Fingertip pad: area at 1 N [m2] and exponent of the force; about 1 cm2 under a light press.
AREA_AT_1N = 1.1e-4
AREA_EXPONENT = 1.0 / 3.0
SPREAD = AREA_AT_1N, AREA_EXPONENT


#: The kinds of law; each law's numbers begin with its kind.
CONSTANT, PRESSURE, TABLE = 0.0, 1.0, 2.0


def resistance_at(law: Sequence[float], force: float) -> float:
    """Return the resistance [K m2/W] at a normal force [N]; infinite at zero force.

    ``law`` is a law's ``numbers``.  (This plain Python can also be compiled, as the display's twin does.)
    """
    if force <= 0.0:
        return math.inf
    if law[0] == CONSTANT:
        return law[1]
    if law[0] == PRESSURE:
        pressure = force / (law[4] * force ** law[5])
        conductance = law[1] + law[2] * pressure ** law[3]
        return 1.0 / conductance if conductance > 0.0 else math.inf
    count = (len(law) - 1) // 2
    upper = 0
    while upper < count and law[1 + upper] <= force:
        upper += 1
    if upper == 0:
        return law[1 + count]
    if upper == count:
        return law[2 * count]
    low, high = law[upper], law[1 + upper]
    part = (force - low) / (high - low)
    return law[count + upper] + part * (law[1 + count + upper] - law[count + upper])


@dataclass(frozen=True, slots=True)
class ConstantResistance:
    """The same resistance [K m2/W] at any force."""

    resistance: float = DEFAULT_RESISTANCE

    def __post_init__(self) -> None:
        check_resistance(self.resistance)

    def at(self, force: float) -> float:
        """Return the resistance [K m2/W] at a normal force [N]; infinite at zero force."""
        return resistance_at(self.numbers, force)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The law in the form that `resistance_at` takes."""
        return (CONSTANT, self.resistance)


@dataclass(frozen=True, slots=True)
class PressureResistance:
    """The law of plastic contact, ``1/R = h0 + h1 p**0.95`` with the mean pressure p over the contact area.

    Parameters
    ----------
    base
        h0, conductance of moisture and air at zero pressure [W/m2K].
    slope
        h1 [W/m2K per pascal to the exponent]; the default gives `DEFAULT_RESISTANCE` at 1 N.
    exponent
        0.95 for rough surfaces that yield (Cooper, Mikic and Yovanovich 1969).
    area, area_exponent
        Contact area at 1 N [m2], and the exponent of the force in it.
    """

    base: float = 200.0
    slope: float = 300.0 / (1.0 / AREA_AT_1N) ** 0.95
    exponent: float = 0.95
    area: float = AREA_AT_1N
    area_exponent: float = AREA_EXPONENT

    def __post_init__(self) -> None:
        if not 0.0 < self.area < float("inf"):
            raise ValueError(f"area = {self.area!r} m^2 must be finite and more than 0")
        if not 0.0 <= self.area_exponent <= 1.0:
            raise ValueError(f"area_exponent = {self.area_exponent!r} is out of range: 0 to 1")
        for name in ("base", "slope"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name} = {getattr(self, name)!r} is out of range: 0 or more, finite")
        if not 0.0 < self.exponent <= 2.0:
            raise ValueError(f"exponent = {self.exponent!r} is out of range: above 0, at most 2")

    def at(self, force: float) -> float:
        """Return the resistance [K m2/W] at a normal force [N]; infinite at zero force."""
        return resistance_at(self.numbers, force)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The law in the form that `resistance_at` takes."""
        return (PRESSURE, self.base, self.slope, self.exponent, self.area, self.area_exponent)


@dataclass(frozen=True, slots=True)
class TableResistance:
    """Resistances [K m2/W] at forces [N], linear in between and constant outside."""

    forces: tuple[float, ...]
    resistances: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.forces) != len(self.resistances) or not self.forces:
            raise ValueError("forces and resistances must have the same number of entries, at least one")
        if any(later <= earlier for earlier, later in zip((0.0, *self.forces[:-1]), self.forces, strict=True)):
            raise ValueError("forces must ascend and be above 0 N")
        for resistance in self.resistances:
            check_resistance(resistance)

    def at(self, force: float) -> float:
        """Return the resistance [K m2/W] at a normal force [N]; infinite at zero force."""
        return resistance_at(self.numbers, force)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The law in the form that `resistance_at` takes."""
        return (TABLE, *self.forces, *self.resistances)


ResistanceLaw = ConstantResistance | PressureResistance | TableResistance


def contact_area(force: float, at_1n: float = AREA_AT_1N, exponent: float = AREA_EXPONENT) -> float:
    """Return the contact area [m2] of a fingertip on a flat surface under a normal force [N], by default after Hertz.

    (This function is also compiled.)
    """
    return float(at_1n * max(force, 0.0) ** exponent)


def material_resistance(conductivity: float) -> float:
    """Return Ho and Jones's resistance [K m2/W] of a pressed fingertip on a material of a conductivity [W/mK].

    ``R = (0.37 + k) / (1870 k)``, fitted to skin temperatures on materials from foam to copper; a rough guide.
    """
    if not conductivity > 0.0:
        raise ValueError(f"conductivity = {conductivity!r} is out of range: above 0 W/(m*K)")
    return (0.37 + conductivity) / (1870.0 * conductivity)


def check_resistance(resistance: float) -> None:
    """Check that a contact resistance is between 0 and 1e6 K m2/W.

    Raises
    ------
    ValueError
        If it is not; the message gives the range.
    """
    if not (isinstance(resistance, (int, float)) and 0.0 <= resistance <= 1e6):
        raise ValueError(f"resistance (Rth) = {resistance!r} is out of range: 0 to 1e+06 K m2/W")
