"""Limits for the whole scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import choice, quantity, temperature


@dataclass(frozen=True, slots=True)
class Safety:
    """Limits for the whole scene; they may only be tighter than the defaults."""

    TAG: ClassVar[str] = "safety"
    force: float | None = quantity("N", positive=True, default=None, doc="greatest force of any device on the operator")
    speed: float | None = quantity("m/s", positive=True, default=None, doc="greatest speed of any carried surface")
    temperature: tuple[float, float] | None = temperature(
        size=2, low=200, high=400, default=None, doc="lowest and highest plate temperature"
    )
    servo_overrun: str = choice("stop", "warn", default="warn", doc="what happens when the loop falls behind real time")
    watchdog: float | None = quantity("s", positive=True, default=None, doc="greatest age of a device's reading")
