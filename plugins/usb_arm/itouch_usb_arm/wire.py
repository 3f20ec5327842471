"""The arm's 16-byte frames: encoding, decoding, and finding frames in a stream that has lost bytes.

A frame is ``<``, three signed 16-bit numbers, one info byte, a spare byte and ``>``.  A number is four letters, the
least significant four bits first, each ``A`` plus its value; the info byte is 0x41 plus its bits.  Neither ``<`` nor
``>`` can occur inside a frame, and there is no checksum.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from typing import NamedTuple

#: The arm's USB ids.
VENDOR, PRODUCT = 0x0403, 0xCB48
FRAME = 16
#: Greatest motor command that is sent.
MOTOR_LIMIT = 4095
_LETTER = 0x41
_OPEN, _CLOSE = 0x3C, 0x3E
_LETTERS = bytes(range(_LETTER, _LETTER + 16))
_INFO_BITS = 0x7F


class Buttons(enum.IntFlag):
    """The buttons of the grip."""

    NONE = 0
    PLUS = 1
    FORWARD = 2
    CENTRE = 4
    MINUS = 8


class Leds(enum.IntFlag):
    """The lights of the arm."""

    OFF = 0
    GREEN = 2
    BLUE = 4
    RED = 8


#: Bit of a command that enables homing, and without which the arm forgets that it is homed.
HOMING = 1


class Numbers(NamedTuple):
    """The contents of a frame: motor commands or encoder counts, and the info bits."""

    values: tuple[int, int, int]
    info: int


class Reply(NamedTuple):
    """The arm's answer: encoder counts, pressed buttons, and which axes are homed."""

    encoders: tuple[int, int, int]
    buttons: Buttons
    homed: tuple[bool, bool, bool]


def encode(values: Sequence[int], info: int) -> bytes:
    """Return a frame with three numbers (-32768 to 32767) and info bits (0 to 127)."""
    if not 0 <= info <= _INFO_BITS:
        raise ValueError(f"info = {info} is out of range: 0 to {_INFO_BITS}")
    words = struct.pack("<3h", *values)
    letters = bytes(_LETTER + part for byte in words for part in (byte & 15, byte >> 4))
    return b"<" + letters + bytes((_LETTER + info, _LETTER)) + b">"


def decode(frame: bytes) -> Numbers:
    """Return the contents of a frame.

    Raises
    ------
    ValueError
        If it is not a frame: its length, its delimiters, a letter or the info byte is wrong.
    """
    if len(frame) != FRAME or frame[0] != _OPEN or frame[-1] != _CLOSE:
        raise ValueError(f"{frame!r} is not a frame of {FRAME} bytes in < >")
    letters, info = frame[1:13], frame[13] - _LETTER
    if letters.translate(None, _LETTERS):
        raise ValueError(f"frame {frame!r} has letters out of A to P")
    if not 0 <= info <= _INFO_BITS:
        raise ValueError(f"frame {frame!r} has the info byte 0x{frame[13]:02x}, out of 0x41 to 0xc0")
    parts = [letter - _LETTER for letter in letters]
    words = bytes(low | high << 4 for low, high in zip(parts[::2], parts[1::2], strict=True))
    one, two, three = struct.unpack("<3h", words)
    return Numbers((one, two, three), info)


def command(motors: Sequence[int], *, homing: bool, leds: Leds) -> bytes:
    """Return the frame that sets motors and lights.

    Raises
    ------
    ValueError
        If a motor command is beyond the limit.
    """
    if any(abs(motor) > MOTOR_LIMIT for motor in motors):
        raise ValueError(f"motors = {tuple(motors)} are out of range: -{MOTOR_LIMIT} to {MOTOR_LIMIT}")
    return encode(motors, int(leds) | (HOMING if homing else 0))


def reply_of(numbers: Numbers) -> Reply:
    """Interpret the numbers of a frame from the arm."""
    info = numbers.info
    homed = (bool(info & 0x10), bool(info & 0x20), bool(info & 0x40))
    return Reply(numbers.values, Buttons(info & 0x0F), homed)


class Scanner:
    """Finds frames in a stream; bytes that belong to no frame are skipped and counted."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.skipped = 0

    @property
    def pending(self) -> int:
        """Number of bytes that wait for the rest of their frame."""
        return len(self._bytes)

    def clear(self) -> None:
        """Forget all bytes received so far."""
        self._bytes.clear()
        self.skipped = 0

    def feed(self, data: bytes) -> list[Numbers]:
        """Take bytes and return the frames that they complete."""
        self._bytes += data
        found: list[Numbers] = []
        while True:
            start = self._bytes.find(b"<")
            self._drop(len(self._bytes) if start < 0 else start)
            if len(self._bytes) < FRAME:
                return found
            try:
                found.append(decode(bytes(self._bytes[:FRAME])))
            except ValueError:
                self._drop(1)
            else:
                del self._bytes[:FRAME]

    def _drop(self, count: int) -> None:
        del self._bytes[:count]
        self.skipped += count
