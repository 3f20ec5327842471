"""Hooks for the program that uses this package: where it keeps compiled functions and results of solves.

By itself the package compiles with Numba, which keeps what it compiled by its own rule, and solves each basis anew.  A
program that has stores of its own says so once, with ``use``, before it imports anything else of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Function = TypeVar("Function", bound=Callable[..., object])
Arrays = tuple[NDArray[np.float64], ...]


class Host(Protocol):
    """What a host offers."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Return a function compiled by Numba with IEEE division; ``nogil`` lets other threads run beside it."""

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Arrays], load: Any) -> Any:
        """Return what belongs to a content, from a store or from ``make``."""

    def building(self) -> bool:
        """Tell whether caches of what is made from kept arrays must not be used now."""


class Alone:
    """No host: Numba's own store, and no other."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Compile when it is first called."""
        from numba import njit

        return njit(error_model="numpy", nogil=nogil, cache=True)(function)

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Arrays], load: Any) -> Any:
        """Solve."""
        return make()

    def building(self) -> bool:
        """Return False: nothing is stored."""
        return False


_HOST: list[Host] = [Alone()]


def use(host: Host) -> None:
    """Let a host compile and keep from now on; functions that are compiled already stay as they are."""
    _HOST[0] = host


def kernel(function: Function) -> Function:
    """Compile a function when it is first called; division by zero gives what IEEE says."""
    made: Function = _HOST[0].compiled(function, False)
    return made


def nogil_kernel(function: Function) -> Function:
    """Do what ``kernel`` does, for a function that lets other threads run beside it."""
    made: Function = _HOST[0].compiled(function, True)
    return made


def kept(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
    """Return the result of a solve, or what a host has kept of it.

    Parameters
    ----------
    content
        What determines the result besides the code of this package; its ``repr`` must say all of it.
    make
        The solve.
    pack, load
        Turn the result into float64 arrays, and arrays back into the result.
    """
    found: T = _HOST[0].kept(content, make, pack, load)
    return found


def building() -> bool:
    """Tell whether caches of what is made from kept arrays must not be used now."""
    return _HOST[0].building()
