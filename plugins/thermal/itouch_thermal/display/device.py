"""The thermal display as a device plugin: four sensors, one current, and a twin."""

from __future__ import annotations

import math
from typing import Any

from itouch.plugin import Channel, current
from itouch_thermal.display.channels import READS, channels
from itouch_thermal.display.display_twin import DisplayTwin
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers.hardware import HardwareDisplay


class ThermalDisplay(HardwareDisplay):
    """A Peltier plate with infrared, plate, sink and flux sensors, driven by a current or (its twin) a temperature."""

    Params = DisplayParams
    reads = READS
    commands = (current(limit=6.4),)
    Twin = DisplayTwin

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels, with the sensor's full scale and the driver's limit from the parameters."""
        return channels(params)

    @classmethod
    def surface_half_extents(cls, params: Any) -> tuple[float, float] | None:
        """Return the half extents [m] of the plate, a square of its area."""
        half = 0.5 * math.sqrt(params.area)
        return half, half
