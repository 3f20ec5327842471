"""The messages of Foxglove's well-known schemas that describe a 3-D scene: their fields, and encoding to bytes.

Source of names and numbers: the definitions ``foxglove.SceneUpdate`` and ``foxglove.FrameTransforms`` with all that
they contain, and Protocol Buffers' ``timestamp.proto``, ``duration.proto`` and ``descriptor.proto``.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final

from itouch.recording.protobuf import number, tag, text

Fields = Sequence[tuple[str, int, str]]

#: Message -> its fields: name, number, kind; a kind that ends with ``[]`` is repeated.
MESSAGES: Final[Mapping[str, Fields]] = {
    "Vector3": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")],
    "Point3": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double")],
    "Quaternion": [("x", 1, "double"), ("y", 2, "double"), ("z", 3, "double"), ("w", 4, "double")],
    "Color": [("r", 1, "double"), ("g", 2, "double"), ("b", 3, "double"), ("a", 4, "double")],
    "Pose": [("position", 1, "Vector3"), ("orientation", 2, "Quaternion")],
    "KeyValuePair": [("key", 1, "string"), ("value", 2, "string")],
    "ArrowPrimitive": [("pose", 1, "Pose"), ("shaft_length", 2, "double"), ("shaft_diameter", 3, "double"),
                       ("head_length", 4, "double"), ("head_diameter", 5, "double"), ("color", 6, "Color")],
    "CubePrimitive": [("pose", 1, "Pose"), ("size", 2, "Vector3"), ("color", 3, "Color")],
    "SpherePrimitive": [("pose", 1, "Pose"), ("size", 2, "Vector3"), ("color", 3, "Color")],
    "CylinderPrimitive": [("pose", 1, "Pose"), ("size", 2, "Vector3"), ("bottom_scale", 3, "double"),
                          ("top_scale", 4, "double"), ("color", 5, "Color")],
    "TriangleListPrimitive": [("pose", 1, "Pose"), ("points", 2, "Point3[]"), ("color", 3, "Color"),
                              ("colors", 4, "Color[]"), ("indices", 5, "fixed32[]")],
    "TextPrimitive": [("pose", 1, "Pose"), ("billboard", 2, "bool"), ("font_size", 3, "double"),
                      ("scale_invariant", 4, "bool"), ("color", 5, "Color"), ("text", 6, "string")],
    "SceneEntity": [("timestamp", 1, "google.protobuf.Timestamp"), ("frame_id", 2, "string"), ("id", 3, "string"),
                    ("lifetime", 4, "google.protobuf.Duration"), ("frame_locked", 5, "bool"),
                    ("metadata", 6, "KeyValuePair[]"), ("arrows", 7, "ArrowPrimitive[]"),
                    ("cubes", 8, "CubePrimitive[]"), ("spheres", 9, "SpherePrimitive[]"),
                    ("cylinders", 10, "CylinderPrimitive[]"), ("triangles", 12, "TriangleListPrimitive[]"),
                    ("texts", 13, "TextPrimitive[]")],
    "SceneEntityDeletion": [("timestamp", 1, "google.protobuf.Timestamp"), ("type", 2, "Type"), ("id", 3, "string")],
    "SceneUpdate": [("deletions", 1, "SceneEntityDeletion[]"), ("entities", 2, "SceneEntity[]")],
    "FrameTransform": [("timestamp", 1, "google.protobuf.Timestamp"), ("parent_frame_id", 2, "string"),
                       ("child_frame_id", 3, "string"), ("translation", 4, "Vector3"), ("rotation", 5, "Quaternion")],
    "FrameTransforms": [("transforms", 1, "FrameTransform[]")],
}  # fmt: skip
_TIMES: Final[Mapping[str, Fields]] = {
    name: [("seconds", 1, "int64"), ("nanos", 2, "int32")] for name in ("Timestamp", "Duration")
}
#: Kinds of descriptor.proto.
_KINDS = {"double": 1, "int64": 3, "int32": 5, "fixed32": 7, "bool": 8, "string": 9}
_MESSAGE, _ENUM, _OPTIONAL, _REPEATED = 11, 14, 1, 3
_PACKAGE = "foxglove"
_FIXED64, _LENGTH = 1, 2
#: Bytes of the wire types with a fixed width, and kinds that are encoded as varints.
_WIDTHS: Final = {1: 8, 5: 4}
_WHOLE: Final = frozenset({"bool", "int64", "int32", "Type"})


def encode(name: str, value: Mapping[str, Any]) -> bytes:
    """Return the bytes of a message; fields that are not given are left out.

    Parameters
    ----------
    name
        Name of the message, without its package.
    value
        Field -> number, text, or mapping for a message; for a repeated field, a sequence of these.
    """
    out = bytearray()
    fields = _TIMES[name.rpartition(".")[2]] if name.startswith("google.") else MESSAGES[name]
    for key, place, kind in fields:
        if key not in value:
            continue
        if kind == "fixed32[]":
            packed = struct.pack(f"<{len(value[key])}I", *value[key])
            out += text(place, packed)
            continue
        many = kind.endswith("[]")
        for item in value[key] if many else (value[key],):
            out += _one(place, kind.removesuffix("[]"), item)
    return bytes(out)


def _one(place: int, kind: str, item: Any) -> bytes:
    if kind == "double":
        return tag(place, _FIXED64) + struct.pack("<d", item)
    if kind == "string":
        return text(place, item)
    if kind in ("bool", "int64", "int32", "Type"):
        return number(place, int(item))
    return text(place, encode(kind, item))


def decode(name: str, data: bytes) -> dict[str, Any]:
    """Return a message as a mapping; numbers that are absent are 0, texts empty, messages None, repeated fields lists.

    Fields that are not known here are skipped.

    Raises
    ------
    ValueError
        If the bytes are not such a message.
    """
    fields = _TIMES[name.rpartition(".")[2]] if name.startswith("google.") else MESSAGES[name]
    kinds = {place: (key, kind) for key, place, kind in fields}
    found: dict[str, Any] = {key: _absent(kind) for key, _, kind in fields}
    at = 0
    while at < len(data):
        head, at = _varint(data, at)
        wire = head & 7
        if wire == 0:
            value, at = _varint(data, at)
            piece: bytes | int = value
        elif wire in _WIDTHS or wire == _LENGTH:
            width = _WIDTHS.get(wire, 0)
            if wire == _LENGTH:
                width, at = _varint(data, at)
            piece, at = data[at : at + width], at + width
            if at > len(data):
                raise ValueError(f"a message {name} ends in the middle of a field")
        else:
            raise ValueError(f"a message {name} has a field of wire type {wire}")
        if head >> 3 in kinds:
            key, kind = kinds[head >> 3]
            _take(found, key, kind, piece)
    return found


def _take(found: dict[str, Any], key: str, kind: str, piece: bytes | int) -> None:
    """Put the bytes or number of a field into a message; a number in place of a message, or the reverse, is refused."""
    single = kind.removesuffix("[]")
    value: Any = piece
    if (single in _WHOLE) != isinstance(piece, int):
        raise ValueError(f"the field {key} is not a {single}")
    if isinstance(piece, bytes):
        if single == "fixed32":
            found[key].extend(struct.unpack(f"<{len(piece) // 4}I", piece[: len(piece) // 4 * 4]))
            return
        if single == "double" and len(piece) != 8:
            raise ValueError(f"the field {key} is not a {single}")
        value = (
            struct.unpack("<d", piece)[0] if single == "double"
            else piece.decode("utf-8", "replace") if single == "string"
            else decode(single, piece)
        )  # fmt: skip
    if kind.endswith("[]"):
        found[key].append(value)
    else:
        found[key] = value


def _absent(kind: str) -> Any:
    if kind.endswith("[]"):
        return []
    return 0.0 if kind == "double" else "" if kind == "string" else 0 if kind in _WHOLE else None


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return a number in base 128, and the offset of the byte after it."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            raise ValueError("a message ends in the middle of a number")
        value |= (data[at] & 0x7F) << shift
        at += 1
        if not data[at - 1] & 0x80:
            return value, at
    raise ValueError("a number has more than ten bytes")


def descriptor(name: str) -> bytes:
    """Return the serialised FileDescriptorSet that describes a message and all messages that it contains."""
    needed = _needed(name)
    times = [_file(f"google/protobuf/{kind.lower()}.proto", "google.protobuf", {kind: _TIMES[kind]}, ())
             for kind in _TIMES]  # fmt: skip
    uses = [f"google/protobuf/{kind.lower()}.proto" for kind in _TIMES]
    own = _file(f"foxglove/{name}.proto", _PACKAGE, {n: MESSAGES[n] for n in MESSAGES if n in needed}, uses)
    return b"".join(text(1, file) for file in (*times, own))


def _needed(name: str) -> set[str]:
    found, waiting = {name}, [name]
    while waiting:
        for _, _, kind in MESSAGES[waiting.pop()]:
            kind = kind.removesuffix("[]")
            if kind in MESSAGES and kind not in found:
                found.add(kind)
                waiting.append(kind)
    return found


def _file(path: str, package: str, messages: Mapping[str, Fields], uses: Sequence[str]) -> bytes:
    body = b"".join(text(4, _message(name, fields)) for name, fields in messages.items())
    return text(1, path) + text(2, package) + b"".join(text(3, use) for use in uses) + body + text(12, "proto3")


def _message(name: str, fields: Fields) -> bytes:
    body = text(1, name) + b"".join(text(2, _field(name, *field)) for field in fields)
    if any(kind == "Type" for _, _, kind in fields):
        values = (text(1, word) + number(2, index) for index, word in enumerate(("MATCHING_ID", "ALL")))
        body += text(4, text(1, "Type") + b"".join(text(2, value) for value in values))
    return body


def _field(owner: str, name: str, place: int, kind: str) -> bytes:
    label = _REPEATED if kind.endswith("[]") else _OPTIONAL
    kind = kind.removesuffix("[]")
    code = _KINDS.get(kind, _ENUM if kind == "Type" else _MESSAGE)
    body = text(1, name) + number(3, place) + number(4, label) + number(5, code)
    if code == _ENUM:
        return body + text(6, f".{_PACKAGE}.{owner}.Type")
    if code == _MESSAGE:
        return body + text(6, f".{kind}" if kind.startswith("google.") else f".{_PACKAGE}.{kind}")
    return body
