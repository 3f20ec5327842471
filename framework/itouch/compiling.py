"""Compiled functions whose copies on disk are never older than what they were compiled from.

Numba keeps compiled functions on disk and compiles one anew when its own file has changed.  What it calls in other
files, and the constants that it takes from there, are compiled into it, but nobody looks whether they have changed:
after an upgrade in place old code could go on running.  Here the key of what is kept has a fingerprint of all that a
function is made of, so that what fits no more is not found, and is compiled again.  As the fingerprint alone decides,
kernels lie in the user's own folder, for all environments of Python and all copies of the sources; where that can't be
written, or others can write it, they lie where Numba would put them.  What is not found among the kernels that were
kept is looked for among those that came with the program (see ``shipped``).
"""

# ruff: noqa: SLF001  - Numba's stores have no public way in

from __future__ import annotations

import contextlib
import gc
import glob
import hashlib
import math
import os
import sys
import time
import weakref
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeVar, cast

from itouch import caches, platforms, shipped
from itouch.fingerprint import fingerprint

shipped.choose_processor()
shipped.confirm_processor()

import numba  # noqa: E402  - it reads the kind of processor when it is imported
from numba import njit  # noqa: E402
from numba.core import event  # noqa: E402
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator  # noqa: E402
from numba.extending import intrinsic, register_jitable  # noqa: E402

Function = TypeVar("Function", bound=Callable[..., object])
_numba: Any = numba  # what it exports is not typed

#: Names another folder for compiled kernels, or switches the user's off.
SWITCH = "ITOUCH_KERNELS"
#: What lists a function's kernels, and what holds one.
INDEX, DATA = ".nbi", ".nbc"
#: What compiled kernels may take in the user's folder [bytes]: those of this program and its plugins take some 30 MB.
CAPACITY = 512_000_000
#: How long [s] a kernel may be used before that is noted.
_DAY = 86_400.0


#: How often [s] a process that waits for what another compiles looks whether it is there.
_LOOK = 0.02
#: How long [s] it waits at most: one that is stopped, or waits for a disk, keeps its claim.
_LONGEST = 120.0
#: Where the processes that compile for one start say what each is at (``compile_together``); None: this one is alone.
_together: Path | None = None


class _Seldom(event.Listener):
    """Lets garbage be collected seldom while something is compiled: what a compiler makes is nearly all still in use.

    Looking through it again and again is a good part of a first start.  One thread compiles at a time.
    """

    #: After how many new objects, and how many times of that, garbage is looked for.
    SELDOM = (50_000, 20, 100)

    def __init__(self) -> None:
        self._depth = 0
        self._before = gc.get_threshold()

    def on_start(self, event: Any) -> None:
        """Begin to compile a function, perhaps inside another."""
        if self._depth == 0:
            self._before = gc.get_threshold()
            if self._before[0]:  # 0: not at all
                gc.set_threshold(*map(max, self._before, self.SELDOM))
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Put back what was before, though compiling may have failed."""
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._before)


event.register("numba:compile", _Seldom())


def compile_together(place: Path | None) -> None:
    """Compile nothing from here on that another process with the same ``place``, a folder, is compiling: wait for it.

    Nobody waits in a circle: what a kernel calls is compiled before it and calls nothing that waits for it, and a
    process that ends, however it does, gives back what it was at.  None: compile alone again.
    """
    global _together
    _together = place


def kernel(function: Function) -> Function:
    """Compile a function when it is first called, and keep it on disk; division by zero gives what IEEE says.

    Where nothing can be kept (neither the package's folder nor the user's can be written), every process compiles.
    """
    return _kept(function, njit(error_model="numpy")(function))


def nogil_kernel(function: Function) -> Function:
    """Do what ``kernel`` does, for a function that lets other threads run beside it."""
    return _kept(function, njit(error_model="numpy", nogil=True)(function))


def inlined(function: Function) -> Function:
    """Put a small function into the code of the kernels that call it; Python runs it as it is written.

    It is for a step of a derivation that has a name of its own: handing it its arguments would cost more than its work.
    It takes part in no counting of references, so it may not make arrays; it is kept with the kernels that it is in.
    """
    marked: Function = register_jitable(
        error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True, _nrt=False
    )(function)
    return marked


def _fused_exactly(a: float, b: float, c: float) -> float:
    """Return a * b + c, rounded once: what ``fused`` is where compiling is switched off."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    return float(exact) if exact else a * b + c


