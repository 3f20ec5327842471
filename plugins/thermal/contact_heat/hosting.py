"""Hooks for the program that uses this package: where to keep compiled functions and results of solves.

By itself the package compiles with Numba, which caches by its own rules, and solves each basis anew.  A program with
stores of its own registers them once, with ``use``, before it imports anything else of the package.
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
    """The services of a host program."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Return a function compiled by Numba with IEEE division; ``nogil`` lets other threads run meanwhile."""

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Arrays], load: Any) -> Any:
        """Return the result for a content, from a store or from ``make``."""

    def building(self) -> bool:
        """Tell whether caches of objects built from stored arrays must not be used now."""


class NoHost:
    """No host: Numba's own cache, and no other store."""

    def compiled(self, function: Any, nogil: bool) -> Any:
        """Return the function, to be compiled when it is first called."""
        from numba import njit

        return njit(error_model="numpy", nogil=nogil, cache=True)(function)

    def kept(self, content: object, make: Callable[[], Any], pack: Callable[[Any], Arrays], load: Any) -> Any:
        """Solve anew."""
        return make()

    def building(self) -> bool:
        """Return False: there is no store."""
        return False


_HOST: list[Host] = [NoHost()]


def use(host: Host) -> None:
    """Let a host compile and store from now on; functions that are already compiled stay as they are."""
    _HOST[0] = host


def kernel(function: Function) -> Function:
    """Compile a function when it is first called; division by zero follows IEEE 754."""
    made: Function = _HOST[0].compiled(function, False)
    return made


def nogil_kernel(function: Function) -> Function:
    """Compile as ``kernel`` does, but so that other threads can run meanwhile."""
    made: Function = _HOST[0].compiled(function, True)
    return made


def kept(content: object, make: Callable[[], T], pack: Callable[[T], Arrays], load: Callable[[Arrays], T]) -> T:
    """Return the result of a solve, or the stored one if a host has it.

    Parameters
    ----------
    content
        Everything that determines the result besides the code of this package; its ``repr`` must contain it all.
    make
        The solve.
    pack, load
        Turn the result into float64 arrays, and arrays back into the result.
    """
    found: T = _HOST[0].kept(content, make, pack, load)
    return found


def building() -> bool:
    """Tell whether caches of objects built from stored arrays must not be used now."""
    return _HOST[0].building()
