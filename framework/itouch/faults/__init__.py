"""Fault injection: twins that fail as planned, so that the supervisor's reaction can be seen and tested."""

from itouch.faults.kinds import FOREVER, Injection, Kind
from itouch.faults.twin import FaultyTwin

__all__ = ["FOREVER", "FaultyTwin", "Injection", "Kind"]
