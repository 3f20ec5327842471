"""A hold that lasts until a condition is met: ``until skin 0.5 K``, until the skin is back at its temperature."""

from __future__ import annotations

from dataclasses import dataclass

from itouch.schema.quantities import format_quantity

#: The word before what is waited for, and what can be waited for.
WORD, SKIN = "until", "skin"
#: Smallest and greatest difference that can be asked for [K].
LEAST, MOST = 0.05, 10.0


@dataclass(frozen=True, slots=True)
class Until:
    """A wait until the skin is within ``within`` [K] of its temperature at the session's start."""

    within: float

    def __post_init__(self) -> None:
        if not LEAST <= self.within <= MOST:
            raise ValueError(f"within = {self.within!r} is out of range: {LEAST:g} to {MOST:g} K")

    def __str__(self) -> str:
        return f"{WORD} {SKIN} {format_quantity(self.within, 'K')}"
