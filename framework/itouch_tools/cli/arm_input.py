"""Who leads the finger on an arm that is led by a person, if there is no window: a gamepad, or the scene's operator."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.terminal import note

if TYPE_CHECKING:
    from itouch.arms.gamepad import Pad
    from itouch.servo import Handle
    from itouch.world import Model

#: Longest time [s] that a single look at the gamepad counts for.
_LONGEST = 0.1


class GamepadInput:
    """A gamepad that leads the hand of one probe in a launched session."""

    def __init__(self, pad: Pad, probe: str, speed: float) -> None:
        self._pad, self._probe, self._speed = pad, probe, speed
        self._last = time.monotonic()
        self._taken = False

    def lead(self, handle: Handle) -> None:
        """Move the hand as the sticks ask for the time since the last call."""
        from itouch.servo import ServoError

        now = time.monotonic()
        elapsed, self._last = min(now - self._last, _LONGEST), now
        sticks = self._pad.sticks()
        if any(sticks) or not self._taken:
            self._taken = True  # the script waits from now on
            x, y, z = (self._speed * elapsed * part for part in sticks)
            with contextlib.suppress(ServoError):  # the session has just ended, which is reported elsewhere
                handle.command("steer", {"probe": self._probe, "step": (x, y, z)})

    def close(self) -> None:
        """Release the gamepad."""
        self._pad.close()


def without_window(model: Model, *, real: bool) -> GamepadInput | None:
    """Return the gamepad that leads the finger of a scene run without a window; None: the scene's operator leads it.

    Parameters
    ----------
    model
        The compiled scene.
    real
        Whether the scene runs in real time: nobody can lead a finger in a simulation that runs faster.

    Raises
    ------
    ItouchError
        If nobody would lead the finger.
    """
    from itouch.arms.gamepad import PadError, find_pad
    from itouch.world.model import led

    for probe, arm in led(model):
        reason = f"the {arm.cls.input_source} leads it in a window, and there is none"
        if arm.cls.input_source == "gamepad":
            reason = "a gamepad leads it in real time only"
            if real:
                try:
                    return GamepadInput(find_pad(), probe.name, arm.params.speed)
                except PadError as error:
                    reason = f"gamepad: {error}"
        operator = probe.operator
        if operator is None or not (operator.motion.targets or operator.motion.file):
            advice = f"open a window, or give probe '{probe.name}' an <operator> with a <motion> to follow"
            raise ItouchError(f"nobody leads the finger on arm '{arm.name}' ({reason})\n  = help: {advice}")
        note(f"arm '{arm.name}': {reason}; the finger follows its <operator>")
    return None
