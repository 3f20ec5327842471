"""What a mesh file declares, checked against the bytes that are there, before anything is allocated for it."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from itertools import pairwise

from itouch.contact.meshfile.faults import MeshError
from itouch.contact.meshfile.ply import read_header
from itouch.contact.meshfile.size_limits import (
    MAX_FACES,
    MAX_TEXT_VERTICES,
    MAX_VERTICES,
    too_many_faces,
    too_many_vertices,
)

_MAX_PARTS = 10_000  # named parts of a text file: the parser's work grows with their square
_STL_HEAD, _STL_ROW = 84, 50
_OFF_COUNTS = re.compile(rb"\s*C?OFF\s+(\d{1,18})\s+(\d{1,18})")
_COMMENT = re.compile(rb"#[^\n]*")
_SOLID_NAME = re.compile(rb"solid[^\n]*")
_END_FACET = re.compile(rb"endfacet")
_PIECE = 8 << 20
_LINE_ENDS = (b"\n", b"\r", b"\x0b", b"\x0c", b"\x1c", b"\x1d", b"\x1e")
_MOST_LINES = 4 * MAX_TEXT_VERTICES  # vertices, normals, textures, faces
_SPARE_LINES = 1000  # comments and empty lines that are tolerated
_VERTEX_LINE = re.compile(rb"(?m)^[ \t]*v[ \t]")
_FACE_LINE = re.compile(rb"(?m)^[ \t]*f[ \t]([^\n]*)")


def checked(data: bytes, kind: str, shown: str) -> bytes:
    """Return the part of the file that is to be parsed.

    Raises
    ------
    MeshError
        If it is not of this format, is truncated, declares more than it has, or is too large.
    """
    check = {"stl": _stl, "ply": _ply, "off": _off, "obj": _obj}[kind]
    text = {"stl": b"solid" in data[:32].lower(), "ply": b"format binary" not in data[:1024]}.get(kind, True)
    return check(_plain_text(data) if text and not is_binary_stl(data) else data, shown)


def _plain_text(data: bytes) -> bytes:
    """Return a text with uniform line ends and without the byte order mark that some editors put in front."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def _not(kind: str, shown: str, data: bytes, why: str = "") -> MeshError:
    begins = data[:24].decode("latin-1")
    begins = "".join(c if c.isprintable() and c.isascii() else "." for c in begins)
    reason = why or f"it begins with '{begins}'"
    advice = "is it complete, and does its extension match its format?"
    return MeshError("mesh-damaged", f"'{shown}' is not a valid {kind} file: {reason}", advice)


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
    """Tell whether the length is that of a binary STL; the header does not decide, as it may begin with 'solid' too."""
    announced = _announced(data)
    return announced >= 0 and 0 <= len(data) - _STL_HEAD - announced * _STL_ROW < _STL_ROW  # some writers pad the end


