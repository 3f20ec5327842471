"""Element `<sound>`: how a surface sounds when it is struck, and when the probe slides over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import children, quantity


@dataclass(frozen=True, slots=True)
class Mode:
    """One damped vibration that a tap excites."""

    TAG: ClassVar[str] = "mode"
    frequency: float = quantity("Hz", low=20.0, high=16000.0, doc="frequency of the vibration")
    decay: float = quantity("s", positive=True, high=20.0, doc="time in which it dies away by 60 dB")
    gain: float = quantity("", low=0.0, high=1.0, default=1.0, doc="its share of the tap, 0 to 1")


@dataclass(frozen=True, slots=True)
class Sound:
    """The sound of a material: a sum of damped modes for taps, and noise for sliding."""

    TAG: ClassVar[str] = "sound"
    loudness: float = quantity("", low=0.0, high=1.0, default=1.0, doc="loudness of all its sounds, 0 to 1")
    friction: float = quantity(
        "", low=0.0, high=1.0, default=0.2, doc="loudness of the noise of sliding, 0 to 1; a <texture> is heard in it"
    )
    grain: float = quantity(
        "m",
        low=1e-5,
        high=1e-2,
        default=2e-4,
        doc="size of the grains that sliding crosses: its pitch is speed / grain",
    )
    modes: tuple[Mode, ...] = children(Mode, doc="the vibrations of a tap")
