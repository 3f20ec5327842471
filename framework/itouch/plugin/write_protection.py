"""A record of which only some fields may be written: State as a plugin gets it, which may write only its own fields."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from itouch.plugin.record import Record


class NotYoursError(ValueError):
    """A plugin has tried to write a field of State that is not its own."""


class WriteProtectedRecord(Record):
    """The memory of another record, of which only some views can be written."""

    __slots__ = ("_open", "_whole")

    def __init__(self, whole: Record, writable: Iterable[str]) -> None:
        super().__init__(whole.dtype, whole.raw)
        self._whole, self._open = whole, frozenset(writable)
        for name, view in self.items():
            view.flags.writeable = name in self._open
        self._buffer.flags.writeable = False

    def __setitem__(self, name: str, value: ArrayLike) -> None:
        if name not in self._open and name in self:
            raise NotYoursError(
                f"'{name}' is not its own: it may write the fields that it declares and the commands that it names"
            )
        self[name][...] = value

    def copy(self) -> Record:
        """Return an independent record with the same content, which may be written."""
        return self._whole.copy()

    def part(self, prefix: str, names: Iterable[str] | None = None) -> Record:
        """Return contiguous fields as ``Record.part`` does; each may be written if it may be here."""
        listed = None if names is None else tuple(names)
        chosen = [prefix + name for name in listed] if listed is not None else [n for n in self if n.startswith(prefix)]
        found = self._whole.part(prefix, listed)
        own = [name.removeprefix(prefix) for name in chosen if name in self._open]
        return found if len(own) == len(chosen) else WriteProtectedRecord(found, own)

    def flat(self, first: str, last: str) -> NDArray[np.float64]:
        """Return contiguous fields as ``Record.flat`` does; they may be written if all of them may."""
        found = self._whole.flat(first, last)
        table: Any = self.dtype.fields or {}
        start, end = table[first][1], table[last][1]
        if not all(name in self._open for name, (_, offset) in table.items() if start <= offset <= end):
            found.flags.writeable = False
        return found