_intrinsic: Any = intrinsic


@_intrinsic
def _fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    number = _numba.types.float64
    return number(number, number, number), generate


#: a * b + c of three floats, rounded once, for kernels.
fused: Callable[[float, float, float], float] = _fused_exactly if _numba.config.DISABLE_JIT else _fused


def _kept(function: Function, found: Any) -> Function:
    if hasattr(found, "enable_caching"):  # else compiling is switched off
        store: Any = KernelCache
        found._cache = store(function)
    return cast(Function, found)


def _locks(file: int) -> bool:
    """Claim an open file; tell whether that was possible, as no other process has it."""
    try:
        platforms.claim(file)
    except BlockingIOError:
        return False
    return True


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


class _Shared(_CacheLocator):
    """The user's folder: what a function is, not where it lies or when it was written, decides what is found."""

    def ensure_cache_path(self) -> None:
        """Make nothing: it is made with its first entry."""

    def get_cache_path(self) -> str:
        return str(folder())

    def get_source_stamp(self) -> str:
        return "by its fingerprint"

    def get_disambiguator(self) -> str:
        return "kept"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Shared | None:
        """Return the place, unless Numba was told another, or it is not this user's alone."""
        return cls() if _is_usable() else None


@cache
def folder() -> Path | None:
    """Return the user's folder for compiled kernels, or None where it is switched off or Numba was told another."""
    return None if os.environ.get("NUMBA_CACHE_DIR") else caches.folder("kernels", SWITCH)


@cache
def _is_usable() -> bool:
    place = folder()
    if place is None:
        return False
    with contextlib.suppress(OSError):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
    return caches.owned(place) and os.access(place, os.W_OK)


class _Impl(CompileResultCacheImpl):
    _locator_classes: list[Any] = [_Shared, *CompileResultCacheImpl._locator_classes, _Nowhere]


class _Store(IndexDataCacheFile):
    """What is kept of one function: a list of kernels by their types, and a file for each, named by what it holds.

    Numba numbers the files, and writes the list first: of two processes that compile at once, and of one that finds
    the list while an older file still lies there, one could take a kernel for another.
    """

    def __init__(self, place: str, base: str, stamp: str) -> None:
        of_numba: Any = super().__init__
        of_numba(place, base, stamp)
        self._base = base

    def save(self, key: Any, data: Any) -> None:
        """Write a kernel, then the list; what another process has added to it meanwhile may be compiled once more."""
        of_numba: Any = self
        name = f"{self._base}.{hashlib.sha256(of_numba._dump(key)).hexdigest()[:16]}{DATA}"
        of_numba._save_data(name, data)
        known = of_numba._load_index()
        if not known:  # there was none, or it was of other sources
            for path in Path(of_numba._cache_path).glob(f"{glob.escape(self._base)}.*{DATA}"):
                if path.name != name:
                    path.unlink(missing_ok=True)
        if known.get(key) != name:
            of_numba._save_index({**known, key: name})


class _SharedStore(_Store):
    """The same in the user's folder: bounded, and what was not used for longest goes first."""

    def _save_data(self, name: str, data: Any) -> None:
        of_numba: Any = self
        self._put(name, [of_numba._dump(data)])

    def _save_index(self, overloads: Any) -> None:
        of_numba: Any = self
        parts = (self._version, (self._source_stamp, overloads))  # as Numba reads them
        self._put(self._index_name, [of_numba._dump(part) for part in parts])

    def _put(self, name: str, blocks: list[bytes]) -> None:
        caches.put(Path(self._cache_path), name, blocks, size=sum(map(len, blocks)), capacity=CAPACITY)

    def _load_data(self, name: str) -> Any:
        of_numba: Any = super()._load_data
        found = of_numba(name)
        with contextlib.suppress(OSError):  # used: it stays
            path = os.path.join(self._cache_path, name)
            if os.stat(path).st_mtime < time.time() - _DAY:
                os.utime(path)
                os.utime(self._index_path)
        return found


