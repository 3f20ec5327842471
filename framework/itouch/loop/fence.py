"""One writer at run time: a modality is given State with its own fields and commands to write, the rest to read.

Python that writes elsewhere is stopped by the memory itself.  Compiled code knows no such views: what it has changed
elsewhere is seen by a copy that was taken before, put back before anything is checked or sent, and is a fault.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from itouch.plugin import Record
from itouch.plugin.fenced import FencedRecord
from itouch.world import ModalityModel


def own_fields(one: ModalityModel, state: Record) -> list[str]:
    """Return the fields of State that a modality may write."""
    commands = {".command.".join(command.split(".", 1)) for command in one.commands}
    return [name for name in state if name.startswith(f"{one.name}.") or name in commands]


def view_for(one: ModalityModel, state: Record) -> FencedRecord:
    """Return State as a modality may use it."""
    return FencedRecord(state, own_fields(one, state))


class Fence:
    """Sees whether modalities have written what is not theirs, and puts it back.

    ``take`` before they work, ``mend`` after; both cost a few microseconds for a State of some 20 kB.
    """

    def __init__(self, modalities: Sequence[ModalityModel], state: Record) -> None:
        self._state = state
        own = {name for one in modalities for name in own_fields(one, state)}
        memory = state.raw.data
        self._others = [memory[start:end] for start, end in _spans(state, set(state) - own)]
        self._before: list[bytes] = []

    def take(self) -> None:
        """Remember what is not theirs."""
        self._before = [other.tobytes() for other in self._others]

    def mend(self) -> str:
        """Put back what is not theirs; return the name of a field that was changed, or nothing."""
        found = ""
        for other, before in zip(self._others, self._before, strict=True):
            if other.tobytes() != before:
                was = Record(self._state.dtype, self._state.raw.copy())
                other[:] = before
                found = found or self._differs(was)
        return found

    def _differs(self, was: Record) -> str:
        return next((name for name, view in self._state.items() if view.tobytes() != was[name].tobytes()), "")


def _spans(state: Record, names: Iterable[str]) -> Iterable[tuple[int, int]]:
    """Yield begin and end of the memory of these fields, neighbours together."""
    table: Any = state.dtype.fields or {}
    wanted, begin, last = set(names), -1, -1
    for name, kind in sorted(table.items(), key=lambda entry: entry[1][1]):
        if name not in wanted:
            continue
        if kind[1] != last:
            if begin >= 0:
                yield begin, last
            begin = kind[1]
        last = kind[1] + kind[0].itemsize
    if begin >= 0:
        yield begin, last
