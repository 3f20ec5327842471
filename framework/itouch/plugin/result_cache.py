"""A cache on disk of results found while scenes were compiled, by what determines them and the code that made them.

Each entry is a file: a line that names the format, the length and checksum of a JSON header, the header, then float64
arrays as they are in memory.  An entry that is truncated, altered, or made by other code or on another machine counts
as absent.  Nothing in an entry is code, and an entry is used only if nobody else can write to it or to its folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import platform
import struct
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch import caches

Arrays = tuple[NDArray[np.float64], ...]

#: Environment variable that names another folder, or ``off`` for none.
SWITCH = "ITOUCH_KEPT"
SUFFIX = ".arrays"
#: What all entries together, and a single one, may take [bytes].
CAPACITY, LARGEST = 256 << 20, 32 << 20

_MAGIC = b"itouch-py arrays 1\n"
_HEAD = struct.Struct("<I32s")
_LONGEST_HEADER = 1 << 14
_STARTED = time.time()


def folder() -> Path | None:
    """Return the folder of the cache, or None if it is switched off."""
    return caches.folder("found", SWITCH)


def key(content: object, make: Callable[..., object]) -> str | None:
    """Return the name of the entry that ``make`` makes from a content, or None if its code cannot be read."""
    code = _code(make.__module__.partition(".")[0]), _code("itouch")
    if None in code:
        return None
    words = (repr(content), make.__module__, make.__qualname__, *code, _machine())
    return hashlib.sha256(repr(words).encode()).hexdigest()[:40]


@cache
def _code(package: str) -> str | None:
    """Return the digest of all sources of a package; None if it has none, or they changed since this process began."""
    module = sys.modules.get(package)
    place = getattr(module, "__file__", None)
    if place is None:
        return None
    first = Path(place)
    paths = sorted(first.parent.rglob("*.py")) if first.name == "__init__.py" else [first]
    digest = hashlib.sha256()
    for other in getattr(module, "PACKAGES", ()):  # further packages of the same plugin
        inner = _code(other)
        if inner is None:
            return None
        digest.update(inner.encode())
    try:
        for path in paths:
            if path.stat().st_ctime > _STARTED:  # upgraded in place, or edited: what is in memory may be older
                return None
            digest.update(f"{path.relative_to(first.parent)}\0".encode() + path.read_bytes())
    except OSError:
        return None
    return digest.hexdigest() if paths else None


@cache
def _machine() -> tuple[str, ...]:
    """Return everything that may make results round differently: versions and the kind of processor."""
    kind = platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        kind = "|".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
    chosen = os.environ.get("NUMBA_CPU_NAME", ""), os.environ.get("NUMBA_DISABLE_JIT", "")
    return (platform.python_version(), np.__version__, sys.byteorder, kind, *chosen)


def read(name: str) -> Arrays | None:
    """Return the arrays of an entry, or None if there is no valid one."""
    place = folder()
    if place is None:
        return None
    try:
        with caches.opened(place, f"{name}{SUFFIX}") as stream:
            content = stream.read(LARGEST + 1)
        if len(content) > LARGEST:
            return None
        arrays = _arrays(content, name)
        with contextlib.suppress(OSError):
            os.utime(place / f"{name}{SUFFIX}")  # mark it as used
        return arrays
    except (OSError, ValueError, KeyError, TypeError, RecursionError, struct.error):
        return None


def write(name: str, arrays: Arrays) -> None:
    """Cache arrays of any shape and unit; if they are too large, or the folder cannot be written, do nothing."""
    place = folder()
    if place is not None:
        blocks = list(_blocks(name, arrays))
        size = sum(len(block) for block in blocks)
        if size <= LARGEST:
            caches.put(place, f"{name}{SUFFIX}", blocks, size=size, capacity=CAPACITY)


def _blocks(name: str, arrays: Arrays) -> Iterator[bytes]:
    content = [np.ascontiguousarray(array, "<f8").tobytes() for array in arrays]
    sums = [hashlib.sha256(part).hexdigest() for part in content]
    header = json.dumps({"key": name, "shapes": [array.shape for array in arrays], "sums": sums}).encode()
    yield _MAGIC
    yield _HEAD.pack(len(header), hashlib.sha256(header).digest())
    yield header
    yield from content


def _arrays(content: bytes, name: str) -> Arrays:
    """Return the arrays of an entry.

    Raises
    ------
    ValueError, KeyError, TypeError, struct.error
        If it is incomplete or damaged, or belongs to another name.
    """
    at = len(_MAGIC) + _HEAD.size
    if not content.startswith(_MAGIC):
        raise ValueError("another kind of file")
    length, checksum = _HEAD.unpack(content[len(_MAGIC) : at])
    text = content[at : at + min(length, _LONGEST_HEADER)]
    if len(text) != length or hashlib.sha256(text).digest() != checksum:
        raise ValueError("the header is damaged")
    header: dict[str, Any] = json.loads(text)
    if header["key"] != name:
        raise ValueError("another entry")
    found, at = [], at + length
    for shape, known in zip(header["shapes"], header["sums"], strict=True):
        if not all(isinstance(side, int) and side >= 0 for side in shape):
            raise ValueError("an impossible shape")
        part = content[at : at + 8 * math.prod(shape)]
        if hashlib.sha256(part).hexdigest() != known:
            raise ValueError("an array is damaged")
        found.append(np.frombuffer(part, "<f8").reshape(shape).astype(np.float64))
        at += len(part)
    if at != len(content):
        raise ValueError("surplus bytes")
    return tuple(found)