class KernelCache(FunctionCache):
    """Numba's store for one function, with the fingerprint of what it is made of in its keys."""

    _impl_class = _Impl
    #: How many kernels this process did not find, and compiles.
    missed = 0
    _prepared: ClassVar[weakref.WeakSet[Any]] = weakref.WeakSet()

    def __init__(self, py_func: Any) -> None:
        of_numba: Any = super().__init__
        of_numba(py_func)
        making = os.environ.get(shipped.MAKING)
        place = os.path.join(making or shipped.FOLDER, py_func.__module__)
        self._base = (
            f"{py_func.__qualname__.replace('<', '').replace('>', '')}.py{sys.version_info[0]}{sys.version_info[1]}"
        )
        self._shipped = IndexDataCacheFile(place, f"{self._base}-{py_func.__code__.co_firstlineno}", "shipped")
        self._making = making is not None
        self._store: _Store | None = None
        #: What this process compiles while others compile with it: open files, which are locked.
        self._claims: dict[str, int] = {}

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept of a function for these types, or None.

        Numba brings the compiler's lists up to date at each look, which takes more than what is found.  Code that was
        compiled needs them to be there; whoever compiles brings them up to date.
        """
        if target_context not in KernelCache._prepared:
            KernelCache._prepared.add(target_context)
            of_numba: Any = super().load_overload
            return of_numba(sig, target_context)
        found, guard = None, cast(Any, self._guard_against_spurious_io_errors)
        with guard():  # Numba passes over some errors of the disk
            found = self._load_overload(sig, target_context)
        return found  # noqa: RET504  - None where an error was passed over

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        of_numba: Any = super()._index_key
        return (*of_numba(sig, codegen), fingerprint(self._py_func))

    def _kept(self) -> _Store:
        """Return the store; found when it is first used, as all that a function names is there by then."""
        if self._store is None:
            path, stamp = self._cache_path, self._impl.locator.get_source_stamp()
            if isinstance(self._impl.locator, _Shared):
                base = f"{self._py_func.__module__}.{self._base}-{fingerprint(self._py_func)[:16]}"
                self._store = _SharedStore(path, base, stamp)
            else:
                self._store = _Store(path, self._impl.filename_base, stamp)
            self._cache_file = self._store
        return self._store

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        of_numba: Any = super()._load_overload
        self._kept()
        try:
            found = of_numba(sig, target_context)
        except Exception:  # damaged, or of types that another version of the program had: pickle raises anything
            self._forget()
            found = None
        if found is None and self._enabled and not self._making and shipped.fits():
            found = self._load_shipped(sig, target_context)
        if found is None and _together is not None:
            found = self._claim(_together, sig, target_context)
        if found is None:
            KernelCache.missed += 1
        return found

    def _claim(self, place: Path, sig: Any, target_context: Any) -> Any:
        """Return what another process has compiled by the time that nobody is at it, or None: then it is this one's."""
        said = f"{self._py_func.__module__} {self._base} {fingerprint(self._py_func)} {sig}"
        try:
            claim = os.open(
                place / hashlib.sha256(said.encode()).hexdigest(), os.O_RDWR | os.O_CREAT | platforms.OPEN_FLAGS, 0o600
            )
        except OSError:  # the start that this was for is over
            return None
        limit = time.monotonic() + _LONGEST
        while not _locks(claim):
            if time.monotonic() > limit:
                os.close(claim)
                return None
            time.sleep(_LOOK)
        of_numba: Any = super()._load_overload
        with contextlib.suppress(Exception):  # as above
            if (found := of_numba(sig, target_context)) is not None:
                os.close(claim)
                return found
        self._claims[str(sig)] = claim
        return None

    def _forget(self) -> None:
        """Take away the list of what is kept for the function: it is written anew with the next kernel."""
        with contextlib.suppress(OSError):
            os.unlink(self._kept()._index_path)

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
            self._kept()
            with contextlib.suppress(Exception):  # what is kept cannot be read, nor taken away: it is not kept then
                of_numba(sig, data)
        if self._making and self._impl.check_cachable(data):
            os.makedirs(self._shipped._cache_path, exist_ok=True)
            self._shipped.save(self._index_key(sig, data.codegen), self._impl.reduce(data))
        if (claim := self._claims.pop(str(sig), None)) is not None:
            os.close(claim)
