"""The thermal display: a Peltier plate under a flux sensor, its parameters, its twin, and its device plugin."""

from itouch_thermal.display.params import Datasheet, DisplayParams, Mismatch

__all__ = ["Datasheet", "DisplayParams", "Mismatch"]
