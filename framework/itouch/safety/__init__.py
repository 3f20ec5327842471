"""The supervisor: every reading is checked here, every command is limited here, and nothing else writes to a device."""

from itouch.monitors import LOSSES, DeviceFaultError, Trip, TripError
from itouch.safety.blind_retreat import TrackedFinger
from itouch.safety.connect import claim_wires, connect, first_reading
from itouch.safety.device_monitors import DeviceMonitors
from itouch.safety.gate import Gate
from itouch.safety.guard import Guard
from itouch.safety.hold_to_run import HoldToRun
from itouch.safety.latch import Status
from itouch.safety.lifecycle import Lifecycle
from itouch.safety.sequence import Outcome, SafeSequence
from itouch.safety.shared_finger import Finger

__all__ = [
    "LOSSES",
    "DeviceFaultError",
    "Finger",
    "Gate",
    "Guard",
    "HoldToRun",
    "Outcome",
    "DeviceMonitors",
    "SafeSequence",
    "Lifecycle",
    "Status",
    "TrackedFinger",
    "Trip",
    "TripError",
    "claim_wires",
    "connect",
    "first_reading",
]
