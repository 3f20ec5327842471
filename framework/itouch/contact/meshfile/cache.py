"""The cache of meshes: surfaces that were built before, found by the digest of the file that they were built from.

Each entry is a file: a line that names the format, the length and checksum of a JSON header, the header, then the three
tables as they are in memory. An entry that is truncated, altered, or of another version counts as absent and is written
anew, to a temporary file that replaces it atomically. Nothing in an entry is code, and an entry is used only if nobody
else can write to it or to its folder.

Whatever an entry holds, what is made of it can be searched: its hierarchy is a tree that the searches' stack is deep
enough for, with each triangle in one leaf and inside the boxes above it. That the vertices are those of the mesh file
rests on who may write entries: to compare them, the file would have to be parsed and repaired, which takes longer than
the rest of the building, and so they are only held against the number of triangles and the bounding box.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import struct
import sys
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np

from itouch import caches
from itouch.contact import bvh
from itouch.contact.mesh_surface import Surface, checked_vertices
from itouch.contact.meshfile.repair import MeshFacts
from itouch.contact.meshfile.size_limits import MAX_VERTICES
from itouch.contact.scratch import Mesh as Tables
from itouch.contact.stored import can_be_searched

#: Environment variable that names another folder for the cache, or ``off`` for none.
SWITCH = "ITOUCH_MESH_CACHE"
#: Increased whenever tables or mends change their meaning.
VERSION = 2
#: What all entries together may take [bytes]; the least recently used are removed first.
CAPACITY = 2 << 30

_MAGIC = b"itouch-py mesh\n"
_HEAD = struct.Struct("<II")
_LONGEST_HEADER = 1 << 16
_BUILDERS = ("bvh", "neighbours", "solid", "stored", "surface", "triangle", "vectors")
_TABLES: Final = (("<f8", 3), ("<i4", bvh.TRIANGLE_WIDTH), ("<f4", bvh.NODE_WIDTH))


def folder() -> Path | None:
    """Return the folder of the cache, or None if it is switched off."""
    return caches.folder("meshes", SWITCH)


@cache
def _code() -> str:
    """Return the digest of the code that builds tables: entries built by other code are not used."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for path in (*sorted(here.glob("*.py")), *(here.parent / f"{name}.py" for name in _BUILDERS)):
        with contextlib.suppress(OSError):  # a program packed into one file has no source files
            digest.update(path.read_bytes())
    return digest.hexdigest()


def key(digest: str, kind: str, scale: float) -> str:
    """Return the key of a surface: a digest of the file's content and of all else that its tables depend on."""
    versions = (VERSION, metadata.version("itouch-py"), metadata.version("trimesh"), _code(), sys.byteorder)
    words = (digest, kind, float(scale).hex(), *versions)
    return hashlib.sha256(repr(words).encode()).hexdigest()[:40]


def read(name: str) -> tuple[Surface, MeshFacts] | None:
    """Return a cached surface with its facts, or None if there is no valid entry."""
    place = folder()
    if place is None:
        return None
    try:
        with caches.opened(place, f"{name}.mesh") as stream:
            header = _header(stream, name)
            tables = _tables(stream, header)
        facts = _facts(header["facts"])
        _check(tables, facts)
        with contextlib.suppress(OSError):
            os.utime(place / f"{name}.mesh")  # mark it as used
        return Surface.of_tables(tables, is_solid=bool(header["solid"])), facts
    except (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError, struct.error):
        return None


def write(name: str, surface: Surface, facts: MeshFacts) -> None:
    """Cache a surface with its facts; if the folder cannot be written, do nothing."""
    place = folder()
    if place is not None:
        size = surface.memory_bytes + _LONGEST_HEADER
        caches.put(place, f"{name}.mesh", _blocks(name, surface, facts), size=size, capacity=CAPACITY)


def _blocks(name: str, surface: Surface, facts: MeshFacts) -> Iterator[Any]:
    tables = [np.ascontiguousarray(t, k).data for t, (k, _) in zip(surface.tables, _TABLES, strict=True)]
    header = {
        "version": VERSION, "key": name, "rows": [len(t) for t in surface.tables],
        "sums": [zlib.crc32(t) for t in tables], "solid": surface.is_solid, "facts": asdict(facts),
    }  # fmt: skip
    text = json.dumps(header).encode()
    yield _MAGIC
    yield _HEAD.pack(len(text), zlib.crc32(text))
    yield text
    yield from tables


def _header(stream: Any, name: str) -> dict[str, Any]:
    if stream.read(len(_MAGIC)) != _MAGIC:
        raise ValueError("another kind of file")
    length, checksum = _HEAD.unpack(stream.read(_HEAD.size))
    text = stream.read(min(length, _LONGEST_HEADER))
    if len(text) != length or zlib.crc32(text) != checksum:
        raise ValueError("the header is damaged")
    header = json.loads(text)
    if header["version"] != VERSION or header["key"] != name:
        raise ValueError("another version")
    return dict(header)


def _tables(stream: Any, header: dict[str, Any]) -> Tables:
    """Return the vertices, triangles and nodes of an entry.

    Raises
    ------
    ValueError, KeyError, TypeError, IndexError
        If they are incomplete or damaged, or would be larger than the file.
    """
    shapes = [(header["rows"][index], width) for index, (_, width) in enumerate(_TABLES)]
    if not all(isinstance(rows, int) and 1 <= rows <= MAX_VERTICES for rows, _ in shapes):
        raise ValueError("a table of an impossible size")
    sizes = [rows * width * np.dtype(kind).itemsize for (rows, width), (kind, _) in zip(shapes, _TABLES, strict=True)]
    if stream.tell() + sum(sizes) != os.fstat(stream.fileno()).st_size:  # before there is memory for them
        raise ValueError("cut, or surplus bytes")
    found = []
    for (rows, width), (kind, _), known in zip(shapes, _TABLES, header["sums"], strict=True):
        table = np.fromfile(stream, kind, rows * width)
        if table.size != rows * width or zlib.crc32(table.data) != known:
            raise ValueError("a table is damaged")
        found.append(table.reshape(rows, width))
    return found[0], found[1], found[2]


def _check(tables: Tables, facts: MeshFacts) -> None:
    """Raise ValueError unless the tables can be searched and are those of which the facts tell; put the slabs right."""
    vertices, triangles, nodes = tables
    checked_vertices(vertices)
    if not can_be_searched(vertices, triangles, nodes):
        raise ValueError("the hierarchy is not one of these triangles")
    low, high = (tuple(part(vertices[:, c]).item() for c in range(3)) for part in (np.min, np.max))
    if (len(triangles), low, high) != (facts.triangles, facts.low, facts.high):
        raise ValueError("the facts are those of another mesh")
    for side in range(2):  # found anew, as checking them would take longer
        nodes[:, bvh.CHILD_WIDTH * side + bvh.CHILD_NORMAL : bvh.CHILD_WIDTH * (side + 1)] = 0.0
    bvh.add_slabs(vertices, triangles, nodes)


def _facts(values: dict[str, Any]) -> MeshFacts:
    if set(values) != set(MeshFacts.__dataclass_fields__):
        raise ValueError("other facts")
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    facts = MeshFacts(**given)
    for name, value in given.items():
        usual = getattr(MeshFacts(), name)
        parts = zip(value, usual, strict=True) if isinstance(usual, tuple) else [(value, usual)]
        if not all(type(part) is type(known) and math.isfinite(part) for part, known in parts):
            raise ValueError(f"{name} is not such a number")
    return facts
