"""The supervisor: every reading is checked here, every command is limited here, and nothing else writes to a device."""

from itouch.safety.carried import Carried
from itouch.safety.connect import connect
from itouch.safety.finger import fade
from itouch.safety.guard import Guard
from itouch.safety.heat import Heat
from itouch.safety.hold import Hold
from itouch.safety.lifecycle import Status
from itouch.safety.readings import Watch
from itouch.safety.sequence import Outcome, SafeSequence
from itouch.safety.supervisor import Supervisor
from itouch.safety.trips import LOSSES, DeviceFaultError, Trip, TripError

__all__ = [
    "LOSSES",
    "Carried",
    "DeviceFaultError",
    "Guard",
    "Heat",
    "Hold",
    "Outcome",
    "SafeSequence",
    "Status",
    "Supervisor",
    "Trip",
    "TripError",
    "Watch",
    "connect",
    "fade",
]
