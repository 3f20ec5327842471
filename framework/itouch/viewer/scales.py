"""How numbers of each unit are shown in charts: unit on screen, title of the chart, least axis, digits."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Kelvin beyond which a reading is none, as before the first measurement.
_COLDEST, _HOTTEST = 200.0, 1000.0


@dataclass(frozen=True, slots=True)
class Scale:
    """What is shown is ``factor`` times the value in SI plus ``offset``, in ``unit``.

    ``least`` is the least height of an axis; 0: by what there is.
    """

    title: str
    unit: str
    least: float = 0.0
    digits: str = ".4g"
    factor: float = 1.0
    offset: float = 0.0

    def shown(self, value: float) -> float:
        """Return a value in SI as it is shown; not-a-number where it can't be a reading."""
        if self.offset and not _COLDEST < value < _HOTTEST:
            return math.nan
        return self.factor * value + self.offset


#: SI unit -> how it is shown.
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

#: In which order charts stand, by unit.
ORDER = tuple(_SCALES)


def scale_of(unit: str) -> Scale:
    """Return how numbers of an SI unit are shown; of one that is not in the table, as they are."""
    return _SCALES.get(unit, Scale(unit, unit))
