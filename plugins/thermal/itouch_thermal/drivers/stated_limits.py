"""The limits that a self-built rig states in its greeting, and whether they satisfy those in force for the device."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from itouch.plugin import DeviceError

KELVIN = 273.15
#: Absolute limits of plate and sink [degC]: a rig that cuts itself off only beyond them protects nobody.
PLATE_ABSOLUTE, SINK_ABSOLUTE = (8.0, 45.0), 58.0
#: A rig must set its current to zero by itself within this time [s] without a command.
SILENCE = 0.5

#: Causes of a cut-off, in words.
CAUSES = {
    "plate-hot": "its plate was too hot",
    "plate-cold": "its plate was too cold",
    "sink-hot": "its heat sink was too hot",
    "plate-sensor": "a thermistor of its plate is open or short",
    "sink-sensor": "the thermistor of its heat sink is open or short",
    "sensors-differ": "the two thermistors of its plate do not agree",
    "current": "its current was not what it should be",
    "converter": "its converter gave no samples",
    "unknown": "it does not know why any more",
}


@dataclass(frozen=True, slots=True)
class StatedLimits:
    """Greatest current [A], cut-off temperatures of plate and sink [degC], watchdog [s]; last reset and cut-off."""

    amps: float
    plate: tuple[float, float]
    sink: float
    silence: float
    reset: str
    cut: str

    @classmethod
    def read(cls, greeting: str) -> StatedLimits:
        """Parse them from a greeting.

        Raises
        ------
        DeviceError
            If a word is missing or not a number, or a limit is impossible.
        """
        words = dict(word.split("=", 1) for word in greeting.split() if "=" in word)
        try:
            low, high = (float(word) for word in words["plate"].split(":"))
            found = cls(
                float(words["amps"]), (low, high), float(words["sink"]), float(words["silence"]),
                words["reset"], words["cut"],
            )  # fmt: skip
        except (KeyError, ValueError):
            raise DeviceError(f"a rig greets with '{greeting}', which does not tell its limits") from None
        if not all(math.isfinite(v) for v in (found.amps, low, high, found.sink, found.silence)):
            raise DeviceError(f"a rig greets with '{greeting}': a limit that is not a number")
        if found.amps <= 0.0 or found.silence <= 0.0 or low >= high:
            raise DeviceError(
                f"a rig greets with '{greeting}': an impossible limit; amps and silence must be more than 0, and "
                "the plate's first temperature less than its second"
            )
        return found


def unmet_limits(stated: StatedLimits, limits: Mapping[str, Any]) -> list[str]:
    """Return, in words, which of the stated limits do not satisfy these limits in force (SI)."""
    low, high = stated.plate
    problems = []
    if low < PLATE_ABSOLUTE[0] or high > PLATE_ABSOLUTE[1]:
        problems.append(f"cuts itself off at {low:g} and {high:g} degC of its plate: it must at 8 and 45 or between")
    if stated.sink > SINK_ABSOLUTE:
        problems.append(f"cuts itself off at {stated.sink:g} degC of its sink: it must at {SINK_ABSOLUTE:g} or below")
    if stated.silence > SILENCE:
        problems.append(f"goes to zero after {stated.silence:g} s without an order: it must within {SILENCE:g} s")
    allowed = limits.get("temperature")
    if allowed is not None:
        least, most = (value - KELVIN for value in allowed)
        if not (low < least and most < high):
            problems.append(
                f"cuts itself off at {low:g} and {high:g} degC, and the scene lets the plate go from {least:g} to "
                f'{most:g}: tighten <limits temperature="..."/>'
            )
    amps = limits.get("current")
    if amps is not None and amps > stated.amps * (1.0 + 1e-6):
        problems.append(
            f'gives {stated.amps:g} A at most, and the scene asks for {amps:g}: write <limits current="'
            f'{stated.amps:g} A"/>'
        )
    return problems
