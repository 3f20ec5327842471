"""How the contact kernels are compiled: entries that Python calls, inner functions, inlined ones."""

from collections.abc import Callable
from typing import TypeVar

from itouch.compiling import inlined, kernel, linked

__all__ = ["entry", "inlined", "inner", "making"]

Function = TypeVar("Function", bound=Callable[..., object])


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls; it is cached on disk together with all that it calls."""
    return kernel(function)


def inner(function: Function) -> Function:
    """Let kernels call a function, compiled without wrappers for Python; from Python, it runs as plain Python.

    It is compiled without reference counting (see ``borrowed``), so it must not create arrays.
    """
    return linked(function, _nrt=False)


def making(function: Function) -> Function:
    """Like ``inner``, for a function that creates arrays."""
    return linked(function)
