"""Notices of waits: code that takes long reports what it does and how far it is, without knowing who shows it.

The command line shows it on a terminal; elsewhere nothing is shown, at no cost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class Wait(Protocol):
    """A wait that is shown."""

    def part(self, done: float | None, words: str = "") -> None:
        """Report the progress (0 to 1; None: unknown), and what is being done."""


class _Unseen:
    def part(self, done: float | None, words: str = "") -> None:
        """Show nothing."""


#: The functions that show waits, of which the last is used; set by the command line.
_shower: list[Callable[[str], AbstractContextManager[Wait]]] = []


@contextmanager
def waiting(what: str) -> Iterator[Wait]:
    """Show, inside the context, that something takes time.

    Parameters
    ----------
    what
        What is being done, in the form "replaying touch.mcap".
    """
    if not _shower:
        yield _Unseen()
        return
    with _shower[-1](what) as wait:
        yield wait


@contextmanager
def shown_by(shower: Callable[[str], AbstractContextManager[Wait]]) -> Iterator[None]:
    """Let ``shower`` show waits inside the context."""
    _shower.append(shower)
    try:
        yield
    finally:
        _shower.remove(shower)
