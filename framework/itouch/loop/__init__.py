"""What happens in a tick, and who may do it."""

from itouch.loop.clock import Clock, VirtualClock, WallClock
from itouch.loop.engine import Engine, EngineError
from itouch.loop.operator_commands import LatchedError
from itouch.loop.runner import DeviceFaultError, Status

__all__ = [
    "Clock", "DeviceFaultError", "Engine", "EngineError", "LatchedError", "Status", "VirtualClock", "WallClock",
]  # fmt: skip
