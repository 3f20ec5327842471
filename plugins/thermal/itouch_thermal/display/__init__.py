"""The thermal display: a Peltier plate under a flux sensor, its twin, and what a controller may know of it."""

from itouch_thermal.display.params import Datasheet, DisplayParams, Mismatch

__all__ = ["Datasheet", "DisplayParams", "Mismatch"]
