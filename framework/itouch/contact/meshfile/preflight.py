"""What a file says of itself, checked against the bytes that there are, before anything is allocated for it."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.limits import (
    MAX_FACES,
    MAX_TEXT_VERTICES,
    MAX_VERTICES,
    too_many_faces,
    too_many_vertices,
)

_MAX_PARTS = 10_000  # named parts of a text file: the parser's work grows with their square
_STL_HEAD, _STL_ROW = 84, 50
_PLY_BYTES = {
    "char": 1, "int8": 1, "uchar": 1, "uint8": 1, "short": 2, "int16": 2, "ushort": 2, "uint16": 2, "int": 4,
    "int32": 4, "uint": 4, "uint32": 4, "float": 4, "float16": 2, "float32": 4, "double": 8, "float64": 8,
    "int64": 8, "uint64": 8,
}  # fmt: skip
_OFF_COUNTS = re.compile(rb"\s*C?OFF\s+(\d{1,18})\s+(\d{1,18})")
_COMMENT = re.compile(rb"#[^\n]*")
_END_FACET = re.compile(rb"(?i)endfacet")
_PIECE = 8 << 20
_LINE_ENDS = (b"\n", b"\r", b"\x0b", b"\x0c", b"\x1c", b"\x1d", b"\x1e")
_MOST_LINES = 4 * MAX_TEXT_VERTICES  # vertices, normals, textures, faces
_SPARE_LINES = 1000  # comments and empty lines that are nobody's fault
_VERTEX_LINE = re.compile(rb"(?m)^[ \t]*v[ \t]")
_FACE_LINE = re.compile(rb"(?m)^[ \t]*f[ \t]([^\n]*)")


def checked(data: bytes, kind: str, shown: str) -> bytes:
    """Return what of the file is to be parsed.

    Raises
    ------
    MeshError
        If it is not of this format, is cut, announces more than it has, or is too large.
    """
    check = {"stl": _stl, "ply": _ply, "off": _off, "obj": _obj}[kind]
    return check(data, shown)


def _not(kind: str, shown: str, data: bytes, why: str = "") -> MeshError:
    begins = data[:24].decode("latin-1")
    begins = "".join(c if c.isprintable() and c.isascii() else "." for c in begins)
    reason = why or f"it begins with '{begins}'"
    advice = "is it complete, and does its name end as it should?"
    return MeshError("mesh-damaged", f"'{shown}' is not a sound {kind} file: {reason}", advice)


def _stl(data: bytes, shown: str) -> bytes:
    announced = _announced(data)
    if is_binary_stl(data):
        if announced > MAX_FACES:
            raise too_many_faces(shown, announced)
        return data[: _STL_HEAD + announced * _STL_ROW]
    head = data[:512].lstrip().lower()
    if head.startswith(b"solid") and b"facet" in data[:4096].lower():
        return _stl_text(data, shown)
    if head.startswith(b"solid") and b"endsolid" in data[-4096:].lower():
        raise MeshError("mesh-empty", f"'{shown}' holds no triangles", "is the file complete?")
    printable = sum(32 <= c < 127 or c in (9, 10, 13) for c in data[:512])
    held = (len(data) - _STL_HEAD) // _STL_ROW
    if announced < 0 or printable == len(data[:512]):
        raise _not("STL", shown, data)
    raise _not("STL", shown, data, f"its header says {announced} triangles, its length is that of {held}")


def _announced(data: bytes) -> int:
    return int(struct.unpack_from("<I", data, 80)[0]) if len(data) >= _STL_HEAD else -1


def is_binary_stl(data: bytes) -> bool:
    """Tell whether the length is that of the binary form; its header may well begin with 'solid'."""
    announced = _announced(data)
    return announced >= 0 and 0 <= len(data) - _STL_HEAD - announced * _STL_ROW < _STL_ROW  # some writers pad the end


def _stl_text(data: bytes, shown: str) -> bytes:
    lower = data.lower()
    corners, begun, ended = lower.count(b"vertex"), lower.count(b"facet normal"), lower.count(b"endfacet")
    if corners > 3 * MAX_FACES:
        raise too_many_faces(shown, corners // 3)
    if lower.count(b"endsolid") > _MAX_PARTS:
        raise MeshError("mesh-too-large", f"'{shown}' has more than {_MAX_PARTS} solids", "save it as a binary STL")
    if b"endsolid" not in lower or begun != ended:
        raise _not("STL", shown, data, "it ends in the middle of a solid")
    return data


def pieces(data: bytes, kind: str) -> Iterator[bytes]:
    """Cut a long STL in text between triangles: its parser takes ten times a file's size in memory."""
    if kind != "stl" or len(data) <= _PIECE or is_binary_stl(data):
        yield data
        return
    at = 0
    while at < len(data):
        end = _next_facet(data, at + _PIECE)
        yield (b"solid\n" if at else b"") + data[at:end] + (b"\nendsolid\n" if end < len(data) else b"")
        at = end


