"""How the contact kernels are compiled: entries that Python calls, inner functions, inlined ones."""

from collections.abc import Callable
from typing import TypeVar

from numba.extending import register_jitable

from itouch.compiling import ALONE, inlined, kernel

__all__ = ["entry", "inlined", "inner", "making"]

Function = TypeVar("Function", bound=Callable[..., object])


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls; it is cached on disk together with all that it calls."""
    return kernel(function)


def inner(function: Function) -> Function:
    """Let kernels call a function, compiled without wrappers for Python; from Python, it runs as plain Python.

    It is compiled without reference counting (see ``borrowed``), so it must not create arrays.
    """
    options = {**ALONE, "_nrt": False}
    marked: Function = register_jitable(**options, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    return marked


def making(function: Function) -> Function:
    """Like ``inner``, for a function that creates arrays."""
    marked: Function = register_jitable(**ALONE, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    return marked
