"""How the contact kernels are compiled: entries with a signature, inner functions, inlined ones."""

from collections.abc import Callable
from typing import TypeVar

from numba.extending import register_jitable

from itouch.compiling import inlined, kernel

__all__ = ["entry", "inlined", "inner", "making"]

Function = TypeVar("Function", bound=Callable[..., object])


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls; kept on disk together with all that it calls."""
    return kernel(function)


def inner(function: Function) -> Function:
    """Let kernels call a function, compiled without wrappers for Python; Python runs it as it is written.

    It takes part in no counting of references (see ``borrow``), so it may not make arrays.
    """
    marked: Function = register_jitable(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=False
    )(function)
    return marked


def making(function: Function) -> Function:
    """Like ``inner``, for a function that makes arrays of its own."""
    marked: Function = register_jitable(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    return marked