def _stl_text(data: bytes, shown: str) -> bytes:
    lower = _SOLID_NAME.sub(b"solid", data.lower())  # names may hold any word
    corners, ended = lower.count(b"vertex"), lower.count(b"endfacet")
    begun = lower.count(b"facet") - ended
    if corners > 3 * MAX_FACES:
        raise too_many_faces(shown, corners // 3)
    if lower.count(b"endsolid") > _MAX_PARTS:
        raise MeshError("mesh-too-large", f"'{shown}' has more than {_MAX_PARTS} solids", "save it as a binary STL")
    if b"endsolid" not in lower or begun != ended:
        raise _not("STL", shown, data, "it ends in the middle of a solid")
    if corners != 3 * begun:
        raise _not("STL", shown, data, f"{begun} facets have {corners} corners together")
    return lower


def pieces(data: bytes, kind: str) -> Iterator[bytes]:
    """Cut a long text STL into pieces between triangles: its parser takes ten times the size of its input in memory."""
    if kind != "stl" or len(data) <= _PIECE or is_binary_stl(data):
        yield data
        return
    at = 0
    while at < len(data):
        end = _next_facet(data, at + _PIECE)
        yield (b"solid\n" if at else b"") + data[at:end] + (b"\nendsolid\n" if end < len(data) else b"")
        at = end


def _next_facet(data: bytes, at: int) -> int:
    """Return the end of the first triangle that ends after ``at``."""
    match = _END_FACET.search(data, at)
    return match.end() if match else len(data)


def _ply(data: bytes, shown: str) -> bytes:
    try:
        header = read_header(data)
    except (ValueError, KeyError, IndexError) as error:
        raise _not("PLY", shown, data, str(error) if isinstance(error, ValueError) else "") from None
    least = 0
    for element in header.elements:
        _ply_count(element.name, element.rows, shown, bool(header.order))
        sizes = [struct.calcsize("<" + (p.length_kind or p.kind)) for p in element.properties]
        least += element.rows * (sum(sizes) if header.order else 2 * len(sizes))
    held = len(data) - header.start
    if least > held + 1:  # the last line of a text may lack its line end
        raise _not("PLY", shown, data, f"its header announces at least {least} bytes, it has {held}")
    if not header.order:
        _check_lines(data, sum(element.rows for element in header.elements), "PLY", shown)
    return data


def _ply_count(element: str, count: int, shown: str, binary: bool) -> None:
    if element == "face" and count > MAX_FACES:
        raise too_many_faces(shown, count)
    most = MAX_VERTICES if binary else MAX_TEXT_VERTICES
    if count > most:
        raise too_many_vertices(shown, count, most)


def _check_lines(data: bytes, announced: int, kind: str, shown: str) -> None:
    """Refuse a text with many more lines than its header declares: its parser would take each for a row."""
    if not data.isascii():
        raise _not(kind, shown, data, "it holds bytes that are not plain text")
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
    return _plain_off(data, vertices, faces, shown)


def _plain_off(data: bytes, vertices: int, faces: int, shown: str) -> bytes:
    """Keep only an OFF's vertices and faces, cut into triangles; comments, which may be anywhere, are dropped."""
    lines = [line for line in _COMMENT.sub(b"", data).splitlines() if line.strip()]
    first = 1 if len(lines[0].split()) >= 3 else 2  # the counts may be on the line of "OFF"
    rows = [line.split() for line in lines[first + vertices : first + vertices + faces]]
    triangles: list[bytes] = []
    for row in rows:
        count = int(row[0])
        if count < 0 or len(row) <= count:
            raise _not("OFF", shown, data, f"a face announces {count} corners and has {len(row) - 1}")
        triangles += [b"3 " + three for three in _fan(row[1 : count + 1])]
        if len(triangles) > MAX_FACES:
            raise too_many_faces(shown, len(triangles))
    return b"\n".join([b"OFF", b"%d %d 0" % (vertices, len(triangles)), *lines[first : first + vertices], *triangles])


def _fan(corners: list[bytes]) -> Iterator[bytes]:
    """Cut a polygon into triangles that share the first corner."""
    for second, third in pairwise(corners[1:]):
        yield b" ".join((corners[0], second, third))


def _obj(data: bytes, shown: str) -> bytes:
    if b"\0" in data:
        raise _not("OBJ", shown, data, "it holds bytes that are not text")
    lines = data.count(b"\n")
    if lines > _MOST_LINES:
        sentence = f"'{shown}' has {lines} lines; the limit is {_MOST_LINES}"
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
    return _plain_obj(data, shown)


def _plain_obj(data: bytes, shown: str) -> bytes:
    """Keep only an OBJ's vertices and faces, cut into triangles with plain positive indices.

    Names, materials, textures and normals cannot be felt; and negative indices, which count back from their line, mean
    something else to a parser that reads all vertices first.

    Raises
    ------
    MeshError
        If a face names a corner that the file does not have.
    """
    lines, count, last, at = [], 0, 0, 0
    for number, raw in enumerate(io.BytesIO(data.replace(b"\\\n", b" ")), 1):
        line = raw.split(b"#", 1)[0].split()
        if line[:1] == [b"v"]:
            count += 1
            lines.append(b" ".join(line[:4]))
        elif line[:1] == [b"f"]:
            words = [word.split(b"/", 1)[0] for word in line[1:]]
            wrong = next((word for word in words if not word.removeprefix(b"-").isdigit() or not int(word)), None)
            if wrong is not None:
                named = wrong[:20].decode(errors="replace")
                fault = "and an OBJ counts corners from 1" if wrong.isdigit() else "which is not a number"
                raise _not("OBJ", shown, data, f"line {number}: a face names its corner '{named}', {fault}")
            corners = [c if c > 0 else count + 1 + c for c in map(int, words)]
            if corners and min(corners) < 1:
                raise _not("OBJ", shown, data, f"line {number}: a face names a corner before the first one")
            if corners and max(corners) > last:
                last, at = max(corners), number
            lines += [b"f " + three for three in _fan([b"%d" % corner for corner in corners])]
    if last > count:
        raise _not("OBJ", shown, data, f"line {at}: a face names corner {last}, and the file has {count}")
    return b"\n".join(lines)
