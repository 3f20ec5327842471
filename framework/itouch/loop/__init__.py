"""What happens in a tick, and who may do it."""

from itouch.loop.clock import Clock, VirtualClock, WallClock
from itouch.loop.device_runner import DeviceFaultError, Status
from itouch.loop.engine import Engine, EngineError
from itouch.loop.operator_commands import LatchedError

__all__ = [
    "Clock", "DeviceFaultError", "Engine", "EngineError", "LatchedError", "Status", "VirtualClock", "WallClock",
]  # fmt: skip
