"""Numbers of State as text and back, bit for bit."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_QUIET = struct.pack("<d", math.nan)


def to_text(values: NDArray[Any]) -> str:
    """Return numbers, of any shape (n, ...) and unit, as text, separated by blanks.

    It is the shortest text that reads back to the same bits; values that are not numbers are written in hexadecimal.
    """
    if values.dtype.kind in "iub":
        return " ".join(str(int(value)) for value in values.ravel())
    if values.dtype.kind == "f":
        return " ".join(_float(value) for value in values.astype("f8").ravel().tolist())
    return np.ascontiguousarray(values).tobytes().hex()


def _float(value: float) -> str:
    if value == value:
        return repr(value)
    bits = struct.pack("<d", value)
    return "nan" if bits == _QUIET else "nan:" + bits[::-1].hex()


def from_text(text: str, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return ``count`` numbers of a type from their text.

    Raises
    ------
    ValueError
        If the text holds something else, or another count.
    """
    if dtype.kind not in "iubf":
        data = bytes.fromhex(text)
        if len(data) != count * dtype.itemsize:
            raise ValueError(f"{len(data)} bytes, not {count * dtype.itemsize}")
        return np.frombuffer(data, dtype).copy()
    words = text.split()
    if len(words) != count:
        raise ValueError(f"{len(words)} numbers, not {count}")
    if dtype.kind == "f":
        return _floats(words).astype(dtype)
    return np.array([int(word) for word in words], dtype)


def _floats(words: Sequence[str]) -> NDArray[np.float64]:
    data = b"".join(
        bytes.fromhex(word[4:])[::-1] if word.startswith("nan:") and len(word) == 20 else struct.pack("<d", float(word))
        for word in words
    )
    return np.frombuffer(data, np.float64).copy()
