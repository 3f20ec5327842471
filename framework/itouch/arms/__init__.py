"""Virtual arms: their finger is led by a mouse, a keyboard, a gamepad or a recording."""

from itouch.arms.interactive import Gamepad, Keyboard, Mouse
from itouch.arms.recorded_arm import Recorded

__all__ = ["Gamepad", "Keyboard", "Mouse", "Recorded"]
