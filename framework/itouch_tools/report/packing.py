"""Curves as a page carries them: 16-bit integers, as differences, deflated, all in one base64 text.

A page is for looking: a step of 1/65534 of a curve's range is far below a pixel. The recording keeps what was recorded.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch_tools.report.curves import Block

#: The integer that stands for NaN; numbers are -32767 to 32767.
_NOTHING, _MOST = -32768, 32767


class Packer:
    """Collects stretches of curves: their samples go into one stream, and a few numbers say where each lies in it."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._size = 0

    def add(self, block: Block, begin: float) -> dict[str, Any]:
        """Take a stretch, its times counted from ``begin`` [s]; return what the page needs to find it again.

        Returns
        -------
        dict
            ``begin`` [s]; ``at``, its first byte in the stream; ``count``, the number of its samples; and ``rows``, the
            least value and the step of the times and of each signal.
        """
        rows = [block.times - begin, *block.values]
        return {"begin": begin, "at": self._size, "count": len(block.times), "rows": [self._row(row) for row in rows]}

    def _row(self, values: NDArray[np.floating[Any]]) -> list[float]:
        values = np.asarray(values, np.float64)
        known = np.isfinite(values)
        low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
        step = (high - low) / (2 * _MOST) or 1.0
        with np.errstate(invalid="ignore"):
            whole = np.where(known, np.rint((values - low) / step) - _MOST, _NOTHING)
        bits = np.asarray(np.nan_to_num(whole), np.int64).astype(np.int16).view(np.uint16)
        change = np.diff(bits, prepend=np.uint16(0)).astype("<u2")  # differences wrap around, and so do their sums
        data = change.view(np.uint8).reshape(-1, 2).T.tobytes()
        self._pieces.append(data)
        self._size += len(data)
        return [low, step]

    def text(self) -> str:
        """Return the stream: for each row all low bytes, then all high bytes; deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._pieces), 9)).decode()
