"""The supervisor: every reading is checked here, every command is limited here, and nothing else writes to a device."""

from itouch.monitors import LOSSES, DeviceFaultError, Trip, TripError
from itouch.safety.blind_retreat import TrackedFinger
from itouch.safety.connect import claim_wires, connect
from itouch.safety.device_monitors import DeviceMonitors
from itouch.safety.finger import Finger
from itouch.safety.guard import Guard
from itouch.safety.hold_to_run import HoldToRun
from itouch.safety.lifecycle import Status
from itouch.safety.sequence import Outcome, SafeSequence
from itouch.safety.supervisor import Supervisor

__all__ = [
    "LOSSES",
    "DeviceFaultError",
    "Finger",
    "Guard",
    "HoldToRun",
    "Outcome",
    "DeviceMonitors",
    "SafeSequence",
    "Status",
    "Supervisor",
    "TrackedFinger",
    "Trip",
    "TripError",
    "claim_wires",
    "connect",
]
