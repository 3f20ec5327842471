"""OpenGL contexts: of windows, and of pictures without a window, through EGL where there is no display."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.schema import ItouchError
from itouch.schema.diagnostics import reason
from itouch.world import Model
from itouch_tools.viewer.context import config
from itouch_tools.viewer.overlay import SessionStatus

if TYPE_CHECKING:
    from itouch.servo import Handle, Link
    from itouch_tools.viewer.picture import Picture
    from itouch_tools.viewer.played_session import Playback
    from itouch_tools.viewer.player_window import Player
    from itouch_tools.viewer.window import Window

_DEBIAN = "install OpenGL and EGL (on Debian: apt install libegl1 libgl1 libgl1-mesa-dri libglx-mesa0 libfontconfig1)"
ADVICE = _DEBIAN if sys.platform == "linux" else "update the driver of the graphics card, or run with --headless"


class GraphicsError(ItouchError):
    """There is no OpenGL 3.3 here; the message says what to install."""


def size_of(text: str) -> tuple[int, int]:
    """Read the size of a picture such as ``1280x720``: even numbers, 64 to 4096.

    Raises
    ------
    ValueError
        If the text is no such size.
    """
    width, _, height = text.partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        raise ValueError(f"'{text}' is not a size; write for example 1280x720") from None
    if not all(64 <= side <= 4096 and side % 2 == 0 for side in size):
        raise ValueError(f"'{text}': both numbers must be even, 64 to 4096")
    return size


def has_display() -> bool:
    """Tell whether there is a display that answers, to open a window on."""
    if sys.platform != "linux":
        return True
    if not os.environ.get("DISPLAY"):  # windows are X11's, also under Wayland
        return False
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return False
    x11.XOpenDisplay.restype = ctypes.c_void_p
    screen = x11.XOpenDisplay(None)
    if screen is None:
        return False
    x11.XCloseDisplay(ctypes.c_void_p(screen))
    return True


def open_context(width: int, height: int) -> Any:
    """Return an invisible window whose context is current.

    Raises
    ------
    GraphicsError
        If there is no usable OpenGL.
    """
    import pyglet

    if not has_display():
        pyglet.options.headless = True
    pyglet.options.shadow_window = False
    pyglet.options.audio = ("silent",)
    try:
        import pyglet.window

        return pyglet.window.Window(width, height, visible=False, config=config(), vsync=False)
    except Exception as error:  # pyglet raises other exceptions on each platform
        raise GraphicsError(f"no OpenGL 3.3 context: {reason(error)}\n  = help: {ADVICE}") from error


def open_window(link: Link, now: Callable[[], float], *, handle: Handle | None = None, mute: bool = False) -> Window:
    """Return a window on a servo process; with the launcher's ``handle``, closing it ends the session.

    Raises
    ------
    GraphicsError
        If there is no usable OpenGL.
    """
    import pyglet

    pyglet.options.audio = ("silent",) if mute else ("openal", "pulse", "silent")
    try:
        from itouch_tools.viewer.servo_source import Attached
        from itouch_tools.viewer.window import Window

        return Window(Attached(link, handle=handle), now, mute=mute)
    except ItouchError:
        raise
    except Exception as error:  # pyglet raises many kinds, one a platform
        raise GraphicsError(f"no OpenGL 3.3 window: {reason(error)}\n  = help: {ADVICE}") from error


def open_player(playback: Playback, now: Callable[[], float]) -> Player:
    """Return a window that plays a recording.

    Raises
    ------
    GraphicsError
        If there is no usable OpenGL.
    """
    import pyglet

    pyglet.options.audio = ("silent",)
    try:
        from itouch_tools.viewer.player_window import Player

        return Player(playback, now)
    except ItouchError:
        raise
    except Exception as error:  # pyglet raises many kinds, one a platform
        raise GraphicsError(f"no OpenGL 3.3 window: {reason(error)}\n  = help: {ADVICE}") from error


class Offscreen:
    """Draws States of one model to pixels."""

    def __init__(self, model: Model, *, width: int = 1280, height: int = 720) -> None:
        self._window = open_context(width, height)
        from itouch_tools.viewer.buffers import Frame
        from itouch_tools.viewer.picture import Picture

        self.picture: Picture = Picture(model, scale=min(width / 1280, height / 720))
        self._frame = Frame(width, height)

    def shoot(self, state: Record, now: SessionStatus | None = None) -> NDArray[np.uint8]:
        """Return the picture of a State, shape (height, width, 3)."""
        self._window.switch_to()
        self.picture.draw(state, self._frame, now or SessionStatus())
        return self._frame.read()

    def close(self) -> None:
        """Release the context."""
        self._frame.delete()
        self._window.close()
