"""Flat blocks of numbers: where each of their parts begins, counted from the widths of the parts before it.

A kernel's constants lie in one flat array, because each further array costs time at every call.  Its
parts have names; a name's place is never written down as a number, so that a part that is put in or becomes wider
moves all that follow.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from typing import Protocol


class Block:
    """A flat array of numbers, whose parts are named in their order; ``width`` is how many numbers it has so far."""

    def __init__(self) -> None:
        self.width = 0

    def part(self, width: int = 1) -> int:
        """Return where the next part begins, which has this many numbers."""
        self.width += width
        return self.width - width

    def parts(self, *widths: int) -> tuple[int, ...]:
        """Return where the next parts begin, of which each has its width."""
        return tuple(self.part(width) for width in widths)


class Sized(Protocol):
    """What has a name and a size, such as a field of State; size 0 is a single number."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def size(self) -> int | tuple[int, ...]:
        """Its size, or its shape."""


def places(fields: Iterable[Sized]) -> dict[str, int]:
    """Return where each field begins in the flat array of fields that follow one another (`Record.flat`)."""
    block = Block()
    return {field.name: block.part(max(1, prod(_shape(field)))) for field in fields}


def width(fields: Iterable[Sized]) -> int:
    """Return how many numbers fields are together."""
    return sum(max(1, prod(_shape(field))) for field in fields)


def _shape(field: Sized) -> tuple[int, ...]:
    return (field.size,) if isinstance(field.size, int) else field.size
