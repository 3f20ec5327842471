"""The frames of TMCL, the language of Trinamic's modules, on a serial line: nine bytes out, nine bytes back.

Request: module, command, type, motor, value (32 bits, high byte first), sum of the eight; answer: host, module, status,
command, value, sum.  An answer tells neither the parameter nor the motor that it is about.  Source: PyTrinamic 0.2.26
and the modules' firmware manuals.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

SIZE = 9
ROTATE_RIGHT, ROTATE_LEFT, STOP, MOVE, SET_AXIS, GET_AXIS, SET_GLOBAL, GET_GLOBAL, SEARCH = 1, 2, 3, 4, 5, 6, 9, 10, 13
#: Types of MOVE and SEARCH.
ABSOLUTE = 0
SEARCH_START, SEARCH_STOP, SEARCH_STATUS = 0, 1, 2
#: Parameters of an axis: target, position [microsteps], speed, its limit [1/s], limit of acceleration [1/s2].
TARGET, ACTUAL, ACTUAL_SPEED, MAX_SPEED, MAX_ACCELERATION = 0, 1, 3, 4, 5
#: How an axis searches for its end, how fast, and how fast it leaves the switch.
SEARCH_MODE, SEARCH_SPEED, SWITCH_SPEED = 193, 194, 195
#: Search modes: the left switch only; plus this, the right one in its place.
LEFT_SWITCH, RIGHT_INSTEAD = 1, 64
#: Global parameter: all motors stop after this many milliseconds without a request; 0: never.
HEARTBEAT = 68
#: The host's address, to which a module answers, and the global parameter that holds it; the factory setting is 2.
HOST, HOST_ADDRESS = 2, 76

OK, LOADED, WRONG_SUM = 100, 101, 1
STATUS = {
    1: "a wrong check sum", 2: "an unknown command", 3: "an unknown parameter", 4: "a value that it does not take",
    5: "a locked memory", 6: "a command that it does not have at present",
    LOADED: "it stores commands as a program and obeys none: end its download mode, or switch it off and on",
}  # fmt: skip


class Request(NamedTuple):
    """A host's request to a module."""

    module: int
    command: int
    type: int
    motor: int
    value: int


class Answer(NamedTuple):
    """A module's answer to a host."""

    module: int
    status: int
    command: int
    value: int
    host: int = HOST


def check(data: bytes) -> int:
    """Return the checksum that ends a frame: the sum of its bytes, modulo 256."""
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
    """Return the request in a frame; None if the frame is damaged."""
    if len(frame) != SIZE or check(frame[:-1]) != frame[-1]:
        return None
    return Request(*struct.unpack(">BBBBi", frame[:-1]))


def told(frame: bytes) -> Answer | None:
    """Return the answer in a frame; None if the frame is damaged."""
    if len(frame) != SIZE or check(frame[:-1]) != frame[-1]:
        return None
    host, module, status, command, value = struct.unpack(">BBBBi", frame[:-1])
    return Answer(module, status, command, value, host)
