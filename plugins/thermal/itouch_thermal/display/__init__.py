"""The thermal display: a Peltier plate under a flux sensor, its twin, and what a controller may know of it."""

from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.params import DisplayParams, Mismatch

__all__ = ["DisplayParams", "Mismatch", "ThermalDisplay"]
