"""One structured record of numbers with named views into it: the memory that the framework owns."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from itouch.plugin.quantity import Bound, Quantity, Role


@dataclass(frozen=True, slots=True, init=False)
class Field(Quantity):
    """A named piece of State: a NumPy scalar type and a size; size 0 is a plain scalar.

    ``dtype`` may be a list of (name, type) pairs for a table of ``size`` rows.  ``low`` and ``high`` bound its values
    where that matters, as for an index or a choice: one number for all components, or one each (infinite: any value).
    A stored session with a value out of bounds is refused; during a run they are not checked.  ``unit``, ``doc``,
    ``role`` and ``show`` are those of a `Quantity`.
    """

    def __init__(
        self, name: str, dtype: Any = "f8", size: int | tuple[int, ...] = 0, low: Bound = -math.inf,
        high: Bound = math.inf, *, unit: str = "", doc: str = "", role: Role = Role.SIGNAL, show: str = "",
    ) -> None:  # fmt: skip
        super(Field, self).__init__(name, size, unit, low, high, dtype=dtype, doc=doc, role=role, show=show)
        for label, bound in (("low", self.low), ("high", self.high)):
            if isinstance(bound, tuple) and len(bound) != self.size:
                raise ValueError(f"state field '{self.name}': {label} has {len(bound)} numbers for size {self.size}")

    @classmethod
    def of(cls, quantity: Quantity, name: str = "", *, doc: str = "", show: str = "") -> Field:
        """Return a field of numbers for a quantity, with another name, ``doc`` or ``show`` if one is given.

        The bounds are not copied: those of a channel are limits, enforced elsewhere; those of a field say what a valid
        State is.
        """
        return cls(
            name or quantity.name, "f8", quantity.size, unit=quantity.unit, doc=doc or quantity.doc,
            role=quantity.role, show=show or quantity.show,
        )  # fmt: skip

    def descriptor(self, prefix: str = "") -> tuple[Any, ...]:
        """Return the entry of a NumPy dtype list."""
        shape = (self.size,) if isinstance(self.size, int) else self.size
        return (prefix + self.name, self.dtype) if self.size == 0 else (prefix + self.name, self.dtype, shape)


class Record(dict[str, NDArray[Any]]):
    """Named views of one packed record.

    ``record["pose"]`` is an array view (0-d for a scalar), and ``record["pose"] = x`` writes into it.  The views stay
    valid for the lifetime of the record: nothing is ever reallocated.  (It is a dictionary of its views, because a tick
    looks up some fifty of them.)
    """

    __slots__ = ("__weakref__", "_buffer", "_bytes", "_numbers", "_words")

    def __init__(self, dtype: np.dtype[Any], buffer: NDArray[np.uint8] | None = None) -> None:
        self._words: NDArray[np.int64] | None = None
        if buffer is None:
            self._words = np.zeros((dtype.itemsize + 7) // 8, np.int64)
            buffer = self._words.view(np.uint8)[: dtype.itemsize]
        if buffer.shape != (dtype.itemsize,):
            raise ValueError(f"a buffer of {buffer.size} bytes cannot hold a record of {dtype.itemsize}")
        whole = buffer.view(dtype) if dtype.itemsize else np.zeros(1, dtype)
        self._buffer: NDArray[Any] = whole.reshape(())
        self._bytes: NDArray[np.uint8] | None = None  # made at first use
        self._numbers: NDArray[np.float64] | None = None
        super().__init__({name: self._buffer[name] for name in dtype.names or ()})

    @classmethod
    def of(cls, fields: Iterable[Field]) -> Record:
        """Make a zeroed record of these fields."""
        return cls(dtype_of(fields))

    def __setitem__(self, name: str, value: ArrayLike) -> None:
        self[name][...] = value

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the structured array behind the views, or a copy of it if ``copy`` is true."""
        return self._buffer.copy() if copy else self._buffer

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Record) and self.dtype == other.dtype and self.tobytes() == other.tobytes()

    def __ne__(self, other: object) -> bool:
        return not self == other  # that of a dictionary would compare arrays

    __hash__ = None  # mutable

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} fields, {self._buffer.nbytes} bytes)"

    @property
    def dtype(self) -> np.dtype[Any]:
        """The structured type."""
        return self._buffer.dtype

    @property
    def nbytes(self) -> int:
        """Size of the record in bytes."""
        return self._buffer.nbytes

    @property
    def raw(self) -> NDArray[np.uint8]:
        """The memory itself, shape (nbytes,); writing to it changes the views."""
        if self._bytes is None:
            self._bytes = self._buffer.reshape(1).view(np.uint8)
        return self._bytes

    @property
    def numbers(self) -> NDArray[np.float64]:
        """The memory of a record of float64 only, such as readings or commands, as one flat view."""
        if self._numbers is None:
            self._numbers = self.raw.view(np.float64)
        return self._numbers

    @property
    def words(self) -> NDArray[np.int64]:
        """The memory as 64-bit words, shape (n,), of which the last may have bytes that belong to no field.

        Raises
        ------
        ValueError
            If the record is in the memory of another one.
        """
        if self._words is None:
            raise ValueError("a record in the memory of another one has no words of its own")
        return self._words

    def tobytes(self) -> bytes:
        """Return a copy of the memory: equal bytes are equal states."""
        return self._buffer.tobytes()

    def copy(self) -> Record:
        """Return an independent record with the same content."""
        return type(self)(self.dtype, self.raw.copy())

    def __reduce__(self) -> tuple[type[Record], tuple[np.dtype[Any], NDArray[np.uint8]]]:
        """Let pickle and ``copy`` make a record of its own with the same content, as `copy` does."""
        return type(self), (self.dtype, self.raw.copy())

    def flat(self, first: str, last: str) -> NDArray[np.float64]:
        """Return the contiguous float64 fields from ``first`` to ``last`` as one flat view.

        Raises
        ------
        ValueError
            If one of them, or a field between them, is not float64.
        """
        table: Any = self.dtype.fields or {}
        start, end = table[first][1], table[last][1] + table[last][0].itemsize
        between = [kind for kind, offset in table.values() if start <= offset < end]
        if end <= start or any(kind.base != np.dtype("f8") for kind in between):
            raise ValueError(f"the fields from '{first}' to '{last}' are not all float64")
        return self.raw[start:end].view(np.float64)

    def part(self, prefix: str, names: Iterable[str] | None = None) -> Record:
        """Return a record of contiguous fields whose names start with ``prefix``, which their new names lack.

        Parameters
        ----------
        prefix
            The beginning of all the names.
        names
            The names without the prefix, in order; default: all fields with the prefix.

        Raises
        ------
        ValueError
            If no field is chosen or they are not contiguous.
        """
        table: Any = self.dtype.fields or {}
        wanted = [prefix + name for name in names] if names is not None else list(self)
        chosen = [(name, table[name][0], table[name][1]) for name in wanted if name.startswith(prefix)]
        if not chosen:
            raise ValueError(f"no field starts with '{prefix}'")
        start, end = chosen[0][2], chosen[-1][2] + chosen[-1][1].itemsize
        if end - start != sum(kind.itemsize for _, kind, _ in chosen):
            raise ValueError(f"the fields of '{prefix}' are not contiguous")
        inner = np.dtype([_entry(name[len(prefix) :], kind) for name, kind, _ in chosen])
        return Record(inner, self.raw[start:end])


def _entry(name: str, kind: np.dtype[Any]) -> tuple[Any, ...]:
    return (name, kind.subdtype[0], kind.subdtype[1]) if kind.subdtype else (name, kind)


def dtype_of(fields: Iterable[Field], prefix: str = "") -> np.dtype[Any]:
    """Return the packed structured type of these fields.

    Raises
    ------
    ValueError
        If two fields have the same name.
    """
    listed: Sequence[Field] = tuple(fields)
    names = Counter(field.name for field in listed)
    twice = sorted(name for name, count in names.items() if count > 1)
    if twice:
        raise ValueError(f"state field '{prefix}{twice[0]}' is declared twice")
    return np.dtype([field.descriptor(prefix) for field in listed])
