"""Water on the plate: the room's dew point, what to say about it, and how to stay above it."""

from __future__ import annotations

import math

from itouch.plugin import ParameterError
from itouch_thermal.display.params import DisplayParams

#: How far above the dew point a plate is kept if it is to stay dry [K].
MARGIN = 1.0


def dew_point(temperature: float, humidity: float) -> float:
    """Return the dew point [K] of air at a temperature [K] and relative humidity 0..1 (Magnus form, Sonntag 1990).

    Raises
    ------
    ValueError
        If the humidity is not above 0 and at most 1.
    """
    if not 0.0 < humidity <= 1.0:
        raise ValueError(f"humidity = {humidity!r} is out of range: above 0 to 1")
    celsius = temperature - 273.15
    level = math.log(humidity) + 17.62 * celsius / (243.12 + celsius)
    return 243.12 * level / (17.62 - level) + 273.15


def dew_of(display: DisplayParams, ambient: float) -> float:
    """Return the dew point [K] of a room at a temperature [K]; 0 where the air is dry."""
    return dew_point(ambient, display.humidity) if display.humidity > 0.0 else 0.0


def driest(band: tuple[float, float], dew: float) -> tuple[float, float]:
    """Return the plate's band [K] with its lower end at least a margin above the dew point.

    Raises
    ------
    ValueError
        If nothing is left of the band.
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
