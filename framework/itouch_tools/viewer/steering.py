"""How a person leads the finger of a simulated session from a window: by mouse, keys or gamepad."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pyglet.window import key

from itouch.arms.gamepad import Pad, PadError, find_pad
from itouch.world.model import led
from itouch_tools.viewer.session_source import Source

Vector = tuple[float, float, float]
#: Motion of the finger per pixel of the mouse [m], and its speeds [m/s] by keys and with a stick fully deflected, where
#: the arm does not set its own.
PIXEL, KEY_SPEED, STICK_SPEED = 0.1e-3, 0.03, 0.06
#: Pixels for which a notch of the wheel stands, and the longest time [s] that a single frame counts for.
_NOTCH, _LONGEST = 10.0, 0.1
_ARROWS: Mapping[int, Vector] = {
    key.LEFT: (-1, 0, 0), key.RIGHT: (1, 0, 0), key.UP: (0, 1, 0), key.DOWN: (0, -1, 0),
    key.PAGEUP: (0, 0, 1), key.PAGEDOWN: (0, 0, -1),
}  # fmt: skip
_WORDS = {
    "mouse": "the mouse leads the finger, its wheel the height",
    "keyboard": "the arrow keys lead the finger, Page Up and Down the height",
    "gamepad": "the left stick leads the finger, the right one the height",
}


class Steering:
    """Leads the first probe's finger: from the start if its arm is led by a person, else when M is pressed.

    Calls return a message to show, if any.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        arm = next((arm for probe, arm in led(source.model) if probe is source.model.probes[0]), None)
        self._by = arm.cls.input_source if arm is not None else ""
        self._pixel = getattr(arm.params, "step", PIXEL) if arm is not None else PIXEL
        speed = getattr(arm.params, "speed", None) if arm is not None else None
        self._keys = speed if self._by == "keyboard" and speed else KEY_SPEED
        self._stick = speed if self._by == "gamepad" and speed else STICK_SPEED
        #: Whether mouse and gamepad may lead the finger; keys always may.
        self.on = False
        #: The gamepad, if there is one.
        self.pad: Pad | None = None
        self._missing = ""
        try:
            self.pad = find_pad()
        except PadError as error:
            self._missing = str(error)

    def begin(self) -> str:
        """Take the finger over if its arm is one that a person leads."""
        if not self._by:
            return ""
        if self._by == "gamepad" and self.pad is None:
            return f"gamepad: {self._missing}; M gives the finger to the mouse"
        refused = self._source.steer((0.0, 0.0, 0.0))
        self.on = not refused
        return refused or _WORDS[self._by]

    def toggle(self) -> str:
        """Take the finger over, or give it back to its script."""
        self.on = not self.on
        refused = self._source.steer((0.0, 0.0, 0.0) if self.on else None)
        return refused or ("the mouse moves the finger" if self.on else "the finger follows its script")

    def frame(self, elapsed: float, held: Iterable[int]) -> str:
        """Move the finger by held keys and by the gamepad for the time [s] since the last frame."""
        elapsed = min(elapsed, _LONGEST)
        step = self._sticks(self._stick * elapsed)
        for symbol in held:
            x, y, z = _ARROWS.get(symbol, (0, 0, 0))
            way = self._keys * elapsed
            step = step[0] + way * x, step[1] + way * y, step[2] + way * z
        return self._source.steer(step) if any(step) else ""

    def _sticks(self, way: float) -> Vector:
        if self.pad is None:
            return (0.0, 0.0, 0.0)
        x, y, z = self.pad.sticks()  # also while they do not lead: events that wait must not act later
        return (way * x, way * y, way * z) if self.on and self._by in ("", "gamepad") else (0.0, 0.0, 0.0)

    def moved(self, dx: int, dy: int) -> str:
        """Move the finger horizontally, if the mouse leads it."""
        return self._source.steer((self._pixel * dx, self._pixel * dy, 0.0)) if self._mouse() else ""

    def scrolled(self, notches: float) -> str | None:
        """Raise or lower the finger, if the mouse leads it; None if it does not."""
        return self._source.steer((0.0, 0.0, _NOTCH * self._pixel * notches)) if self._mouse() else None

    def _mouse(self) -> bool:
        return self.on and (self._by in ("", "mouse") or (self._by == "gamepad" and self.pad is None))

    def close(self) -> None:
        """Release the gamepad."""
        if self.pad is not None:
            self.pad.close()
