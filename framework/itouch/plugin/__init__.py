"""All that a plugin may import: the device, twin and modality contracts, channels, schema fields and poses."""

from typing import Any

from itouch import schema
from itouch.moved import renamed
from itouch.plugin import poses
from itouch.plugin.bases import building, kept
from itouch.plugin.bound import Bound
from itouch.plugin.channel import (
    HOLD,
    RETRACT,
    ROTATIONS,
    Channel,
    Safe,
    current,
    deadman,
    heat_flux,
    measured_wrench,
    plate_temperature,
    pose,
    pose_target,
    sink_temperature,
    skin_temperature,
    temperature,
    temperature_target,
    twist,
    wrench,
)
from itouch.plugin.contact_events import Contact, ContactArrays, ContactEvent
from itouch.plugin.device import Attached, Device, DeviceError, Twin, TwinInputs
from itouch.plugin.emulator import Emulator
from itouch.plugin.fit import Fit, Fitted, line_through
from itouch.plugin.groups import Emulation, Mechanics, Opening, OperatorInput, Timing
from itouch.plugin.ideal import IdealTwin
from itouch.plugin.impedance import FingerTwin, ImpedanceArm
from itouch.plugin.measured import Measured
from itouch.plugin.modality import ContactFields, Modality, SurfaceFields
from itouch.plugin.monitor import Moment, Monitor, Rule, Watched
from itouch.plugin.noise import gaussian
from itouch.plugin.pseudo_terminal import Terminal
from itouch.plugin.quantity import HURTING, NEVER_HARMLESS, Quantity, Role
from itouch.plugin.record import Field, Record
from itouch.plugin.timestamps import Timestamps
from itouch.plugin.trace import Trace, read_trace
from itouch.plugin.world import World, WorldDevice, WorldObject, WorldSurface
from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch.schema.fields import ParameterError
from itouch.schema.quantities import QuantityError, parse_quantity
from itouch.schema.wait_notices import waiting

__all__ = [
    "HOLD",
    "HURTING",
    "NEVER_HARMLESS",
    "RETRACT",
    "ROTATIONS",
    "Attached",
    "Bound",
    "SurfaceFields",
    "Channel",
    "Contact",
    "ContactEvent",
    "Device",
    "DeviceError",
    "Emulator",
    "ContactArrays",
    "ImpedanceArm",
    "FingerTwin",
    "Timing",
    "OperatorInput",
    "Opening",
    "Mechanics",
    "Emulation",
    "Field",
    "Fit",
    "Fitted",
    "IdealTwin",
    "ItouchError",
    "Measured",
    "Modality",
    "Moment",
    "Monitor",
    "ParameterError",
    "Quantity",
    "QuantityError",
    "Record",
    "Role",
    "Rule",
    "Safe",
    "Timestamps",
    "Terminal",
    "ContactFields",
    "TwinInputs",
    "Trace",
    "Twin",
    "Watched",
    "World",
    "WorldDevice",
    "WorldObject",
    "WorldSurface",
    "building",
    "current",
    "deadman",
    "gaussian",
    "heat_flux",
    "kept",
    "line_through",
    "measured_wrench",
    "need",
    "parse_quantity",
    "plate_temperature",
    "pose",
    "pose_target",
    "poses",
    "read_trace",
    "schema",
    "sink_temperature",
    "skin_temperature",
    "temperature",
    "temperature_target",
    "twist",
    "waiting",
    "wrench",
]

#: Old name -> new name, kept for one version.
_RENAMED = {
    "Carries": "SurfaceFields",
    "HeardContact": "ContactArrays",
    "Stamps": "Timestamps",
    "Touch": "TwinInputs",
    "Touches": "ContactFields",
}


def __getattr__(name: str) -> Any:
    return globals()[renamed(__name__, name, _RENAMED)]
