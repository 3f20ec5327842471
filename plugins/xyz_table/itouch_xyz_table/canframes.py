"""The frames of ODrive's CAN Simple protocol, as numbers and as bytes.

An identifier is the servo's number shifted left by five bits, with the command in the lower five; data are
little-endian.  A query is a remote frame with the command's identifier.  Source: ODrive's documentation, firmware 0.5
and 0.6.
"""

from __future__ import annotations

import struct

HEARTBEAT, ESTOP, SET_STATE, ESTIMATES = 0x01, 0x02, 0x07, 0x09
SET_MODE, SET_POSITION, SET_VELOCITY, SET_LIMITS = 0x0B, 0x0C, 0x0D, 0x0F
CURRENTS, SUPPLY, CLEAR_ERRORS = 0x14, 0x17, 0x18
#: States of an axis; control modes (velocity, position), and the input mode that passes goals through unfiltered.
IDLE, CLOSED_LOOP = 1, 8
BY_VELOCITY, BY_POSITION, FOLLOW = 2, 3, 1
#: Formats of the commands' data: for example, a position with velocity and torque feed-forward in 1/1000.
_PACKED = {
    SET_STATE: "<I", SET_MODE: "<II", SET_POSITION: "<fhh", SET_VELOCITY: "<ff", SET_LIMITS: "<ff",
    ESTIMATES: "<ff", CURRENTS: "<ff", SUPPLY: "<f", CLEAR_ERRORS: "<B", ESTOP: "<",
}  # fmt: skip
MILLI = 1000.0
#: The error bits of an expired watchdog: of firmware 0.6, and of 0.5.
WATCHDOG_ENDED = 0x1000000 | 0x800

#: Meaning of each error bit; if it differs between the firmwares, both meanings are given.
ERRORS = {
    0x01: "not initialised, or a state that cannot be", 0x02: "system level, or supply too low",
    0x04: "timing, or supply too high", 0x08: "no estimate of its position", 0x10: "configuration",
    0x20: "driver of the gates", 0x40: "no input, or the motor failed", 0x100: "supply too high, or the encoder failed",
    0x200: "supply too low, or the controller failed", 0x400: "too much current",
    0x800: "its watchdog ended (firmware 0.5), or too much braking (0.6)", 0x1000: "current limit",
    0x2000: "motor too hot", 0x4000: "board too hot", 0x8000: "velocity limit", 0x10000: "position limit",
    0x1000000: "its watchdog ended", 0x2000000: "emergency stop was asked for", 0x4000000: "the motor spun out",
    0x8000000: "no braking resistor", 0x10000000: "a thermistor is not connected", 0x40000000: "calibration",
}  # fmt: skip


def number(node: int, command: int) -> int:
    """Return the identifier of a servo's command."""
    return node << 5 | command


def pack(command: int, *values: float) -> bytes:
    """Return the data of a command."""
    return struct.pack(_PACKED[command], *values)


def unpack(command: int, data: bytes) -> tuple[float, ...]:
    """Return the values in a command's data.

    Raises
    ------
    ValueError
        If the data are too short.
    """
    form = _PACKED[command]
    size = struct.calcsize(form)
    if len(data) < size:
        raise ValueError(f"{len(data)} bytes are too few for command 0x{command:02x}")
    return struct.unpack(form, data[:size])


def heartbeat(data: bytes) -> tuple[int, int]:
    """Return the error bits and the state of an axis in a heartbeat.

    Raises
    ------
    ValueError
        If it is too short.
    """
    if len(data) < 5:
        raise ValueError(f"a heartbeat of {len(data)} bytes")
    return int.from_bytes(data[:4], "little"), data[4]


def milli(value: float) -> int:
    """Return a value in thousandths, limited to 16 bits."""
    return max(-32767, min(32767, round(value * MILLI)))


def error_name(code: int) -> str:
    """Return the meaning of an error's bits."""
    words = [name for bit, name in ERRORS.items() if code & bit]
    return "; ".join(words) or "unknown"
