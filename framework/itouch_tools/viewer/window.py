"""The window: keys and mouse, and at most sixty pictures a second."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import pyglet.window
from pyglet.window import key, mouse

from itouch_tools.sound.player import Speaker
from itouch_tools.viewer.buffers import Frame
from itouch_tools.viewer.context import config, write_png
from itouch_tools.viewer.picture import Picture
from itouch_tools.viewer.session_source import Source
from itouch_tools.viewer.steering import Steering

#: Most frames a second, and the share of one core that drawing may take: software rendering would take all cores.
RATE, SHARE = 60.0, 0.8
#: Longest rest [s] between two frames.
MOST_REST = 1.0
#: How long [s] a message stays on the screen.
SAID = 4.0
#: Period [s] at which keys are handled between two frames.
LISTEN = 0.02
_NUMBERS = {key._1: "operator", key._2: "front", key._3: "side", key._4: "top", key._5: "corner"}  # noqa: SLF001

#: Keys that make words larger and smaller, and by what factor's change.
_LARGER = {key.PLUS: 0.25, key.EQUAL: 0.25, key.NUM_ADD: 0.25, key.MINUS: -0.25, key.NUM_SUBTRACT: -0.25}


class Window(pyglet.window.Window):
    """Shows a session and passes the person's commands to it; ``frame`` draws one picture, ``show`` runs until closed.

    Parameters
    ----------
    source
        The session.
    now
        Returns the host's time [s]; tests give their own.
    mute
        Play no sound.
    """

    def __init__(
        self, source: Source, now: Callable[[], float], *, width: int = 1280, height: int = 720, mute: bool = True,
    ) -> None:  # fmt: skip
        super().__init__(
            width, height, caption=f"itouch-py: {os.path.basename(source.model.scene.source) or 'scene'}",
            resizable=True, config=config(), vsync=False,
        )  # fmt: skip
        self.source, self._now = source, now
        if self.scale > 1.0:  # a screen with small pixels: make the window as large as on others
            room = self.screen
            self.set_size(min(round(width * self.scale), room.width), min(round(height * self.scale), room.height))
        self.picture = Picture(source.model, scale=max(self.scale, self.get_pixel_ratio()))
        self._target = Frame(*self.get_framebuffer_size())
        self.picture.choices.menu = True
        self._keys: set[int] = set()
        self._pressed: int | None = None  # the key that the mouse presses in the menu
        self._steering = Steering(source)
        self._moved = False
        self._last = now()
        self._said_at = -10.0
        self.cost = 0.0  # seconds that the last picture took
        self.closed = False
        self._speaker = Speaker(source.model, mute=mute)
        self._say(self._steering.begin() or "H, or the button, opens the menu")

    def show(self, *, while_: Callable[[], bool] = lambda: True) -> None:
        """Draw and handle events until the window is closed, or ``while_`` returns false."""
        used = time.process_time()
        try:
            while True:
                begin = self._now()
                self.dispatch_events()
                if self.closed or not while_():
                    return
                self.frame()
                before, used = used, time.process_time()  # of all threads, those of software rendering included
                rest = max(1.0 / RATE, (used - before) / SHARE)
                self._rest(begin + min(MOST_REST, rest))
        finally:
            self._speaker.close()
            self._steering.close()
            self.close()

    def _rest(self, end: float) -> None:
        """Rest until a time [s], but go on handling keys, so that they act at once even at a low frame rate."""
        while (left := end - self._now()) > 0.0 and not self.closed:
            time.sleep(min(left, LISTEN))
            if left > LISTEN:
                self.dispatch_events()
                self.source.beat()

    def frame(self) -> None:
        """Bring the session up to date and draw it once."""
        begin = self._now()
        elapsed, self._last = begin - self._last, begin
        self._say(self._steering.frame(elapsed, self._keys))
        status = self.source.status
        if begin - self._said_at > SAID:
            status.message = ""
        said = status.message
        self.source.advance(elapsed, self.picture.ring)
        if status.message != said:
            self._said_at = begin
        self.picture.ring.add(self.source.state)
        self._speaker.hear(self.source.state)
        self.picture.choices.sound = None if self._speaker.muted else not self._speaker.hushed
        self.switch_to()
        self.picture.draw(self.source.state, self._target, self.source.status)
        self._target.blit()
        self.flip()
        self.cost = self._now() - begin

    def screenshot(self, path: str | os.PathLike[str]) -> None:
        """Write the present picture to a PNG file."""
        self.switch_to()
        self.picture.draw(self.source.state, self._target, self.source.status)
        write_png(path, self._target.read())

    def _say(self, words: str) -> None:
        if words:
            self.source.status.message, self._said_at = words, self._now()

    def on_key_press(self, symbol: int, modifiers: int) -> None:
        """Act on a key; see ``overlay.KEYS``."""
        chosen, source = self.picture.choices, self.source
        self._keys.add(symbol)
        if symbol == key.H:
            chosen.help = not chosen.help
        elif symbol == key.T:
            chosen.thermal = not chosen.thermal
        elif symbol == key.G:
            chosen.aids = not chosen.aids
        elif symbol == key.C:
            chosen.curves = not chosen.curves
        elif symbol == key.D:
            chosen.under = not self.picture.under
        elif symbol == key.N:
            chosen.names = not chosen.names
        elif symbol == key.L:
            chosen.light = not chosen.light
        elif symbol in _LARGER:
            chosen.larger = min(2.5, max(1.0, chosen.larger + _LARGER[symbol]))
        elif symbol == key.F:
            self.picture.reframe(source.state, self._target)
        elif symbol in _NUMBERS:
            self.picture.camera.look(_NUMBERS[symbol])
        else:
            self._ask(symbol)

    def _ask(self, symbol: int) -> None:
        """Ask the session for what a key stands for."""
        source = self.source
        if symbol == key.P:
            self._say(source.pause())
        elif symbol == key.S:
            self._say(source.save())
        elif symbol == key.R:
            self._say(source.rearm())
        elif symbol == key.U:
            self._say(self._speaker.turn())
        elif symbol == key.M:
            self._say(self._steering.toggle())
        elif symbol == key.SPACE:
            source.hold(True)
        elif symbol == key.ESCAPE:
            self.on_close()

    def on_key_release(self, symbol: int, modifiers: int) -> None:
        """Let a held key go."""
        self._keys.discard(symbol)
        if symbol == key.SPACE:
            self.source.hold(False)

    def on_deactivate(self) -> None:
        """Let go of everything when another window takes the focus."""
        self._pressed = None
        self._keys.clear()
        self.source.hold(False)

    def on_mouse_press(self, x: int, y: int, button: int, modifiers: int) -> None:
        """Press a key of the menu, or begin a drag or a click."""
        self._moved = False
        self._pressed = self._key_at(x, y) if button == mouse.LEFT else None
        if self._pressed is not None:
            self.on_key_press(self._pressed, modifiers)

    def on_mouse_drag(self, x: int, y: int, dx: int, dy: int, buttons: int, modifiers: int) -> None:
        """Orbit, or pan with Shift or another button than the left."""
        if self._pressed is not None:
            return
        self._moved = self._moved or abs(dx) + abs(dy) > 0
        if buttons & mouse.LEFT and not modifiers & key.MOD_SHIFT:
            self.picture.camera.orbit(0.4 * dx, 0.4 * dy)
        else:
            self.picture.camera.pan(dx / self.height, dy / self.height)

    def on_mouse_release(self, x: int, y: int, button: int, modifiers: int) -> None:
        """Let a key of the menu go, or show the properties of what was clicked."""
        if self._pressed is not None:
            self._let_go()
            return
        if self._moved or button != mouse.LEFT:
            return
        ratio = self.get_pixel_ratio()
        self.switch_to()
        self.source.status.picked = self.picture.canvas.pick(
            self.source.state, self.picture.camera, self._target, int(x * ratio), int(y * ratio)
        )

    def _key_at(self, x: int, y: int) -> int | None:
        """Return the key under the mouse, if the menu or a button is there, else None."""
        ratio = self.get_pixel_ratio()
        name = next((place.key for place in self.picture.menu if place.holds(x * ratio, y * ratio)), "")
        return getattr(key, name) if name else None

    def _let_go(self) -> None:
        if self._pressed is not None:
            self.on_key_release(self._pressed, 0)
        self._pressed = None

    def on_mouse_motion(self, x: int, y: int, dx: int, dy: int) -> None:
        """Note where the mouse points, and move the finger horizontally if the mouse leads it."""
        self.picture.pointed = (x * self.get_pixel_ratio(), y * self.get_pixel_ratio())
        self._say(self._steering.moved(dx, dy))

    def on_mouse_leave(self, x: int, y: int) -> None:
        """Point at nothing any more."""
        self.picture.pointed = (-1.0, -1.0)

    def on_mouse_scroll(self, x: int, y: int, scroll_x: float, scroll_y: float) -> None:
        """Zoom, or raise and lower the finger if the mouse leads it."""
        said = self._steering.scrolled(scroll_y)
        if said is None:
            self.picture.camera.zoom(scroll_y)
        else:
            self._say(said)

    def on_resize(self, width: int, height: int) -> None:
        """Take the new size; a window without width or height keeps the size of its picture."""
        self.switch_to()
        size = self.get_framebuffer_size()
        if hasattr(self, "_target") and min(size) > 0 and size != (self._target.width, self._target.height):
            self._target.delete()
            self._target = Frame(*size)
        self._orthogonal(*size)

    def on_scale(self, scale: float, dpi: int) -> None:
        """Adapt the size of words to a screen with another density of pixels."""
        if hasattr(self, "picture"):
            self.picture.scale = max(scale, self.get_pixel_ratio())

    def _orthogonal(self, width: int, height: int) -> None:
        from pyglet.math import Mat4

        self.projection = Mat4.orthogonal_projection(0, max(width, 1), 0, max(height, 1), -255, 255)

    def on_close(self) -> None:
        """Stop safely; the window closes when its events have been handled."""
        self.closed = True
        self.source.hold(False)
        self.source.stop()

    def on_context_lost(self) -> None:
        """Recreate everything in graphics memory; curves, camera and choices stay."""
        before = self.picture
        self.picture = Picture(self.source.model, scale=before.scale)
        self.picture.ring, self.picture.camera, self.picture.choices = before.ring, before.camera, before.choices
        self._target = Frame(*self.get_framebuffer_size())

    def on_refresh(self, *_: Any) -> None:
        """Count the time between frames from now on; the next frame redraws what was uncovered or lost."""
        self._last = self._now()
