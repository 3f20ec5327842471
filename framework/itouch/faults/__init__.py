"""Fault injection: twins that fail as planned, so that the supervisor's reaction can be seen and tested."""

from itouch.faults.failing_twin import FaultyTwin
from itouch.faults.kinds import FOREVER, Injection, Kind

__all__ = ["FOREVER", "FaultyTwin", "Injection", "Kind"]
