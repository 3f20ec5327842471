"""Rows of a track as Protocol Buffers messages of fixed length, which plotting programs read, encoded array by array.

Every number is written with its tag and eight bytes, so that the messages of a track differ only in the bytes of the
numbers: rows are written into copies of a template.  Source: the encoding and descriptor.proto of Protocol Buffers.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from itouch.recording.tracks import PARTS, Column, Track, identifier, identifiers

#: Wire types, and the numbers of descriptor.proto's field types and labels.
_FIXED64, _LENGTH = 1, 2
_DOUBLE, _MESSAGE, _FIXED, _SFIXED = 1, 11, 6, 16
_OPTIONAL, _REPEATED = 1, 3
_TYPES = {"f8": _DOUBLE, "i8": _SFIXED, "u8": _FIXED}
#: Names of the shared messages, by their number of components.
_NAMES = {3: "Vector", 6: "Six", 7: "Pose"}
_PACKAGE = "itouch"


def varint(number: int) -> bytes:
    """Return a number in base 128, least significant digit first."""
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])


def tag(field: int, wire: int) -> bytes:
    """Return the head of a field."""
    return varint(field << 3 | wire)


def text(field: int, content: str | bytes) -> bytes:
    """Return a field of bytes or text."""
    data = content.encode() if isinstance(content, str) else content
    return tag(field, _LENGTH) + varint(len(data)) + data


def number(field: int, value: int) -> bytes:
    """Return a field of a whole number, at least 0."""
    return tag(field, 0) + varint(value)


@dataclass(frozen=True, slots=True)
class FieldLayout:
    """The place of a number, or of a run of numbers, in a message."""

    column: str
    component: int
    count: int
    offset: int
    kind: str


def template(track: Track) -> tuple[bytes, list[FieldLayout]]:
    """Return a message of zeros, and the place of each number in it."""
    out, layout = bytearray(), []

    def one(number: int, column: str, component: int, kind: str) -> None:
        out.extend(tag(number, _FIXED64))
        layout.append(FieldLayout(column, component, 1, len(out), kind))
        out.extend(bytes(8))

    one(1, "tick", 0, "i8")
    one(2, "time", 0, "f8")
    for number, column in enumerate(track.columns, start=3):
        if column.size == 0:
            one(number, column.name, 0, column.kind)
        elif column.parts:
            out.extend(tag(number, _LENGTH) + varint(9 * column.size))
            for component in range(column.size):
                one(component + 1, column.name, component, column.kind)
        else:
            out.extend(tag(number, _LENGTH) + varint(8 * column.size))
            layout.append(FieldLayout(column.name, 0, column.size, len(out), column.kind))
            out.extend(bytes(8 * column.size))
    return bytes(out), layout


def schema_name(track: Track) -> str:
    """Return the full name of a track's message."""
    return f"{_PACKAGE}.{identifier(track.name.replace('/', '_'))}"


def descriptor(track: Track) -> bytes:
    """Return the serialised FileDescriptorSet that describes a track's message."""
    names = identifiers(["tick", "time", *(column.name for column in track.columns)])
    fields = [_field(names[0], 1, _SFIXED, _OPTIONAL), _field(names[1], 2, _DOUBLE, _OPTIONAL)]
    for number, (name, column) in enumerate(zip(names[2:], track.columns, strict=True), start=3):
        fields.append(_column(name, number, column))
    own = text(1, schema_name(track).removeprefix(_PACKAGE + ".")) + b"".join(text(2, f) for f in fields)
    shared = [_shared(size) for size in sorted({c.size for c in track.columns if c.parts})]
    messages = b"".join(text(4, message) for message in [own, *shared])
    file = text(1, f"{schema_name(track)}.proto") + text(2, _PACKAGE) + messages + text(12, "proto3")
    return text(1, file)


def _column(name: str, number: int, column: Column) -> bytes:
    if column.parts:
        return _field(name, number, _MESSAGE, _OPTIONAL, f".{_PACKAGE}.{_NAMES[column.size]}")
    return _field(name, number, _TYPES[column.kind], _OPTIONAL if column.size == 0 else _REPEATED)


def _field(name: str, place: int, kind: int, label: int, message: str = "") -> bytes:
    body = text(1, name) + number(3, place) + number(4, label) + number(5, kind)
    return body + (text(6, message) if message else b"")


def _shared(size: int) -> bytes:
    return text(1, _NAMES[size]) + b"".join(
        text(2, _field(part, number, _DOUBLE, _OPTIONAL)) for number, part in enumerate(PARTS[size], start=1)
    )


def header(channel: int, length: int) -> bytes:
    """Return the head of an MCAP message record with a payload of ``length`` bytes; sequence and times are zero."""
    return struct.pack("<BQHIQQ", 0x05, 22 + length, channel, 0, 0, 0)
