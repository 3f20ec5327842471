"""How numbers of each unit of State are shown: unit and digits, title and least axis of charts; and round lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: A reading beyond these temperatures [K] is not one, such as before the first measurement.
_COLDEST, _HOTTEST = 200.0, 1000.0


def readable(kelvin: float) -> bool:
    """Tell whether a temperature [K] can be a reading."""
    return _COLDEST < kelvin < _HOTTEST


@dataclass(frozen=True, slots=True)
class Scale:
    """How a unit is shown: as ``factor`` times the value in SI plus ``offset``, in ``unit``.

    ``least`` is the least height of an axis; 0: the values determine it.
    """

    title: str
    unit: str
    least: float = 0.0
    digits: str = ".4g"
    factor: float = 1.0
    offset: float = 0.0

    def shown(self, value: float) -> float:
        """Return a value in SI as it is shown; NaN where it can't be a reading."""
        if self.offset and not readable(value):
            return math.nan
        return self.factor * value + self.offset


#: How each SI unit is shown.
_SCALES = {
    "N": Scale("force", "N", 1.0, ".2f"),
    "N*m": Scale("torque", "N m", 0.01, ".3f"),
    "W/m^2": Scale("heat flux", "W/m2", 200.0, ".0f"),
    "A": Scale("current", "A", 0.5, ".2f"),
    "V": Scale("voltage", "V", 0.5, ".2f"),
    "W": Scale("power", "W", 0.5, ".2f"),
    "K": Scale("temperature", "degC", 2.0, ".1f", 1.0, -273.15),
    "m": Scale("length", "mm", 1.0, ".2f", 1e3),
    "m/s": Scale("speed", "m/s", 0.01, ".3f"),
    "m/s^2": Scale("acceleration", "m/s2", 0.1, ".2f"),
    "Pa": Scale("pressure", "Pa"),
    "Hz": Scale("frequency", "Hz"),
    "s": Scale("time", "s"),
    "J": Scale("energy", "J"),
    "rad": Scale("angle", "rad", 0.01, ".3f"),
    "rad/s": Scale("angular velocity", "rad/s", 0.01, ".3f"),
    "1": Scale("plain numbers", "1"),
    "tick": Scale("ticks", "ticks", 0.0, ".0f"),
}

#: The order of charts, by SI unit.
ORDER = tuple(_SCALES)


def scale_of(unit: str) -> Scale:
    """Return how numbers of an SI unit are shown; those of a unit that is not in the table are shown as they are."""
    return _SCALES.get(unit, Scale(unit, unit))


def titled(title: str, unit: str, room: int) -> str:
    """Return a chart's title with its unit, in at most ``room`` letters: the words are cut, never the unit."""
    shown = f" [{unit}]"
    left = room - len(shown)
    return (title if len(title) <= left else title[: max(1, left - 1)].rstrip() + "…") + shown


def length(metre: float, room: float) -> float:
    """Return the longest round length [m], 1, 2 or 5 times a power of ten, that fits into ``room`` [pixels].

    ``metre`` is the length of a metre [pixels].
    """
    most = room / metre
    power = 10.0 ** math.floor(math.log10(most))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= most * (1.0 + 1e-9))


def grid_step(width: float) -> float:
    """Return the spacing [m] of the grid under a scene of this width [m]: a power of ten, such as 1, 10 or 100 mm."""
    return float(10.0 ** math.floor(math.log10(max(width, 1e-3) / 4.0)))
