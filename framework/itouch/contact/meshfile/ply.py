"""The header of a PLY file, and binary PLY files with polygons of several sizes, which trimesh does not read."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.polygons import fans
from itouch.contact.meshfile.size_limits import MAX_FACES

#: Name of a type -> its letter in ``struct``.
TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
    "int64": "q", "uint64": "Q",
}  # fmt: skip
_LONGEST_HEADER = 1 << 16
_FACES = ("vertex_index", "vertex_indices")


@dataclass(frozen=True, slots=True)
class Property:
    """A column: its name and type; for a list, also the type of its length."""

    name: str
    kind: str
    length_kind: str = ""


@dataclass(frozen=True, slots=True)
class Element:
    """A table: its name, the number of rows that the header declares, and its columns."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)

    @property
    def listed(self) -> bool:
        """Whether any of its columns is a list, so that rows differ in length."""
        return any(p.length_kind for p in self.properties)

    def row_format(self, order: str) -> str:
        """Return the ``struct`` format of a row without lists."""
        return order + "".join(p.kind for p in self.properties)


@dataclass(frozen=True, slots=True)
class Header:
    """A PLY's header: its byte order (empty in a text file), its tables, and the offset at which they begin."""

    order: str
    elements: list[Element]
    start: int


def read_header(data: bytes) -> Header:
    """Read the header.

    Raises
    ------
    ValueError, KeyError, IndexError
        If it is not a valid header.
    """
    head = data[:_LONGEST_HEADER]
    end = head.find(b"end_header")
    if not head.startswith((b"ply\n", b"ply\r")):
        raise ValueError
    if end < 0 or b"\n" not in head[end:]:
        raise ValueError("its header does not end")
    order = ""
    elements: list[Element] = []
    for words in (line.split() for line in head[:end].decode("latin-1").splitlines()[1:]):
        if words[:1] == ["format"]:
            order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_element(words, {element.name for element in elements}))
        elif words[:1] == ["property"]:
            elements[-1].properties.append(_property(words))
    return Header(order, elements, head.index(b"\n", end) + 1)


def _element(words: list[str], known: set[str]) -> Element:
    if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > 18 or words[1] in known:
        raise ValueError(f"its header says '{' '.join(words)[:60]}'")
    return Element(words[1], int(words[2]))


def _property(words: list[str]) -> Property:
    if len(words) == 5 and words[1] == "list" and words[2] in TYPES and words[3] in TYPES:
        if TYPES[words[2]] not in "fd":
            return Property(words[4], TYPES[words[3]], TYPES[words[2]])
    elif len(words) == 3 and words[1] in TYPES:
        return Property(words[2], TYPES[words[1]])
    raise ValueError(f"its header says '{' '.join(words)[:60]}'")


def read_polygons(data: bytes, header: Header) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices (n, 3) and the triangles (m, 3) of a binary PLY whose faces have any number of corners.

    Raises
    ------
    ValueError, KeyError, struct.error
        If it has no such tables, or ends too early.
    """
    at = header.start
    vertices, faces = np.empty((0, 3)), np.empty((0, 3), np.int64)
    for element in header.elements:
        if element.name == "face":
            faces, at = _faces(data, at, element, header.order)
        elif element.listed:
            raise ValueError(f"its table '{element.name}' holds lists")
        else:
            size = struct.calcsize(element.row_format(header.order))
            if at + element.rows * size > len(data):
                raise ValueError("it ends too early")
            if element.name == "vertex":
                kinds = [(p.name, header.order + p.kind) for p in element.properties]
                rows = np.frombuffer(data, np.dtype(kinds), element.rows, at)
                vertices = np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
            at += element.rows * size
    return vertices, faces


def _faces(data: bytes, at: int, element: Element, order: str) -> tuple[NDArray[np.int64], int]:
    sizes: list[int] = []
    corners: list[int] = []
    for _ in range(element.rows):
        for column in element.properties:
            count = 1
            if column.length_kind:
                (count,) = struct.unpack_from(order + column.length_kind, data, at)
                at += struct.calcsize(order + column.length_kind)
            form = f"{order}{max(count, 0)}{column.kind}"
            if column.length_kind and column.name in _FACES:
                if len(corners) + count > 4 * MAX_FACES:
                    raise ValueError(f"its faces have more than {4 * MAX_FACES} corners")
                corners.extend(struct.unpack_from(form, data, at))
                sizes.append(max(count, 0))
            at += struct.calcsize(form)
    return fans(np.array(sizes, np.int64), np.array(corners, np.int64)), at
