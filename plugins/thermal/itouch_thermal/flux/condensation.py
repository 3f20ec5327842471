"""Water on the plate: the room's dew point, what to say about it, and how to stay above it."""

from __future__ import annotations

import math

from itouch.plugin import ParameterError
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.display.peltier import dew_point

#: How far above the dew point a plate is kept that shall stay dry [K].
MARGIN = 1.0


def dew_of(display: DisplayParams, ambient: float) -> float:
    """Return the dew point [K] of a room at a temperature [K]; 0 where the air is dry."""
    return dew_point(ambient, display.humidity) if display.humidity > 0.0 else 0.0


def driest(band: tuple[float, float], dew: float) -> tuple[float, float]:
    """Return the plate's band [K] with its lower end at least a margin above the dew point.

    Raises
    ------
    ValueError
        If nothing is left of it.
    """
    low = max(band[0], dew + MARGIN)
    if low >= band[1] - MARGIN:
        sentence = (
            f"condensation = 'avoid': the dew point of {dew - 273.15:.1f} degC leaves nothing of the plate's band"
        )
        raise ParameterError("condensation", sentence)
    return low, band[1]


def warning(band: tuple[float, float], dew: float, ambient: float, humidity: float) -> str:
    """Say that water may condense on the plate; empty if it can't."""
    if dew <= band[0] or not math.isfinite(dew):
        return ""
    room = f"{dew - 273.15:.1f} degC of a room at {ambient - 273.15:.1f} degC and {100.0 * humidity:.0f} % humidity"
    return (
        f"the plate may go down to {band[0] - 273.15:.1f} degC, below the dew point of {room}: "
        'water would condense on it; condensation="avoid" keeps it above'
    )
