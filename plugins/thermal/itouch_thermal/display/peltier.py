"""A thermoelectric module: the heat that a current pumps, the current for a given heat, and a data sheet's module.

``Q_c = S T_c I - I^2 R / 2 - K (T_h - T_c)`` and ``Q_h = Q_c + S (T_h - T_c) I + I^2 R``; temperatures in kelvin
(Lineykin and Ben-Yaakov 2007).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from itouch.plugin.kernels import kernel


@kernel
def pumped_heat(
    seebeck: float, resistance: float, conductance: float, current: float, cold: float, hot: float
) -> float:
    """Return the heat [W] absorbed at the plate."""
    return seebeck * cold * current - 0.5 * current * current * resistance - conductance * (hot - cold)


@kernel
def current_for(seebeck: float, resistance: float, conductance: float, heat: float, cold: float, hot: float) -> float:
    """Return the current [A] that absorbs ``heat`` [W]: the smaller root; the best current beyond the greatest heat."""
    pull = seebeck * cold
    root = pull * pull - 2.0 * resistance * (heat + conductance * (hot - cold))
    if root <= 0.0:
        return pull / resistance
    return 2.0 * (heat + conductance * (hot - cold)) / (pull + math.sqrt(root))


@dataclass(frozen=True, slots=True)
class Module:
    """Seebeck coefficient [V/K], electrical resistance [ohm] and leg conductance [W/K] of a module."""

    seebeck: float
    resistance: float
    conductance: float

    @staticmethod
    def from_datasheet(*, voltage: float, current: float, difference: float, hot: float) -> Module:
        """Return the module whose data sheet gives U_max [V], I_max [A], dT_max [K] at T_h [K].

        Raises
        ------
        ValueError
            If a value is not positive, or the difference is not less than the hot side's temperature.
        """
        given = {"voltage": voltage, "current": current, "difference": difference, "hot": hot}
        for name, value in given.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value!r} must be more than 0")
        if difference >= hot:
            raise ValueError(f"difference = {difference!r} K must be less than hot = {hot!r} K")
        return Module(
            voltage / hot,
            voltage * (hot - difference) / (current * hot),
            voltage * current * (hot - difference) / (2.0 * hot * difference),
        )
