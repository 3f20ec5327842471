"""Campaigns have a short form, which always runs, and a full one, which runs with ``-m long``: one switch for both.

A test that calls ``size`` carries the mark ``campaign``: without ``-m long`` it tries a few cases; with it, all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from _pytest.mark.expression import Expression
from _pytest.mark.structures import ParameterSet

#: Whether the long form runs; set before any test is collected.
FULL = False
#: What the campaigns of the test that is running have told.
TOLD: list[str] = []


def chosen(expression: str) -> bool:
    """Tell whether ``-m expression`` asks for what is long, and for nothing else."""
    if not expression:
        return False
    found = Expression.compile(expression)
    return found.evaluate(lambda name, **_: name == "long") and not found.evaluate(lambda name, **_: False)


def size(short: int, full: int) -> int:
    """Return how many cases to try."""
    return full if FULL else short


def tell(text: str) -> None:
    """Note a line of a campaign's result; the long form prints it at its end."""
    TOLD.append(text)


def seeds(short: int, full: int, *, first: int = 0) -> list[ParameterSet]:
    """Return the seeds of a test: the first few are tried always, the others in the long form."""
    return [
        pytest.param(seed, marks=() if seed < first + short else pytest.mark.long)
        for seed in range(first, first + full)
    ]


def some(values: Iterable[Any], keep: int | Callable[[Any], bool]) -> list[ParameterSet]:
    """Return parameters of a test: the first so many, or those that are to be kept, always; the others in the long form."""
    found = []
    for place, value in enumerate(values):
        always = place < keep if isinstance(keep, int) else keep(value)
        words = value if isinstance(value, tuple) else (value,)
        found.append(pytest.param(*words, marks=() if always else pytest.mark.long))
    return found
