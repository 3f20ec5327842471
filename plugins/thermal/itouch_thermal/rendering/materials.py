"""Materials that the bench knows by name: conductivity [W/mK], specific heat [J/kgK], density [kg/m3].

The first four are the paper's; the others are rounded handbook values at room temperature.
"""

from __future__ import annotations

import math

import numpy as np

from itouch_thermal.heat import ThermalMaterial
from itouch_thermal.library import library

#: Effusivity [W s^1/2 / m2K] below which a material counts as a foam.
FOAM = 300.0

#: Names of the three numbers, and their allowed ranges.
_NAMES = "conductivity", "specific heat", "density"
_RANGES = (1e-3, 5e3), (10.0, 2e4), (0.1, 3e4)
#: Ranges of effusivity and volumetric heat capacity [J/m3K] of made-up materials.
_DRAWN = (20.0, 24000.0), (1.5e4, 4e6)

_VALUES: dict[str, tuple[float, float, float]] = {
    "aluminium": (200.0, 900.0, 2750.0),
    "pyrex": (1.4, 835.0, 2225.0),
    "wood": (0.11, 2720.0, 415.0),
    "polystyrene": (0.027, 1210.0, 55.0),
    "copper": (400.0, 385.0, 8933.0),
    "steel": (15.0, 480.0, 7900.0),
    "brass": (115.0, 380.0, 8500.0),
    "granite": (2.9, 820.0, 2650.0),
    "marble": (2.6, 880.0, 2700.0),
    "concrete": (1.4, 880.0, 2300.0),
    "glass": (1.0, 840.0, 2500.0),
    "ice": (2.2, 2050.0, 917.0),
    "brick": (0.7, 840.0, 1800.0),
    "PMMA": (0.19, 1470.0, 1180.0),
    "nylon": (0.25, 1700.0, 1140.0),
    "PTFE": (0.25, 1050.0, 2200.0),
    "rubber": (0.16, 1900.0, 1150.0),
    "leather": (0.16, 1500.0, 860.0),
    "oak": (0.17, 2400.0, 720.0),
    "cork": (0.045, 1800.0, 160.0),
    "balsa": (0.05, 2000.0, 140.0),
    "polyurethane foam": (0.026, 1400.0, 30.0),
}


def material(text: str) -> tuple[str, ThermalMaterial]:
    """Return a material by its name in this table or the shipped library, or one written out in SI.

    The written-out form is ``NAME:CONDUCTIVITY:SPECIFIC-HEAT:DENSITY``.

    Raises
    ------
    ValueError
        If the name is unknown, or the numbers are not valid.
    """
    name, *numbers = text.split(":")
    values = _VALUES.get(name) or _shipped(name)
    if numbers:
        try:
            values = tuple(float(number) for number in numbers)  # type: ignore[assignment]
        except ValueError:
            values = None
    if values is None or len(values) != 3:
        known = ", ".join(_VALUES)
        raise ValueError(
            f"materials: '{text}' is unknown; known are {known}, those of `itouch-py thermal materials`; "
            "or NAME:k:c:rho in SI"
        )
    for what, value, (low, high) in zip(_NAMES, values, _RANGES, strict=True):
        if not low <= value <= high:
            raise ValueError(f"materials: '{text}': {what} = {value:g} is out of range: {low:g} to {high:g}")
    return name, ThermalMaterial(conductivity=values[0], specific_heat=values[1], density=values[2])


def _shipped(name: str) -> tuple[float, float, float] | None:
    """Return conductivity, specific heat and density of a material in the shipped library; None if it is not there."""
    for found in library():
        if found.name == name:
            return found.layer.conductivity, found.layer.specific_heat, found.layer.density
    return None


def made_up(count: int, seed: int) -> list[tuple[str, ThermalMaterial]]:
    """Return random materials: effusivity and heat capacity drawn uniformly on logarithmic scales."""
    draw, found = np.random.default_rng(seed), list[tuple[str, ThermalMaterial]]()
    while len(found) < count:
        effusivity, capacity = (math.exp(draw.uniform(math.log(low), math.log(high))) for low, high in _DRAWN)
        conductivity = effusivity**2 / capacity
        if 0.02 <= conductivity <= 420.0:
            what = ThermalMaterial(conductivity=conductivity, specific_heat=1000.0, density=capacity / 1000.0)
            found.append((f"e{effusivity:.0f} k{conductivity:.3g}", what))
    return found
