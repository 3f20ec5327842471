"""Ways on which Numba takes longer to start or to compile than it has to, made shorter; its results stay the same."""

# ruff: noqa: SLF001  - what is shortened is within Numba

from __future__ import annotations

import importlib.util
import sys
from typing import Any

from numba.core import targetconfig
from numba.np import linalg

_linalg: Any = linalg


def take() -> None:
    """Take these ways in this process, from now on."""
    _compare_quickly(targetconfig.TargetConfig)
    _look_for_blas_when_it_is_used()


def _compare_quickly(options: Any) -> None:
    """Let options of compilations be compared by what is set in them: all others have their defaults in both.

    Numba compares them for each overload of each call that it types; looking at all of them, defaults included, took a
    twelfth of a first start.  Its hash is that of their names, and so the same for all.
    """
    by_all = options.__eq__

    def equal(self: Any, other: Any) -> Any:
        if type(self) is not type(other):
            return by_all(self, other)
        one, two = self._values, other._values
        return one == two or all(getattr(self, name) == getattr(other, name) for name in one.keys() | two.keys())

    def digest(self: Any) -> int:
        return len(self.options)

    options.__eq__, options.__hash__ = equal, digest


def _look_for_blas_when_it_is_used() -> None:
    """Import SciPy's linear algebra when a function that is compiled multiplies matrices, not at each start.

    Where SciPy is installed, Numba imports it with its arithmetic of arrays, to know whether there is a BLAS: a tenth
    of a start.  It looks again for each function that needs it, and compiled code imports what it calls by itself.
    """
    if "numba.np.arraymath" in sys.modules or importlib.util.find_spec("scipy") is None:
        return
    look = _linalg.ensure_blas
    _linalg.ensure_blas = _found
    try:
        import numba.np.arraymath  # noqa: F401  - it asks while it is imported
    finally:
        _linalg.ensure_blas = look
    sys.modules["numba.np.arraymath"].ensure_blas = look  # type: ignore[attr-defined]


def _found() -> None:
    """Stand for a BLAS that was found."""