def _next_facet(data: bytes, at: int) -> int:
    """Return where the first triangle that ends after ``at`` ends."""
    match = _END_FACET.search(data, at)
    return match.end() if match else len(data)


def _ply(data: bytes, shown: str) -> bytes:
    end = data[: 1 << 16].find(b"end_header")
    if not re.match(rb"ply\s", data) or end < 0:
        raise _not("PLY", shown, data, "" if not data.startswith(b"ply") else "its header does not end")
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()[1:]]
    binary = any(line[:1] == ["format"] and "ascii" not in line[1:2] for line in lines)
    rows, total, least, known = 0, 0, 0, set()
    for line in lines:
        if line[:1] == ["element"]:
            if len(line) != 3 or not line[2].isdecimal() or len(line[2]) > 18 or line[1] in known:
                raise _not("PLY", shown, data, f"its header says '{' '.join(line)[:60]}'")
            known.add(line[1])
            rows = int(line[2])
            total += rows
            _ply_count(line[1], rows, shown, binary)
        elif line[:1] == ["property"]:
            size = _PLY_BYTES.get(line[2 if line[1:2] == ["list"] else 1] if len(line) > 2 else "")
            if size is None or not known:
                raise _not("PLY", shown, data, f"its header says '{' '.join(line)[:60]}'")
            least += rows * (size if binary else 2)
    if least > len(data) - end:
        sentence = f"its header announces at least {least} bytes, it has {len(data) - end}"
        raise _not("PLY", shown, data, sentence)
    if not binary:
        _check_lines(data, total, "PLY", shown)
    return data


def _ply_count(element: str, count: int, shown: str, binary: bool) -> None:
    if element == "face" and count > MAX_FACES:
        raise too_many_faces(shown, count)
    most = MAX_VERTICES if binary else MAX_TEXT_VERTICES
    if count > most:
        raise too_many_vertices(shown, count, most)


def _check_lines(data: bytes, announced: int, kind: str, shown: str) -> None:
    """Refuse a text of many more lines than its header announces: its parser would take each for a row."""
    if not data.isascii():
        raise _not(kind, shown, data, "it holds bytes that are no plain text")
    lines = sum(data.count(end) for end in _LINE_ENDS) - data.count(b"\r\n")
    if lines > 2 * announced + _SPARE_LINES:
        raise _not(kind, shown, data, f"it announces {announced} rows and has {lines} lines")


def _off(data: bytes, shown: str) -> bytes:
    match = _OFF_COUNTS.match(_COMMENT.sub(b"", data[: 1 << 16]))
    if match is None:
        raise _not("OFF", shown, data)
    vertices, faces = int(match.group(1)), int(match.group(2))
    if faces > MAX_FACES:
        raise too_many_faces(shown, faces)
    if vertices > MAX_TEXT_VERTICES:
        raise too_many_vertices(shown, vertices, MAX_TEXT_VERTICES)
    if 6 * (vertices + faces) > len(data):  # the shortest lines are "0 0 0\n" and "1 0 1\n"
        announced = f"it announces {vertices} vertices and {faces} faces"
        raise _not("OFF", shown, data, f"{announced}, more than it has bytes for")
    _check_lines(data, vertices + faces, "OFF", shown)
    return data


def _obj(data: bytes, shown: str) -> bytes:
    if b"\0" in data:
        raise _not("OBJ", shown, data, "it holds bytes that are no text")
    lines = data.count(b"\n")
    if lines > _MOST_LINES:
        sentence = f"'{shown}' has {lines} lines; the most is {_MOST_LINES}"
        raise MeshError("mesh-too-large", sentence, "save it in a binary format")
    vertices, faces = sum(1 for _ in _VERTEX_LINE.finditer(data)), 0
    for match in _FACE_LINE.finditer(data):
        faces += max(0, len(match.group(1).split()) - 2)
        if faces > MAX_FACES:
            raise too_many_faces(shown, faces)
    if vertices > MAX_TEXT_VERTICES:
        raise too_many_vertices(shown, vertices, MAX_TEXT_VERTICES)
    if not vertices and not faces:
        raise _not("OBJ", shown, data)
    if not faces:
        raise MeshError("mesh-empty", f"'{shown}' holds no triangles", "points and lines can't be touched")
    return _plain_obj(data)


def _plain_obj(data: bytes) -> bytes:
    """Keep an OBJ's vertices and faces only, with each face's vertices as plain positive numbers.

    Names, materials, textures and normals are not felt; and numbers counted back from a line mean something else to a
    parser that reads all vertices first.
    """
    lines, count = [], 0
    for raw in io.BytesIO(data.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")):
        line = raw.split(b"#", 1)[0].split()
        if line[:1] == [b"v"]:
            count += 1
            lines.append(b" ".join(line[:4]))
        elif line[:1] == [b"f"]:
            corners = [int(word.split(b"/", 1)[0]) for word in line[1:]]
            if len(corners) < 3:
                continue
            lines.append(b"f " + b" ".join(b"%d" % (c if c > 0 else count + 1 + c) for c in corners))
    return b"\n".join(lines)
