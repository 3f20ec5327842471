"""Simulated arms whose finger a person leads by mouse, keyboard or gamepad.

The finger holds an arm without mass or friction.  Its hand follows the person if there is a window (a gamepad needs
none), and otherwise the scene's ``<operator>``.  The arm's force moves the simulated finger; nobody feels it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from itouch.arms.gamepad import PadError, find_pad
from itouch.arms.twin_only import TwinOnlyArm
from itouch.plugin import Attached, OperatorInput, pose, schema

Vector = tuple[float, float, float]
_START: Vector = (0.0, 0.0, 0.05)


def _start() -> Any:
    return schema.quantity(
        "m", size=3, low=-1.0, high=1.0, default=_START, doc="where the finger starts if the scene has no operator"
    )


@dataclass(frozen=True, slots=True)
class MouseParams:
    """A simulated arm whose finger the mouse leads."""

    start: Vector = _start()
    step: float = schema.quantity("m", low=1e-6, high=0.01, default=1e-4, doc="how far the finger goes for a pixel")


@dataclass(frozen=True, slots=True)
class KeyboardParams:
    """A simulated arm whose finger the keyboard leads."""

    start: Vector = _start()
    speed: float = schema.quantity(
        "m/s", low=1e-4, high=0.3, default=0.03, doc="speed of the finger while a key is held"
    )


@dataclass(frozen=True, slots=True)
class GamepadParams:
    """A simulated arm whose finger a gamepad leads."""

    start: Vector = _start()
    speed: float = schema.quantity(
        "m/s", low=1e-4, high=0.3, default=0.06, doc="speed of the finger with a stick fully to one side"
    )


class LedArm(TwinOnlyArm):
    """A simulated arm whose finger a person leads."""

    reads = (pose(locked=(3, 4, 5)),)


class Mouse(LedArm):
    """A simulated arm whose finger the mouse leads horizontally in the window, and its wheel up and down."""

    Params = MouseParams
    operator_input = OperatorInput(input_source="mouse")

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Tell whether there is a screen, and with it a mouse."""
        return (_window("moves the finger across; its wheel raises and lowers it"),)


class Keyboard(LedArm):
    """A simulated arm whose finger the arrow keys lead horizontally in the window, and Page Up and Down up and down."""

    Params = KeyboardParams
    operator_input = OperatorInput(input_source="keyboard")

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Tell whether there is a screen, and with it a keyboard."""
        return (_window("the arrow keys move the finger across, Page Up and Page Down raise and lower it"),)


class Gamepad(LedArm):
    """A simulated arm whose finger a gamepad leads: the left stick horizontally, the right one up and down."""

    Params = GamepadParams
    operator_input = OperatorInput(input_source="gamepad")

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Look for a gamepad."""
        try:
            pad = find_pad()
        except PadError as error:
            return (Attached("gamepad", False, str(error)),)
        try:
            return (Attached(pad.name, True, "the left stick moves the finger across, the right one up and down"),)
        finally:
            pad.close()


def _window(note: str) -> Attached:
    screen = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if screen:
        return Attached(f"the window on {screen}", True, note)
    return Attached("the window", False, "there is no display: the finger follows the scene's <operator>")
