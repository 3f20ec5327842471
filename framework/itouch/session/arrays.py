"""Arrays in the files of a session: the record of State, and the bases; nothing is evaluated or unpickled."""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.plugin.bases import Arrays

#: Longest header of an array [bytes], greatest number of arrays in a basis.
_HEADER, _MOST = 1 << 20, 64
#: The version of the ``.npy`` format whose header may have any letters, because names of fields may.
_UTF8 = (3, 0)


def npy_header(dtype: np.dtype[Any]) -> bytes:
    """Return what precedes one record of this type in an ``.npy`` file."""
    stream = io.BytesIO()
    version = None if str(dtype).isascii() else _UTF8  # left to choose, NumPy would warn of that format
    npy.write_array(stream, np.zeros(1, dtype), version=version, allow_pickle=False)
    return stream.getvalue()[: -dtype.itemsize] if dtype.itemsize else stream.getvalue()


def record_from(data: bytes) -> NDArray[Any]:
    """Return the one record of an ``.npy`` file, shape (1,).

    Raises
    ------
    ValueError
        If it holds anything else.
    """
    stream = io.BytesIO(data)
    shape, dtype = _header(stream)
    if dtype.hasobject or dtype.names is None or shape != (1,):
        raise ValueError(f"the state is not one record of numbers, but {shape} of {str(dtype)[:60]}")
    body = data[stream.tell() :]
    if len(body) != dtype.itemsize:
        raise ValueError(f"the state has {len(body)} bytes, its type says {dtype.itemsize}")
    return np.frombuffer(body, dtype)


def _header(stream: io.BytesIO) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type from the header of an ``.npy`` file; whatever is wrong with it is a ValueError."""
    try:
        version = npy.read_magic(stream)
        if version == _UTF8:
            (length,) = struct.unpack("<I", stream.read(4))
            # NumPy has no public reader of this header: with escapes for its letters, the one of the format before does
            plain = stream.read(length).decode("utf-8").encode("ascii", "backslashreplace")
            head = io.BytesIO(struct.pack("<I", len(plain)) + plain)
        else:
            head = stream
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = read(head, max_header_size=_HEADER)
    except Exception as error:  # its parser raises from SyntaxError to MemoryError on mutated headers
        raise ValueError(f"the head of an array makes no sense: {str(error)[:80]}") from error
    return shape, dtype


def write_record(header: bytes, state: Record) -> bytes:
    """Return the ``.npy`` file of a State whose header is known."""
    return header + state.tobytes()


def pack_bases(used: Mapping[str, Arrays]) -> tuple[bytes, dict[str, list[list[int]]]]:
    """Return all numbers of all bases in a row, as ``.npy``, and the shapes of each basis by its key."""
    shapes = {key: [list(array.shape) for array in arrays] for key, arrays in used.items()}
    numbers = [np.ascontiguousarray(array, np.float64).ravel() for arrays in used.values() for array in arrays]
    stream = io.BytesIO()
    npy.write_array(stream, np.concatenate([*numbers, np.zeros(0)]), allow_pickle=False)
    return stream.getvalue(), shapes


def load_bases(data: bytes, shapes: Any) -> dict[str, Arrays]:
    """Return the bases by key, read-only.

    Raises
    ------
    ValueError
        If numbers and shapes do not fit.
    """
    stream = io.BytesIO(data)
    shape, dtype = _header(stream)
    body = data[stream.tell() :]
    if dtype != np.dtype("<f8") or len(shape) != 1 or len(body) != 8 * shape[0]:
        raise ValueError("the bases are not a row of float64")
    numbers, at = np.frombuffer(body, np.float64), 0
    found: dict[str, Arrays] = {}
    for key, listed in dict(shapes).items():
        arrays = []
        for extent in listed[:_MOST]:
            sizes = tuple(int(size) for size in extent)
            count = int(np.prod(sizes, dtype=object)) if sizes else 1
            if len(sizes) > 3 or any(size < 0 for size in sizes) or count > len(numbers) - at:
                raise ValueError(f"basis '{key[:40]}' does not fit its shapes")
            arrays.append(numbers[at : at + count].reshape(sizes))
            at += count
        found[str(key)] = tuple(arrays)
    if at != len(numbers):
        raise ValueError(f"{len(numbers) - at} numbers of the bases belong to nothing")
    return found
