"""One writer at run time: a modality is given State with its own fields and commands to write, the rest to read.

Python code that writes elsewhere is stopped by read-only views.  Compiled code does not heed them: what it has changed
elsewhere is found by comparison with a copy taken before, put back before anything is checked or sent, and is a fault.

In the compiled functions ``memory`` (n,) is that of State, in words if it consists of such, else in bytes, ``kept``
(m,) is the copy, and ``spans`` (k, 2) has the indices at which each part that is copied begins and ends.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from itouch.compiling import kernel
from itouch.plugin import Bound, Record
from itouch.plugin.write_protection import WriteProtectedRecord
from itouch.world import ModalityModel


def own_fields(one: ModalityModel, state: Record) -> list[str]:
    """Return the fields of State that a modality may write: those that it declares, and its commands."""
    own = {".command.".join(command.split(".", 1)) for command in one.commands}
    own |= {
        f"{one.name}.{field}" for field in one.fields
    }  # not all that begin so: the scene may call it "finger.surface"
    return [name for name in state if name in own]


def owned(modalities: Iterable[ModalityModel], state: Record) -> set[str]:
    """Return the fields of State that any of these modalities may write."""
    return {name for one in modalities for name in own_fields(one, state)}


def shown_fields(one: ModalityModel, state: Record) -> tuple[str, ...]:
    """Return a modality's fields as a plan shows them: as ``NAME.*``, unless fields of others begin so, too."""
    own = tuple(f"{one.name}.{field}" for field in one.fields)
    return own if any(name.startswith(f"{one.name}.") and name not in own for name in state) else (f"{one.name}.*",)


def view_for(one: ModalityModel, state: Record) -> WriteProtectedRecord:
    """Return the view of State for a modality: it may read all of it, and write only its own fields and commands."""
    return WriteProtectedRecord(state, own_fields(one, state))


#: Least size [bytes] of a piece of memory that is worth comparing by itself.
_LONG = 512


class WriteGuard:
    """A guard of State: finds out whether modalities have written what is not theirs, and puts it back.

    Call ``take`` before they run and ``mend`` after: the whole of State is compared, for compiled code may write
    anywhere.
    """

    def __init__(self, modalities: Iterable[ModalityModel], state: Record, names: Iterable[str] | None = None) -> None:
        """``names``: the fields to watch, of which their own are left out; default: all."""
        self._state = state
        names = set(state if names is None else names) - owned(modalities, state)
        spans = np.array(list(_spans(state, names)), np.int64).reshape(-1, 2)
        whole = not (state.nbytes % 8 or (spans % 8).any())  # words are compared faster than bytes
        kind, unit = (np.dtype(np.int64), 8) if whole else (np.dtype(np.uint8), 1)
        kept = np.zeros(int((spans[:, 1] - spans[:, 0]).sum()) // unit, kind)
        self._arguments = state.raw.view(kind), spans // unit, kept
        #: ``take`` and the comparison of ``mend`` as calls that join; the second returns 1 if something has changed.
        self.keep, self.look = Bound(keep, *self._arguments), Bound(differ, *self._arguments)
        self.keep()

    def take(self) -> None:
        """Remember the content of what is not theirs."""
        self.keep()

    def mend(self) -> str:
        """Put back what is not theirs; return the name of a field that was changed; empty: none was."""
        if not self.look():
            return ""
        was = Record(self._state.dtype, self._state.raw.copy())
        put_back(*self._arguments)
        return self._differs(was)

    def _differs(self, was: Record) -> str:
        return next((name for name, view in self._state.items() if view.tobytes() != was[name].tobytes()), "")


class WriteGuards:
    """One guard around all modalities of a tick: those that carry surfaces (carriers), and the others, which run later.

    Between the two the framework's own steps write, so it has three parts: ``rest``, which nobody may write from
    the first carrier to the last modality, is remembered once and compared once; what those steps write, commands, and
    pieces too short to be worth it are compared after the carriers (``near``), remembered anew, and compared after the
    other modalities (``later``).  A modality that writes to the fields of another one is not found out, here as with a
    single guard around several modalities.
    """

    def __init__(
        self, carriers: Sequence[ModalityModel], modalities: Sequence[ModalityModel], between: Iterable[str],
        state: Record,
    ) -> None:  # fmt: skip
        """``between``: the fields that the framework's steps between carriers and modalities write."""
        first, second = owned(carriers, state), owned(modalities, state)
        written = {*between, *(name for name in state if ".command." in name)}
        rest = _in_long_pieces(state, set(state) - written - first - second)
        foreign = {name for name in second if ".command." not in name}
        self.near = WriteGuard(carriers, state, set(state) - rest - foreign)
        self.later = WriteGuard(modalities, state, set(state) - rest)
        self.rest = WriteGuard((*carriers, *modalities), state, rest)


def mended(fences: Iterable[WriteGuard]) -> str:
    """Put back what these guards watch; return the name of a field that was changed; empty: none was."""
    found = [fence.mend() for fence in fences]
    return next((name for name in found if name), "")


def _in_long_pieces(state: Record, names: set[str]) -> set[str]:
    """Return those fields that stand in long pieces of memory: each piece has a cost of its own besides its bytes."""
    table: Any = state.dtype.fields or {}
    pieces = [piece for piece in _spans(state, names) if piece[1] - piece[0] >= _LONG]
    return {name for name in names if any(begin <= table[name][1] < end for begin, end in pieces)}


def _spans(state: Record, names: Iterable[str]) -> Iterable[tuple[int, int]]:
    """Yield begin and end [bytes] of the memory of these fields, adjacent ones merged."""
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


# Each span is taken as an array of its own: as far as the compiler knows, an index into the whole might be negative,
# and it would then compare and copy word by word, many times slower.


@kernel
def keep(memory: Any, spans: Any, kept: Any) -> int:
    """Copy the spans of memory, one after the other; return 0."""
    at = 0
    for k in range(spans.shape[0]):
        source = memory[spans[k, 0] : spans[k, 1]]
        target = kept[at : at + source.shape[0]]
        for i in range(source.shape[0]):
            target[i] = source[i]
        at += source.shape[0]
    return 0


@kernel
def differ(memory: Any, spans: Any, kept: Any) -> int:
    """Return 1 if the spans of memory are not what was kept, else 0."""
    at = 0
    for k in range(spans.shape[0]):
        one = memory[spans[k, 0] : spans[k, 1]]
        other = kept[at : at + one.shape[0]]
        changed = 0
        for i in range(one.shape[0]):
            changed |= one[i] ^ other[i]
        if changed != 0:
            return 1
        at += one.shape[0]
    return 0


@kernel
def put_back(memory: Any, spans: Any, kept: Any) -> int:
    """Make the spans of memory what was kept; return 0."""
    at = 0
    for k in range(spans.shape[0]):
        target = memory[spans[k, 0] : spans[k, 1]]
        for i in range(target.shape[0]):
            target[i] = kept[at + i]
        at += target.shape[0]
    return 0
