"""Arrays from a glTF's buffers, each checked against the bytes that are actually there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.size_limits import MAX_VERTICES

Numbers = NDArray[Any]

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def item(items: Any, index: Any) -> Any:
    """Return an item of a list by an index read from a file; negative indices are refused.

    Raises
    ------
    ValueError
        If the list has no such item.
    """
    if not isinstance(items, list) or isinstance(index, bool) or not isinstance(index, int):
        raise ValueError(f"{index!r} is not an index of a list")
    if not 0 <= index < len(items):
        raise ValueError(f"there is no item {index} in a list of {len(items)}")
    return items[index]


class Accessors:
    """The accessors of one document; each is read once."""

    __slots__ = ("_buffers", "_document", "_known")

    def __init__(self, document: dict[str, Any], buffers: list[bytes]) -> None:
        self._document, self._buffers = document, buffers
        self._known: dict[int, Numbers] = {}

    def read(self, index: int, *, columns: int) -> Numbers:
        """Return an accessor as a (count, columns) array.

        Raises
        ------
        ValueError, KeyError, TypeError
            If it has another number of columns, or does not fit its buffer.
        """
        accessor = item(self._document["accessors"], index)
        if _COLUMNS[accessor["type"]] != columns:
            raise ValueError(f"accessor {index} is a {accessor['type']}, not of {columns} columns")
        if index not in self._known:
            self._known[index] = self._read(accessor, columns)
        return self._known[index]

    def _read(self, accessor: dict[str, Any], columns: int) -> Numbers:
        count = int(accessor["count"])
        if not 0 <= count <= MAX_VERTICES:
            raise ValueError(f"an accessor has {count} items; the limit is {MAX_VERTICES}")
        kind = np.dtype(_TYPES[accessor["componentType"]])
        if "bufferView" in accessor:
            values = self._view(accessor["bufferView"], int(accessor.get("byteOffset", 0)), count, columns, kind)
        else:
            values = np.zeros((count, columns), kind)
        if "sparse" in accessor:
            values = self._sparse(accessor["sparse"], values)
        if accessor.get("normalized", False) and kind.kind != "f":
            return np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _view(self, index: int, offset: int, count: int, columns: int, kind: np.dtype[Any]) -> Numbers:
        view = item(self._document["bufferViews"], index)
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        content = item(self._buffers, view["buffer"])
        row = columns * kind.itemsize
        stride = int(view.get("byteStride", row))
        end = offset + (count - 1) * stride + row if count else 0
        if min(start, length, offset) < 0 or stride < row or end > length or start + length > len(content):
            raise ValueError(f"an accessor of {count} items does not fit its buffer view {index}")
        if count == 0:
            return np.zeros((0, columns), kind)
        part = memoryview(content)[start : start + length]
        return np.ndarray((count, columns), kind, part, offset, (stride, kind.itemsize)).copy()

    def _sparse(self, sparse: dict[str, Any], values: Numbers) -> Numbers:
        count, where, what = int(sparse["count"]), sparse["indices"], sparse["values"]
        if not 0 <= count <= len(values):
            raise ValueError(f"{count} sparse items for an accessor of {len(values)}")
        kind = np.dtype(_TYPES[where["componentType"]])
        rows = self._view(where["bufferView"], int(where.get("byteOffset", 0)), count, 1, kind)[:, 0].astype(np.int64)
        if count and (rows.min() < 0 or rows.max() >= len(values)):
            raise ValueError("a sparse index lies outside its accessor")
        offset = int(what.get("byteOffset", 0))
        values[rows] = self._view(what["bufferView"], offset, count, values.shape[1], values.dtype)
        return values
