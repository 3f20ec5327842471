"""Waits that are told: what takes long says what it does and how far it is; who shows it is another matter.

The command line shows it on a terminal; elsewhere nothing is shown, and it costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class Wait(Protocol):
    """A wait that is shown."""

    def part(self, done: float | None, words: str = "") -> None:
        """Say how far it is (0 to 1; None: nobody knows), and what is being done."""


class _Unseen:
    def part(self, done: float | None, words: str = "") -> None:
        """Show nothing."""


#: Shows a wait; set by the command line.
_shower: list[Callable[[str], AbstractContextManager[Wait]]] = []


@contextmanager
def waiting(what: str) -> Iterator[Wait]:
    """Tell, while the context lasts, that something takes its time.

    Parameters
    ----------
    what
        In the form "replaying touch.mcap".
    """
    if not _shower:
        yield _Unseen()
        return
    with _shower[-1](what) as wait:
        yield wait


@contextmanager
def shown_by(shower: Callable[[str], AbstractContextManager[Wait]]) -> Iterator[None]:
    """Let waits be shown by something while the context lasts."""
    _shower.append(shower)
    try:
        yield
    finally:
        _shower.remove(shower)
