"""A cache of surfaces that were built before, by the digest of what they were built from.

Each entry is a file: a line that names the format, the length and checksum of a JSON header, the header, then the three
tables as they are in memory. An entry that is truncated, altered, or of another version counts as absent and is written
anew, to a temporary file that replaces it atomically. Nothing in an entry is code.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import struct
import sys
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch import caches
from itouch.contact import bvh
from itouch.contact.meshfile.limits import MAX_FACES, MAX_VERTICES
from itouch.contact.meshfile.mend import MeshFacts
from itouch.contact.surface import Surface

#: Environment variable that names another folder for the cache, or ``off`` for none.
SWITCH = "ITOUCH_MESH_CACHE"
#: Increased whenever tables or mends change their meaning.
VERSION = 2
#: What all entries together may take [bytes]; the least recently used are removed first.
CAPACITY = 2 << 30

_MAGIC = b"itouch-py mesh\n"
_HEAD = struct.Struct("<II")
_LONGEST_HEADER = 1 << 16
_BUILDERS = ("bvh", "neighbours", "solid", "surface", "triangle", "vectors")
_TABLES = (("<f8", 3), ("<i4", bvh.TRIANGLE_WIDTH), ("<f4", bvh.NODE_WIDTH))


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
    path = place / f"{name}.mesh"
    try:
        with path.open("rb") as stream:
            header = _header(stream, name)
            tables = [_table(stream, header, index) for index in range(len(_TABLES))]
            if stream.read(1):
                raise ValueError("surplus bytes")
        _check(*tables)
        facts = _facts(header["facts"])
        with contextlib.suppress(OSError):
            os.utime(path)  # mark it as used
        return Surface.of_tables((tables[0], tables[1], tables[2]), is_solid=bool(header["solid"])), facts
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError, struct.error):
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


def _table(stream: Any, header: dict[str, Any], index: int) -> NDArray[Any]:
    kind, width = _TABLES[index]
    rows = int(header["rows"][index])
    if not 1 <= rows <= MAX_VERTICES:
        raise ValueError("a table of an impossible size")
    table = np.fromfile(stream, kind, rows * width)
    if table.size != rows * width or zlib.crc32(table.data) != header["sums"][index]:
        raise ValueError("a table is damaged")
    return table.reshape(rows, width)


def _check(vertices: NDArray[Any], triangles: NDArray[Any], nodes: NDArray[Any]) -> None:
    """Raise ValueError unless every index refers to an existing row: the kernels that follow them do not check."""
    corners, faces, across = triangles[:, :3], triangles[:, 3], triangles[:, 4:]
    sound = bool(np.isfinite(vertices).all()) and len(triangles) <= MAX_FACES
    sound &= bool(corners.min() >= 0 and corners.max() < len(vertices))
    sound &= bool(min(faces.min(), across.min() + 1) >= 0 and max(faces.max(), across.max()) < len(triangles))
    refs, counts = nodes[:, bvh.CHILD_REF : bvh.CHILD_COUNT], nodes[:, bvh.CHILD_COUNT :]
    inner = counts == 0
    below = (refs > np.arange(len(nodes))[:, None]) & (refs < len(nodes))
    leaf = (counts > 0) & (counts <= bvh.LEAF) & (refs >= 0) & (refs + counts <= len(triangles))
    if not (sound and bool(np.where(inner, below, leaf).all())):
        raise ValueError("an index leads nowhere")


def _facts(values: dict[str, Any]) -> MeshFacts:
    values = {name: tuple(map(float, v)) if isinstance(v, list) else v for name, v in values.items()}
    if not all(isinstance(v, (int, float, tuple)) for v in values.values()):
        raise ValueError("facts are numbers")
    if set(values) != set(MeshFacts.__dataclass_fields__):
        raise ValueError("other facts")
    return MeshFacts(**values)
