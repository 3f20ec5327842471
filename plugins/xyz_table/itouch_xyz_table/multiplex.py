"""The register protocol of moteus in CAN frames, from the servo's side: decodes writes and reads, encodes replies.

A frame consists of subframes: an action with the number type in two bits and a count in two (0: the count follows),
the first register, then values, little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

_WRITE, _READ, _REPLY, _READ_ERROR, _NOTHING = 0x00, 0x10, 0x20, 0x31, 0x50
_FORMATS = ("<b", "<h", "<i", "<f")
#: The smallest integer of each type stands for "not a number".
_NONE = (-(1 << 7), -(1 << 15), -(1 << 31))


class Write(NamedTuple):
    """A value for a register: its number type (0 int8, 1 int16, 2 int32, 3 float) and the raw number; None: NaN."""

    register: int
    kind: int
    value: float | None


class Read(NamedTuple):
    """A query for ``size`` consecutive registers."""

    first: int
    kind: int
    size: int


def decode(data: bytes) -> list[Write | Read]:
    """Return the writes and reads in a frame.

    Raises
    ------
    ValueError
        If it is not a frame of this protocol.
    """
    asked: list[Write | Read] = []
    at = 0
    while at < len(data):
        head, at = data[at], at + 1
        if head == _NOTHING:
            continue
        action, kind, count = head & 0xF0, head >> 2 & 3, head & 3
        if action not in (_WRITE, _READ):
            raise ValueError(f"subframe 0x{head:02x}")
        if count == 0:
            count, at = _varuint(data, at)
        first, at = _varuint(data, at)
        if action == _READ:
            asked.append(Read(first, kind, count))
            continue
        size = struct.calcsize(_FORMATS[kind])
        for register in range(first, first + count):
            (value,) = struct.unpack_from(_FORMATS[kind], data, at)
            asked.append(Write(register, kind, _value(value, kind)))
            at += size
    return asked


def _value(raw: float, kind: int) -> float | None:
    if kind == 3:
        return raw if raw == raw else None
    return None if raw == _NONE[kind] else raw


def _varuint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if at >= len(data):
            raise ValueError("the frame ends in a number")
        byte, at = data[at], at + 1
        value |= (byte & 0x7F) << shift
        if not byte & 0x80:
            return value, at
        shift += 7


def reply(read: Read, values: Iterable[float]) -> bytes:
    """Return the subframe that answers a query with raw numbers; NaN becomes the type's own code for it."""
    parts = []
    for value in values:
        if read.kind == 3:
            parts.append(struct.pack("<f", value))
            continue
        low, high = _NONE[read.kind] + 1, -_NONE[read.kind] - 1
        whole = _NONE[read.kind] if value != value else max(low, min(high, round(value)))
        parts.append(struct.pack(_FORMATS[read.kind], whole))
    head = bytes((_REPLY | read.kind << 2 | (read.size if read.size < 4 else 0),))
    long = bytes((read.size,)) if read.size > 3 else b""
    return head + long + _number(read.first) + b"".join(parts)


def _number(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*out, value))
