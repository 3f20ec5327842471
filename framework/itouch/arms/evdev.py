"""A gamepad read directly from the Linux kernel, for machines without a display, by the kernel's layout of gamepads.

Source: Linux documentation, "Linux Gamepad Specification" and "Input event codes".
"""

from __future__ import annotations

import glob
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass

#: An input event: time, type, code, value.
_EVENT = struct.Struct("@llHHi")
_SYN, _KEY, _ABS = 0, 1, 3
_DROPPED = 3
#: Codes of the button that every gamepad has, and of the axes that are used: left stick, right stick up and down.
GAMEPAD, LEFT_X, LEFT_Y, RIGHT_Y = 0x130, 0, 1, 4
_AXES = {LEFT_X: "leftx", LEFT_Y: "lefty", RIGHT_Y: "righty"}
_READ, _NAME_BYTES = 2, 256


@dataclass(frozen=True, slots=True)
class Description:
    """What the kernel knows of an input device: its name, its keys, and the range of each axis that is used."""

    name: str
    keys: frozenset[int]
    axes: dict[int, tuple[int, int]]


def describe(descriptor: int) -> Description:
    """Ask the kernel what an open input device is.

    Raises
    ------
    OSError
        If it is not one.
    """
    name = _ask(descriptor, 0x06, _NAME_BYTES).split(b"\0")[0].decode(errors="replace")
    keys = _bits(_ask(descriptor, 0x20 + _KEY, 96))
    axes = {}
    for code in _bits(_ask(descriptor, 0x20 + _ABS, 8)) & _AXES.keys():
        _, low, high, *_ = struct.unpack("6i", _ask(descriptor, 0x40 + code, 24))
        axes[code] = (low, high)
    return Description(name, frozenset(keys), axes)


def _ask(descriptor: int, number: int, size: int) -> bytes:
    from fcntl import ioctl

    buffer = bytearray(size)
    ioctl(descriptor, _READ << 30 | size << 16 | ord("E") << 8 | number, buffer)
    return bytes(buffer)


def _bits(data: bytes) -> set[int]:
    return {8 * at + bit for at, byte in enumerate(data) for bit in range(8) if byte >> bit & 1}


class EventPad:
    """An open gamepad: its sticks, -1 to 1, right and down positive, as in `itouch.arms.gamepad.Controller`."""

    def __init__(self, descriptor: int, description: Description) -> None:
        self._descriptor = descriptor
        self._ranges, self.name = description.axes, description.name
        self.leftx = self.lefty = self.righty = 0.0
        self.is_open = True
        self.device = self

    def open(self) -> None:
        """Do nothing: it is open already."""

    def poll(self) -> bool:
        """Read all events that have arrived; return False, as there is nothing left for ``select``."""
        while self.is_open:
            try:
                data = os.read(self._descriptor, 64 * _EVENT.size)
            except BlockingIOError:
                return False
            except OSError:
                data = b""
            if not data:
                self.close()
                return False
            for _, _, kind, code, value in _EVENT.iter_unpack(data[: len(data) // _EVENT.size * _EVENT.size]):
                if kind == _ABS and code in self._ranges and code in _AXES:
                    low, high = self._ranges[code]
                    part = (2.0 * value - low - high) / (high - low) if high > low else 0.0
                    setattr(self, _AXES[code], max(-1.0, min(1.0, part)))
                elif kind == _SYN and code == _DROPPED:  # the kernel's queue overflowed: rest rather than stick
                    self.leftx = self.lefty = self.righty = 0.0
        return False

    def select(self) -> None:
        """Do nothing: `poll` has read everything."""

    def close(self) -> None:
        """Close the gamepad."""
        if self.is_open:
            self.is_open = False
            os.close(self._descriptor)


def find(
    folder: str = "/dev/input", *, look: Callable[[int], Description] = describe
) -> tuple[EventPad | None, list[str]]:
    """Open the first gamepad; return it, or None, and the device files that this user may not read.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    """
    if not os.path.isdir(folder):
        raise FileNotFoundError(folder)
    refused = []
    for path in sorted(glob.glob(os.path.join(glob.escape(folder), "event*"))):
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except PermissionError:
            refused.append(path)
            continue
        except OSError:
            continue
        try:
            found = look(descriptor)
        except OSError:
            found = None
        if found is not None and GAMEPAD in found.keys:
            return EventPad(descriptor, found), refused
        os.close(descriptor)
    return None, refused
