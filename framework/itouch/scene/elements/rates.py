"""Element `<rates>`: how fast the servo loop and the modalities run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import Spec, quantity

#: How far a rate may be from one that divides the servo rate, as a share: people write six digits, as 333.333 Hz.
CLOSE = 1e-5


@dataclass(frozen=True, slots=True)
class Rates:
    """Rate of the servo loop and, by name, rates of modalities, each of which must divide the servo rate."""

    TAG: ClassVar[str] = "rates"
    OPEN: ClassVar[str] = "modalities"
    OPEN_SPEC: ClassVar[Spec] = Spec("quantity", "rate of a modality", "Hz", low=1e-3, high=4000)
    servo: float = quantity("Hz", low=100, high=4000, default=1000.0, doc="rate of the servo loop")
    modalities: tuple[tuple[str, float], ...] = ()
