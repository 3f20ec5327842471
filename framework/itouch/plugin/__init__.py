"""All that a plugin may import: the device, twin and modality contracts, channels, schema fields and poses."""

from itouch import schema
from itouch.plugin import poses
from itouch.plugin.channel import (
    HOLD,
    RETRACT,
    ROTATIONS,
    Channel,
    Safe,
    current,
    heat_flux,
    measured_wrench,
    pose,
    pose_target,
    temperature,
    twist,
    wrench,
)
from itouch.plugin.device import Device, DeviceError, Touch, Twin
from itouch.plugin.ideal import IdealTwin
from itouch.plugin.modality import Contact, ContactEvent, Modality, World, WorldDevice, WorldObject
from itouch.plugin.noise import gaussian
from itouch.plugin.record import Field, Record
from itouch.schema import ItouchError
from itouch.schema.quantities import QuantityError, parse_quantity

__all__ = [
    "HOLD",
    "RETRACT",
    "ROTATIONS",
    "Channel",
    "Contact",
    "ContactEvent",
    "Device",
    "DeviceError",
    "Field",
    "IdealTwin",
    "ItouchError",
    "Modality",
    "QuantityError",
    "Record",
    "Safe",
    "Touch",
    "Twin",
    "World",
    "WorldDevice",
    "WorldObject",
    "current",
    "gaussian",
    "heat_flux",
    "measured_wrench",
    "parse_quantity",
    "pose",
    "pose_target",
    "poses",
    "schema",
    "temperature",
    "twist",
    "wrench",
]
