"""Compiled functions whose copies on disk are never older than what they were compiled from.

Numba keeps compiled functions on disk and compiles one anew when its own file has changed.  What it calls in other
files, and the constants that it takes from there, are compiled into it, but nobody looks whether they have changed:
after an upgrade in place old code could go on running.  Here the key of what is kept has a fingerprint of all that a
function is made of, so that what fits no more is not found, and is compiled again.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from functools import lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numba.core.caching import FunctionCache

Function = TypeVar("Function", bound=Callable[..., object])

#: Packages whose functions are told by their names: Numba looks after its own version.
_OUTSIDE = frozenset(("builtins", "llvmlite", "math", "numba", "numpy"))


def kernel(function: Function) -> Function:
    """Compile a function when it is first called, and keep it on disk; division by zero gives what IEEE says.

    Where nothing can be kept (neither the package's folder nor the user's can be written), every process compiles.
    """
    return _kept(function, njit(error_model="numpy")(function))


def nogil_kernel(function: Function) -> Function:
    """Do what ``kernel`` does, for a function that lets other threads run beside it."""
    return _kept(function, njit(error_model="numpy", nogil=True)(function))


def _kept(function: Function, found: Any) -> Function:
    if hasattr(found, "enable_caching"):  # else compiling is switched off
        with contextlib.suppress(RuntimeError):  # there is no place to keep anything
            store: Any = KernelCache
            found._cache = store(function)  # noqa: SLF001
    return cast(Function, found)


class KernelCache(FunctionCache):
    """Numba's store for one function, with the fingerprint of what it is made of in its keys."""

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        of_numba: Any = super()._index_key
        return (*of_numba(sig, codegen), fingerprint(self._py_func))


@lru_cache(maxsize=1024)
def fingerprint(function: Any) -> str:
    """Return a digest of a function's code, of all that it calls, and of the constants that they take from outside."""
    found = hashlib.sha256(np.__version__.encode())
    seen: set[int] = set()
    waiting: list[Any] = [function]
    while waiting:
        value = waiting.pop()
        for part in _parts(value):
            if isinstance(part, bytes):
                found.update(part)
            elif id(part) not in seen:
                seen.add(id(part))
                waiting.append(part)
    return found.hexdigest()


def _parts(value: Any) -> Iterator[Any]:
    """Yield the bytes that tell what a value is, and the functions that it stands for or uses."""
    inner = getattr(value, "py_func", None) or getattr(value, "_defn", None)
    if inner is not None:  # a compiled function, or an intrinsic one
        yield repr(sorted(getattr(value, "targetoptions", {}).items(), key=str)).encode()
        yield inner
    elif isinstance(value, FunctionType):
        yield f"{value.__module__}.{value.__qualname__}{value.__defaults__}".encode()
        if value.__module__.partition(".")[0] not in _OUTSIDE:
            yield from _used(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode() + value.tobytes()
    elif isinstance(value, tuple):
        for item in value:
            yield from _held(item)
    elif isinstance(value, (int, float, complex, str, bytes, np.generic, type(None))):
        yield f"{type(value).__name__} {value!r}".encode()
    else:
        kind = value if isinstance(value, type) else type(value)
        yield f"{kind.__module__}.{kind.__qualname__} {getattr(kind, '_fields', '')}".encode()


def _used(function: FunctionType) -> Iterator[Any]:
    """Yield the code of a function, and what its names stand for in its module and in the modules that it names."""
    names: set[str] = set()
    yield from _code(function.__code__, names)
    for cell in function.__closure__ or ():
        yield from _held(cell.cell_contents)
    outer = function.__globals__
    modules = [outer[name] for name in sorted(names) if isinstance(outer.get(name), ModuleType)]
    for name in sorted(names):
        if name in outer and not isinstance(outer[name], ModuleType):
            yield name.encode()
            yield from _held(outer[name])
    for module in modules:
        for name in sorted(names):
            if module.__name__.partition(".")[0] not in _OUTSIDE and hasattr(module, name):
                yield f"{module.__name__}.{name}".encode()
                yield from _held(getattr(module, name))


def _held(value: Any) -> Iterator[Any]:
    """Yield a function to be looked at in its turn, or what tells any other value."""
    if isinstance(value, FunctionType) or hasattr(value, "py_func") or hasattr(value, "_defn"):
        yield value
    else:
        yield from _parts(value)


def _code(code: CodeType, names: set[str]) -> Iterator[bytes]:
    """Yield the bytes of some code, and of the code inside it; collect the names that it uses."""
    yield code.co_code
    names.update(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant, names)
        elif isinstance(constant, frozenset):
            yield repr(sorted(constant, key=repr)).encode()
        else:
            yield repr(constant).encode()
