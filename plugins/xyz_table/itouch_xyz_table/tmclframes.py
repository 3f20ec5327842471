"""The frames of TMCL, the language of Trinamic's modules, on a serial line: nine bytes there, nine bytes back.

Request: module, command, type, motor, value (32 bits, high byte first), sum of the eight; answer: host, module, status,
command, value, sum.  An answer says neither which parameter nor which motor it is of.  Facts: PyTrinamic 0.2.26 and the
modules' firmware manuals.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

SIZE = 9
ROTATE_RIGHT, ROTATE_LEFT, STOP, MOVE, SET_AXIS, GET_AXIS, SET_GLOBAL, GET_GLOBAL, SEARCH = 1, 2, 3, 4, 5, 6, 9, 10, 13
#: Types of MOVE and SEARCH.
ABSOLUTE = 0
SEARCH_START, SEARCH_STOP, SEARCH_STATUS = 0, 1, 2
#: Parameters of an axis: microsteps, microsteps a second, microsteps a second squared.
TARGET, ACTUAL, ACTUAL_SPEED, MAX_SPEED, MAX_ACCELERATION = 0, 1, 3, 4, 5
#: How an axis looks for its end, how fast, and how fast it leaves the switch.
SEARCH_MODE, SEARCH_SPEED, SWITCH_SPEED = 193, 194, 195
#: Search modes: the left switch only; the right one in its place.
LEFT_SWITCH, RIGHT_INSTEAD = 1, 64
#: Global parameter: after so many milliseconds without a request all motors stop; 0: never.
HEARTBEAT = 68
#: The host's address, to which a module answers: its global parameter 76, 2 as it comes from the maker.
HOST, HOST_ADDRESS = 2, 76

OK, LOADED, WRONG_SUM = 100, 101, 1
STATUS = {
    1: "a wrong check sum", 2: "an unknown command", 3: "an unknown parameter", 4: "a value that it does not take",
    5: "a locked memory", 6: "a command that it has not now",
    LOADED: "it stores commands as a program and obeys none: end its download mode, or switch it off and on",
}  # fmt: skip


class Request(NamedTuple):
    """What a host asks a module for."""

    module: int
    command: int
    type: int
    motor: int
    value: int


class Answer(NamedTuple):
    """What a module says, and to which host."""

    module: int
    status: int
    command: int
    value: int
    host: int = HOST


def check(data: bytes) -> int:
    """Return the sum of bytes that ends a frame."""
    return sum(data) & 0xFF


def request(asked: Request) -> bytes:
    """Return the frame of a request.

    Raises
    ------
    ValueError
        If its value does not fit into 32 bits.
    """
    if not -(1 << 31) <= asked.value < 1 << 31:
        raise ValueError(f"{asked.value} does not fit into 32 bits")
    data = struct.pack(">BBBBi", *asked)
    return data + bytes((check(data),))


def answer(said: Answer) -> bytes:
    """Return the frame of an answer."""
    data = struct.pack(">BBBBi", said.host, *said[:-1])
    return data + bytes((check(data),))


def heard(frame: bytes) -> Request | None:
    """Return the request of a frame; None if it is damaged."""
    if len(frame) != SIZE or check(frame[:-1]) != frame[-1]:
        return None
    return Request(*struct.unpack(">BBBBi", frame[:-1]))


def told(frame: bytes) -> Answer | None:
    """Return the answer of a frame; None if it is damaged."""
    if len(frame) != SIZE or check(frame[:-1]) != frame[-1]:
        return None
    host, module, status, command, value = struct.unpack(">BBBBi", frame[:-1])
    return Answer(module, status, command, value, host)
