"""Compiled functions whose copies on disk are never older than what they were compiled from.

Numba keeps compiled functions on disk and compiles one anew when its own file has changed.  What it calls in other
files, and the constants that it takes from there, are compiled into it, but nobody looks whether they have changed:
after an upgrade in place old code could go on running.  Here the key of what is kept has a fingerprint of all that a
function is made of, so that what fits no more is not found, and is compiled again.  What is not found among the
kernels that were kept is looked for among those that came with the program (see ``shipped``).
"""

# ruff: noqa: SLF001  - Numba's stores have no public way in

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np

from itouch import shipped

shipped.choose_processor()

from numba import njit  # noqa: E402  - it reads the kind of processor when it is imported
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator  # noqa: E402

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
        store: Any = KernelCache
        found._cache = store(function)
    return cast(Function, found)


class _Nowhere(_CacheLocator):
    """A place to keep nothing, for a program whose folder and whose user's folder can't be written."""

    def __init__(self, line: int) -> None:
        self._line = line

    def ensure_cache_path(self) -> None:
        """Make nothing."""

    def get_cache_path(self) -> str:
        return os.path.join(os.sep, "nonexistent", "itouch")

    def get_source_stamp(self) -> str:
        return "none"

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Nowhere:
        """Return the place for a function: there always is one."""
        return cls(py_func.__code__.co_firstlineno)


class _Impl(CompileResultCacheImpl):
    _locator_classes: list[Any] = [*CompileResultCacheImpl._locator_classes, _Nowhere]


class KernelCache(FunctionCache):
    """Numba's store for one function, with the fingerprint of what it is made of in its keys."""

    _impl_class = _Impl
    #: How many kernels this process did not find, and compiles.
    missed = 0

    def __init__(self, py_func: Any) -> None:
        of_numba: Any = super().__init__
        of_numba(py_func)
        making = os.environ.get(shipped.MAKING)
        folder = os.path.join(making or shipped.FOLDER, py_func.__module__)
        self._shipped = IndexDataCacheFile(folder, self._impl.filename_base, "shipped")
        self._making = making is not None

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        of_numba: Any = super()._index_key
        return (*of_numba(sig, codegen), fingerprint(self._py_func))

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        of_numba: Any = super()._load_overload
        try:
            found = of_numba(sig, target_context)
        except Exception:  # damaged, or of types that another version of the program had: pickle raises anything
            self._forget()
            found = None
        if found is None and self._enabled and not self._making and shipped.fits():
            found = self._load_shipped(sig, target_context)
        if found is None:
            KernelCache.missed += 1
        return found

    def _forget(self) -> None:
        """Take away the list of what is kept for the function: it is written anew with the next kernel."""
        with contextlib.suppress(OSError):
            os.unlink(self._cache_file._index_path)

    def _load_shipped(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel that came with the program; None unless its files are the ones that were shipped."""
        store = self._shipped
        if not shipped.sound(Path(store._index_path)):
            return None
        key = self._index_key(sig, target_context.codegen())
        name = store._load_index().get(key)
        if name is None or not shipped.sound(Path(store._data_path(name))):
            return None
        return self._impl.rebuild(target_context, store.load(key))

    def _save_overload(self, sig: Any, data: Any) -> None:
        if not isinstance(self._impl.locator, _Nowhere):
            of_numba: Any = super()._save_overload
            with contextlib.suppress(Exception):  # what is kept cannot be read, nor taken away: it is not kept then
                of_numba(sig, data)
        if self._making and self._impl.check_cachable(data):
            os.makedirs(self._shipped._cache_path, exist_ok=True)
            self._shipped.save(self._index_key(sig, data.codegen), self._impl.reduce(data))


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
