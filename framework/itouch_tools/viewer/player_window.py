"""The window of a recording that is played: its keys, and the mouse on the time line, move about in it."""

from __future__ import annotations

from collections.abc import Callable

from pyglet.window import key, mouse

from itouch_tools.viewer.played_session import Playback
from itouch_tools.viewer.timeline_drawing import time_at
from itouch_tools.viewer.window import Window

#: Keys that repeat while they are held, and by how many ticks a press moves on: without Shift, and with it.
_STEPS = {key.LEFT: (-1, -100), key.RIGHT: (1, 100)}
#: Seconds after which a held key first repeats, and the period [s] from then on.
_WAIT, _AGAIN = 0.4, 0.05


class Player(Window):
    """Shows a recording; see ``overlay.PLAYBACK_KEYS``."""

    def __init__(self, playback: Playback, now: Callable[[], float], *, width: int = 1280, height: int = 720) -> None:
        super().__init__(playback, now, width=width, height=height, mute=True)
        self.playback = playback
        self.picture.ring = playback.curves
        self._winding = False
        self._stepping: tuple[int, float] | None = None

    def frame(self) -> None:
        """Repeat the step of a held key, and draw once."""
        if self._stepping is not None and self._now() >= self._stepping[1]:
            ticks = self._stepping[0]
            self.playback.step(ticks)
            self._stepping = ticks, self._now() + _AGAIN
        super().frame()

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Act on a key of the recording, or on one of every window."""
        playback = self.playback
        if symbol in _STEPS:
            ticks = _STEPS[symbol][bool(modifiers & key.MOD_SHIFT)]
            playback.step(ticks)
            self._stepping = ticks, self._now() + _WAIT
        elif symbol in (key.UP, key.DOWN):
            playback.faster(2.0 if symbol == key.UP else 0.5)
        elif symbol in (key.PAGEUP, key.PAGEDOWN):
            playback.jump(1 if symbol == key.PAGEDOWN else -1)
        elif symbol in (key.HOME, key.END):
            playback.seek(playback.line.first if symbol == key.HOME else playback.line.last)
        elif symbol == key.M:
            self._say(playback.steer(None))
        else:
            super().on_key_press(symbol, modifiers)

    def on_key_release(self, symbol: int, modifiers: int) -> None:
        """Let a held key go."""
        if symbol in _STEPS:
            self._stepping = None
        super().on_key_release(symbol, modifiers)

    def on_deactivate(self) -> None:
        """Let go of everything when another window takes the focus."""
        self._stepping, self._winding = None, False
        super().on_deactivate()

    def on_mouse_press(self, x: int, y: int, button: int, modifiers: int) -> None:
        """Go to the time at which the time line is pressed, or begin a drag."""
        self._winding = button == mouse.LEFT and self._on_bar(x, y)
        if self._winding:
            self._wind(x)
        super().on_mouse_press(x, y, button, modifiers)

    def on_mouse_drag(self, x: int, y: int, dx: int, dy: int, buttons: int, modifiers: int) -> None:
        """Move along the time line, or move the camera."""
        if self._winding:
            self._wind(x)
        else:
            super().on_mouse_drag(x, y, dx, dy, buttons, modifiers)

    def on_mouse_release(self, x: int, y: int, button: int, modifiers: int) -> None:
        """End moving along the time line, or show the properties of what was clicked."""
        if self._winding:
            self._winding = False
        else:
            super().on_mouse_release(x, y, button, modifiers)

    def _on_bar(self, x: int, y: int) -> bool:
        """Tell whether a position of the mouse is on the time line, or a little beside it."""
        if self.picture.bar is None:
            return False
        left, bottom, width, height = self.picture.bar
        ratio, beside = float(self.get_pixel_ratio()), 0.5 * height
        across = left - beside <= x * ratio <= left + width + beside
        return across and bottom - beside <= y * ratio <= bottom + 2 * height

    def _wind(self, x: int) -> None:
        if self.picture.bar is not None:
            self.playback.seek(time_at(self.playback.line, self.picture.bar, x * self.get_pixel_ratio()))
