"""Real thermal hardware: a Meerstetter TEC controller, a LabJack T7 for the sensors, and self-built rigs."""

from itouch_thermal.drivers.driver_params import FluxSensor, Infrared, LabJack, LinePort, Mecom
from itouch_thermal.drivers.rig import Rig, rig_of

__all__ = ["FluxSensor", "Infrared", "LabJack", "LinePort", "Mecom", "Rig", "rig_of"]
