"""Rows of a track while they are read, in one piece of memory that grows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class RowBuffer:
    """A table to whose end rows are added; hours of them stand in memory about once, not twice."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self._rows, self._count = np.empty(1024, dtype), 0

    def add(self, table: NDArray[Any]) -> None:
        """Copy rows (n,) of the buffer's dtype to the end."""
        needed = self._count + len(table)
        if needed > len(self._rows):
            grown = np.empty(max(needed, 2 * len(self._rows)), self._rows.dtype)
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown
        self._rows[self._count : needed] = table
        self._count = needed

    @property
    def rows(self) -> NDArray[Any]:
        """All rows; what was reserved beyond them was never touched and takes no memory."""
        return self._rows[: self._count]
