"""The scene language: frozen descriptions in SI, one class per element, whose fields are the grammar."""

from itouch.scene.elements.device_element import Calibration, DeviceElement, Devices, Limits, Mount
from itouch.scene.elements.include import Include, PluginPart
from itouch.scene.elements.interaction import Interaction, Motion, Operator, Probe, To
from itouch.scene.elements.materials import ContactMaterial, Material, Materials, Visual
from itouch.scene.elements.motion import Dynamics, Key, ObjectMotion
from itouch.scene.elements.objects import OBJECTS, Box, Capsule, Cylinder, Mesh, Plane, Sphere, WorldElement
from itouch.scene.elements.rates import Rates
from itouch.scene.elements.recorded_tracks import RecordChannels, RecordElement
from itouch.scene.elements.safety import FAULTS, Fault, Faults, Safety

#: Format version that this program writes, and the newest that it reads.
VERSION = "1.0"

__all__ = [
    "Box",
    "Calibration",
    "Capsule",
    "ContactMaterial",
    "Cylinder",
    "DeviceElement",
    "Dynamics",
    "Devices",
    "FAULTS",
    "Fault",
    "Faults",
    "Include",
    "Interaction",
    "Limits",
    "Material",
    "Materials",
    "Mesh",
    "Motion",
    "Mount",
    "OBJECTS",
    "ObjectMotion",
    "Operator",
    "Plane",
    "PluginPart",
    "Probe",
    "Rates",
    "RecordChannels",
    "RecordElement",
    "Safety",
    "Sphere",
    "To",
    "VERSION",
    "Visual",
    "WorldElement",
    "Key",
]
