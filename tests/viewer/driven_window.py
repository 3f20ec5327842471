"""A window that a script drives: it turns the time, presses keys, and looks at the pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Driven:
    """Turns the time of a window, which is ``clock[0]`` [s], and sends it events."""

    def __init__(self, window: Any, clock: list[float]) -> None:
        self._window, self._clock = window, clock

    def turn(self, frames: int = 1, period: float = 1 / 60) -> None:
        """Draw frames, one each period [s]."""
        for _ in range(frames):
            self._clock[0] += period
            self._window.dispatch_events()
            self._window.frame()

    def tell(self, *event: Any) -> None:
        """Send an event, through the queue."""
        self._window.dispatch_event(*event)
        self._window.dispatch_events()

    def press(self, symbol: int, modifiers: int = 0) -> None:
        """Press a key and release it, unless it closes the window."""
        self.tell("on_key_press", symbol, modifiers)
        if not self._window.closed:
            self.tell("on_key_release", symbol, modifiers)

    def pixels(self) -> NDArray[Any]:
        """Return the picture, shape (height, width, 3)."""
        self._window.switch_to()
        return np.asarray(self._window._target.read().astype(int))


def changed(a: NDArray[Any], b: NDArray[Any]) -> int:
    """Return how many pixels of two pictures differ clearly."""
    return int((np.abs(a - b).max(2) > 24).sum())
