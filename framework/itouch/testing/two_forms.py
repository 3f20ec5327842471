"""A method of a plugin in its two forms, in Python and compiled, run on equal arrays whose bytes are compared then."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.joining import Chain
from itouch.plugin import Bound, Record
from itouch.plugin.device import is_new
from itouch.testing.checks import CheckError

Array = NDArray[Any]
#: Arrays by their names: a record, or others.
Arrays = Mapping[str, Array]
#: The arrays of which a form may write some, each kind with the word for one of them in a finding.
Kinds = Sequence[tuple[str, Arrays]]


class ImplausibleError(Exception):
    """Python itself makes nothing of what was drawn: there is nothing to compare with."""


def unequal(found: str) -> CheckError:
    """Return the finding that the two forms do not do the same."""
    return CheckError(
        found,
        cause="two implementations that differ, or arithmetic in another order",
        advice="let the Python method be a call of what is bound, or compute both in the same order",
    )


class Sides:
    """The arrays of the form in Python, and those of the compiled one."""

    def __init__(self, python: Kinds, compiled: Kinds) -> None:
        self._python, self._compiled = _named(python), _named(compiled)
        self._memory = list(zip(_memory(python), _memory(compiled), strict=True))

    def level(self) -> None:
        """Let the compiled form go on from where Python is."""
        for one, other in self._memory:
            other[...] = one

    def kept(self) -> list[bytes]:
        """Return a copy of what the compiled form has."""
        return [other.tobytes() for _, other in self._memory]

    def differ(self) -> str:
        """Say which number is another one compiled than in Python, NaN being equal to NaN; empty: none."""
        equal = all(one.tobytes() == other.tobytes() for one, other in self._memory)
        return "" if equal else _first(self._compiled, self._python, "in Python")

    def changed(self, kept: Sequence[bytes]) -> str:
        """Say which number of the compiled form is another one than in a copy; empty: none."""
        return "" if self.kept() == list(kept) else _first(self._compiled, self._as_it_was(kept), "before it")

    def lost(self, kept: Sequence[bytes]) -> bool:
        """Tell whether Python has made a NaN of what was a number in a copy."""
        before = self._as_it_was(kept)
        floats = ((one, before[name]) for name, one in self._python.items() if one.dtype.kind == "f")
        return any(bool((np.isnan(now) & ~np.isnan(then)).any()) for now, then in floats)

    def _as_it_was(self, kept: Sequence[bytes]) -> Arrays:
        """Return the arrays of a copy by their names."""
        now = self.kept()
        self._write(kept)
        found = {name: one.copy() for name, one in self._compiled.items()}
        self._write(now)
        return found

    def _write(self, whole: Sequence[bytes]) -> None:
        for (_, other), one in zip(self._memory, whole, strict=True):
            other[...] = np.frombuffer(one, other.dtype).reshape(other.shape)


def _named(kinds: Kinds) -> Arrays:
    return {f"the {kind} '{name}'": one for kind, arrays in kinds for name, one in arrays.items()}


def _memory(kinds: Kinds) -> list[Array]:
    return [
        one for _, arrays in kinds for one in ([arrays.raw] if isinstance(arrays, Record) else list(arrays.values()))
    ]


def _first(found: Arrays, wanted: Arrays, against: str) -> str:
    for name, one in found.items():
        other = wanted[name]
        unlike = _unlike(one, other)
        if unlike.any():
            place = np.unravel_index(int(np.argmax(unlike)), unlike.shape)
            which = f", number {', '.join(map(str, place))}," if place else ""
            return f"{name}{which} is {one[place]} joined and {other[place]} {against}"
    return ""


def _unlike(one: Array, other: Array) -> Array:
    """Return where two arrays differ in their bytes, NaN being equal to NaN."""
    if one.dtype.kind == "V":
        return np.asarray([a.tobytes() != b.tobytes() for a, b in zip(one.ravel(), other.ravel(), strict=True)])
    if one.dtype.kind != "f":
        return np.asarray(one != other)
    words = f"i{one.itemsize}"
    return np.asarray((one.view(words) != other.view(words)) & ~(np.isnan(one) & np.isnan(other)))


class TwoForms:
    """A method in Python, and the bound calls that replace it in a tick; without any it is Python's alone."""

    def __init__(self, name: str, bounds: Sequence[Bound], python: Callable[[], object], sides: Sides) -> None:
        self.name, self._python, self._sides = name, python, sides
        #: The calls in place of Python's.
        self.bounds = tuple(bounds)
        self._chain = Chain(bounds, [len(bounds)]) if bounds else None
        #: How often both forms have run.
        self.compared = 0

    @property
    def offered(self) -> bool:
        """Whether there are both forms."""
        return self._chain is not None

    def run(self, where: str, *, drawn: bool = False) -> None:
        """Run both forms and compare what they have written.

        Parameters
        ----------
        where
            The place in the run, or the draw, for a finding.
        drawn
            Whether the arrays have been drawn at random.

        Raises
        ------
        CheckError
            If it is not the same.
        ImplausibleError
            If Python raises, or computes NaN, from what was drawn: the two forms may differ then.
        """
        kept = self._sides.kept()
        try:
            said = self._python()
        except Exception as error:
            if drawn:
                raise ImplausibleError from error
            raise
        code = self._joined(where) if self._chain is not None else 0
        if self._chain is None:
            self._sides.level()
        elif code >= 0:
            self._check_leaving(code, kept, where)
            self._sides.level()
        else:
            self.compared += 1
            self._compare(said, kept, where, drawn)

    def _joined(self, where: str) -> int:
        try:
            return self._chain.run() if self._chain is not None else 0
        except Exception as error:
            raise CheckError(
                f"what joins for {self.name} raises {type(error).__name__}: {error}, and Python does not, {where}",
                cause="the two forms differ in what they take for an error",
                advice="let both raise it, or neither",
            ) from error

    def _check_leaving(self, code: int, kept: Sequence[bytes], where: str) -> None:
        """Check that a form that leaves it to Python does so with its first call, and has changed nothing."""
        if found := self._sides.changed(kept):
            raise CheckError(
                f"{found}, though what joins for {self.name} returns {code & 0xFFFFFFFF}, {where}",
                cause="it changes something before it leaves the rest to Python",
                advice="decide first; of several calls, let only the first one return another number than 0",
            )

    def _compare(self, said: object, kept: Sequence[bytes], where: str, drawn: bool) -> None:
        found = "" if self.name != "read" or is_new(said) else "there is a new reading joined and none in Python"
        found = found or self._sides.differ()
        if not found:
            return
        if drawn and self._sides.lost(kept):
            raise ImplausibleError
        raise unequal(f"{found} after {self.name}, {where}")
