"""A gamepad, read by polling: it needs neither a window nor an event loop."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from typing import Any, Protocol

from itouch.arms import evdev

Vector = tuple[float, float, float]
#: Dead zone of a stick, as a share of its travel.
REST = 0.15


class PadError(Exception):
    """No gamepad can be used; the message says why."""


class Controller(Protocol):
    """The part of pyglet's controllers that is used: the sticks, -1 to 1, down and right positive."""

    device: Any
    leftx: float
    lefty: float
    righty: float

    def open(self) -> None:
        """Begin to read it."""

    def close(self) -> None:
        """End reading it."""


class Pad:
    """An open gamepad."""

    def __init__(self, controller: Controller) -> None:
        self._controller: Controller | None = controller
        self.name = str(getattr(controller, "name", None) or getattr(controller.device, "name", "") or "gamepad")
        controller.open()

    @property
    def connected(self) -> bool:
        """Whether it is still there."""
        return self._controller is not None

    def sticks(self) -> Vector:
        """Return the deflections of the sticks, -1 to 1: left stick right and up, right stick up; 0 near the middle.

        A gamepad that was unplugged stays at rest.
        """
        if self._controller is not None:
            self._poll(self._controller)
        pad = self._controller
        if pad is None:
            return (0.0, 0.0, 0.0)
        return _rested(pad.leftx), _rested(-pad.lefty), _rested(-pad.righty)

    def _poll(self, controller: Controller) -> None:
        """Let pyglet read the events that have arrived: on Linux only its event loop, which we do not run, does so."""
        device = controller.device
        if not (hasattr(device, "poll") and hasattr(device, "select")):
            return
        try:
            while getattr(device, "is_open", True) and device.poll():
                device.select()
        except (OSError, ValueError, TypeError):  # pyglet's descriptor of a device that was unplugged is None
            self._controller = None
        if not getattr(device, "is_open", True) or getattr(device, "connected", True) is False:
            self._controller = None
        if self._controller is None:
            logging.getLogger(__name__).warning("gamepad: %s was unplugged", self.name)

    def close(self) -> None:
        """Close the gamepad; it is no error if it is gone."""
        controller, self._controller = self._controller, None
        if controller is not None:
            with contextlib.suppress(Exception):
                controller.close()


def _rested(value: float) -> float:
    return float(value) if abs(value) > REST else 0.0


def find_pad() -> Pad:
    """Open the first gamepad that pyglet finds; on Linux, without a display or if it finds none, that of the kernel.

    Raises
    ------
    PadError
        If there is none, or it may not be read.
    """
    controller = _first()
    try:
        return Pad(controller)
    except Exception as error:
        raise PadError(f"the gamepad cannot be opened: {error}") from error


def _first() -> Controller:
    if not sys.platform.startswith("linux"):
        return _of_pyglet()
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        with contextlib.suppress(PadError):  # it knows the layouts of many gamepads, but not of all
            return _of_pyglet()
    return _of_kernel()


def _of_kernel() -> Controller:
    try:
        found, refused = evdev.find()
    except OSError as error:
        raise PadError("none: there is no folder /dev/input on this machine") from error
    if found is None:
        advice = f"; this user may not read {', '.join(refused)}: join the group 'input'" if refused else ""
        raise PadError(f"none is attached{advice}")
    return found


def _of_pyglet() -> Controller:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of gamepads without a stored mapping
            import pyglet.input

            found = pyglet.input.get_controllers()
    except FileNotFoundError as error:
        raise PadError("none: there is no folder /dev/input on this machine") from error
    except Exception as error:  # each platform fails in its own way without gamepads
        raise PadError(f"gamepads cannot be looked for: {type(error).__name__}: {error}") from error
    if not found:
        raise PadError("none is attached, or this user may not read it (on Linux: join the group 'input')")
    first: Controller = found[0]
    return first
