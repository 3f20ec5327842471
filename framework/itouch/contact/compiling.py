"""How the kernels are compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., object])


def entry(function: Function) -> Function:
    """Compile a kernel that Python calls; kept on disk together with all that it calls."""
    compiled: Any = njit(cache=True, error_model="numpy")(function)
    return cast(Function, compiled)


def inner(function: Function) -> Function:
    """Let kernels call a function, compiled without wrappers for Python; Python runs it as it is written."""
    marked: Function = register_jitable(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    return marked
