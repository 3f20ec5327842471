"""Virtual arms: a mouse, a keyboard or a gamepad leads the finger on them, or a recording does."""

from itouch.arms.interactive import Gamepad, Keyboard, Mouse
from itouch.arms.recorded import Recorded

__all__ = ["Gamepad", "Keyboard", "Mouse", "Recorded"]
