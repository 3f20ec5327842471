"""Compiled functions whose copies on disk are never older than what they were compiled from.

Numba caches compiled functions on disk and compiles one again when the file that defines it has changed.  Functions
that it calls in other files, and constants that it takes from there, are compiled into it, but Numba does not check
whether they have changed: after an upgrade in place, old code could go on running.  Here each cache key includes a
fingerprint of all that a function is made of, so that outdated code is not found, and is compiled again.  As the
fingerprint alone decides, kernels are cached in the user's own folder, for all Python environments and all copies of
the sources; where that folder cannot be written, or others can write to it, they are cached where Numba would put
them.  Kernels that are not in the cache are looked for among those that were shipped with the program (``shipped``).
"""

# ruff: noqa: SLF001  - Numba's stores have no public way in

from __future__ import annotations

import contextlib
import glob
import hashlib
import math
import os
import re
import sys
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import cache, partial
from inspect import CO_VARARGS
from pathlib import Path
from typing import Any, ClassVar, TypeVar, cast

from itouch import caches, gc_policy, platforms, shipped
from itouch.fingerprint import fingerprint, made_of

shipped.choose_processor()
shipped.confirm_processor()

import numba  # noqa: E402  - it reads the kind of processor when it is imported
import numpy as np  # noqa: E402
from numba import njit  # noqa: E402
from numba.core import cgutils, event  # noqa: E402
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator  # noqa: E402
from numba.extending import intrinsic, register_jitable  # noqa: E402
from numba.np.arrayobj import populate_array  # noqa: E402

from itouch import numba_shortcuts  # noqa: E402
from itouch.linking import Linked  # noqa: E402
from itouch.reference_counting import Borrowing, know  # noqa: E402

Function = TypeVar("Function", bound=Callable[..., object])
_numba: Any = numba  # what it exports is not typed

#: Environment variable that names another folder for compiled kernels, or switches the user's folder off.
SWITCH = "ITOUCH_KERNELS"
#: Suffixes of the file that lists a function's kernels, and of the file of one kernel.
INDEX, DATA = ".nbi", ".nbc"
#: What compiled kernels may take in the user's folder [bytes]: those of this program and its plugins take some 30 MB.
CAPACITY = 512_000_000
#: A kernel's time of last use is updated when it is older than this [s].
_DAY = 86_400.0


#: How kernels are compiled (``borrowing``), for their keys: an older program makes other code of the same source.
_MANNER = "borrowing"
#: Settings of Numba (environment variables) that change what is compiled: what one has made serves no other.
_SETTINGS = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "USING_SVML")
#: How often [s] a process that waits for another one to compile a kernel checks whether it is done.
_LOOK = 0.02
#: How long [s] it waits at most, once: a process that is suspended, or waits for a disk, keeps all of its claims.
_LONGEST = 120.0
#: Whether it still waits.
_patient = True
#: Folder where processes that compile for the same start claim kernels (``compile_together``); None: compile alone.
_together: Path | None = None
#: The file in that folder with the names of the kernels that the start needs, a line each.
_NEEDED = "needed"
#: The kernels whose claims in that folder have been read, by the names of the files.
_claimed: dict[str, str] = {}


class _UnderWay(event.Listener):
    """Knows what is being compiled; the garbage collector runs rarely meanwhile.  One thread compiles at a time."""

    def __init__(self) -> None:
        #: The functions that are being compiled now, the one that all others are for first.
        self.functions: list[str] = []

    def on_start(self, event: Any) -> None:
        """Note what begins; compilations may be nested."""
        self.functions.append(_called(event.data["dispatcher"].py_func))
        gc_policy.begin_rare_collections()

    def on_end(self, event: Any) -> None:
        """Forget it, also when compiling has failed: then nobody is to wait for it, this process either."""
        gc_policy.end_rare_collections()
        self.functions.pop()
        failed = event._exc_details is not None  # what Numba calls ``is_failed`` is the contrary
        if failed and isinstance(found := getattr(event.data["dispatcher"], "_cache", None), KernelCache):
            found.release()


_under_way = _UnderWay()
event.register("numba:compile", _under_way)

numba_shortcuts.take()


def compile_together(place: Path | None) -> None:
    """From now on, wait for a kernel that another process with the same folder ``place`` is already compiling.

    There is no deadlock: the functions that a kernel calls are compiled before it and never wait for it, and a process
    that ends, in whatever way, releases its claims.  None: compile alone again.
    """
    global _together, _patient
    _together, _patient = place, True
    _claimed.clear()


def tell_needed(entries: Iterable[Any]) -> None:
    """Tell the processes that compile for the same start which kernels it needs: entries, and all that they call."""
    if _together is None:
        return
    every = [part for entry in entries for part in made_of(entry)]
    names = {_called(part.py_func) for part in every if isinstance(getattr(part, "_cache", None), KernelCache)}
    part = _together / f"{_NEEDED}.{os.getpid()}"
    with contextlib.suppress(OSError):  # the folder is gone: that start is over
        part.write_text("\n".join(sorted(names)), encoding="utf-8")
        part.replace(_together / _NEEDED)


def progress() -> tuple[int, int | None, str]:
    """Return how many kernels a start has compiled so far, how many it needs, and what this process is at.

    None: it is not known yet how many are needed.
    """
    under_way = list(_under_way.functions)
    done, needed = set(KernelCache.begun), set[str]()
    if (place := _together) is not None:
        with contextlib.suppress(OSError):
            for file in place.iterdir():
                if file.name not in _claimed and (text := file.read_text(encoding="utf-8")):
                    _claimed[file.name] = text
        needed = set(_claimed.get(_NEEDED, "").split("\n")) - {""}
        done |= {text for name, text in _claimed.items() if not name.startswith(_NEEDED)}
    now = re.sub(r"_[0-9a-f]{12}$", "", under_way[0].rpartition(".")[2]) if under_way else ""  # of an entry
    return len(done - set(under_way)), len(needed | done) if needed else None, now


#: How a kernel is compiled.  What is left open, Numba takes over from the function for which a kernel is compiled:
#: no arrays of its own within ``inlined``, or the looser arithmetic that a plugin's author allows his own function.
ALONE: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "forceinline": False, "_nrt": True}


def kernel(function: Function) -> Function:
    """Compile a function when it is first called, and cache it on disk; division by zero follows IEEE 754.

    Where nothing can be cached (neither the package's folder nor the user's can be written), every process compiles.
    """
    return _kept(function, _numba.njit(**ALONE, no_cfunc_wrapper=True, pipeline_class=Borrowing)(function))


def nogil_kernel(function: Function) -> Function:
    """Do what ``kernel`` does, for a function that releases the GIL while it runs."""
    return _kept(function, _numba.njit(**ALONE, nogil=True, no_cfunc_wrapper=True, pipeline_class=Borrowing)(function))


def addressed_kernel(function: Function) -> Function:
    """Do what ``kernel`` does, for a function that only compiled code calls, by its address: Python must not call it.

    Unboxing arguments from Python, which is left out, would be a good part of a small function's compilation.
    """
    options = {**ALONE, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return _kept(function, _numba.njit(**options, pipeline_class=Borrowing)(function))


def part_of_its_caller(function: Function) -> Function:
    """Compile a kernel as part of each kernel that calls it, as if it stood there, and never by itself.

    It is for what has one caller: everything that the function calls would else be optimized twice over.  A function
    that was compiled in another way, as a plugin may have done, is left as it is, and so is one with ``*arguments``,
    which Numba cannot inline.
    """
    found: Any = function
    if not isinstance(getattr(found, "_cache", None), KernelCache) or found.py_func.__code__.co_flags & CO_VARARGS:
        return function
    return cast(Function, njit(error_model="numpy", inline="always")(found.py_func))


def inlined(function: Function) -> Function:
    """Inline a small function into the kernels that call it; from Python, it runs as plain Python.

    It is for a named step of a derivation, where passing the arguments would cost more than the step itself.  It is
    compiled without reference counting, so it must not create arrays; it is cached as part of the kernels that call it.
    """
    return linked(function, forceinline=True, _nrt=False)


def linked(function: Function, **options: bool) -> Function:
    """Let kernels call a function, which is compiled as part of them alone; from Python, it runs as plain Python."""
    options = {**ALONE, **options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    marked: Function = register_jitable(**options, pipeline_class=Linked)(function)
    know(function)
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


@_intrinsic(prefer_literal=True)
def _scratch(typing: Any, size: Any) -> Any:
    """Return an array of so many float64, a constant, in the memory of the caller."""
    kind = _numba.types.Array(_numba.types.float64, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        count, place = size.literal_value, context.get_data_type(_numba.types.float64)
        memory = cgutils.alloca_once(builder, place, size=count)
        array, word = context.make_array(kind)(context, builder), partial(context.get_constant, _numba.types.intp)
        populate_array(
            array, data=memory, shape=[word(count)], strides=[word(8)],
            itemsize=word(8), meminfo=None,
        )  # fmt: skip
        return array._getvalue()

    return (kind(size), generate) if isinstance(size, _numba.types.IntegerLiteral) else None


#: An array of a constant number of floats, not initialized, for a kernel to work in, and not to return: asking for
#: memory, each time, costs as much as a short kernel.
scratch: Callable[[int], Any] = np.empty if _numba.config.DISABLE_JIT else _scratch
know(scratch, unowned=True)


def _parts_of(kinds: Any) -> Iterator[tuple[str, ...]]:
    """Yield the names of the parts of each named tuple among the types: Numba tells them apart by their class alone."""
    for kind in kinds:
        if isinstance(kind, _numba.types.BaseTuple):
            yield from ((kind.fields,) if hasattr(kind, "fields") else ())
            yield from _parts_of(kind)


def _called(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _kept(function: Function, found: Any) -> Function:
    if hasattr(found, "enable_caching"):  # else compiling is switched off
        store: Any = KernelCache
        found._cache = store(function)
    return cast(Function, found)


def _locks(file: int) -> bool:
    """Try to claim an open file; tell whether it worked, that is, whether no other process holds it."""
    try:
        platforms.claim(file)
    except BlockingIOError:
        return False
    return True


class _NoCache(_CacheLocator):
    """The locator of last resort: nothing is cached, as neither the program's folder nor the user's can be written."""

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
    def from_function(cls, py_func: Any, py_file: str) -> _NoCache:
        """Return the locator of a function; it never declines."""
        return cls(py_func.__code__.co_firstlineno)


class _Shared(_CacheLocator):
    """The user's folder: a kernel is found by what the function is, not by the place or date of its source."""

    def ensure_cache_path(self) -> None:
        """Make nothing: the folder is made with its first entry."""

    def get_cache_path(self) -> str:
        return str(folder())

    def get_source_stamp(self) -> str:
        return "by its fingerprint"

    def get_disambiguator(self) -> str:
        return "kept"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Shared | None:
        """Return the locator, or None if Numba was given another folder, or others can write to the user's."""
        return cls() if _is_usable() else None


@cache
def folder() -> Path | None:
    """Return the user's folder for compiled kernels; None if it is switched off or Numba was given another folder."""
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
    _locator_classes: list[Any] = [_Shared, *CompileResultCacheImpl._locator_classes, _NoCache]


class _Store(IndexDataCacheFile):
    """The cache of one function: a list of its kernels by their types, and a file for each, named by its key's digest.

    Numba numbers the files and writes the list first.  Then one kernel could be taken for another: when two processes
    compile at once, or when a process finds the new list while an older file still has that number.
    """

    def __init__(self, place: str, base: str, stamp: str) -> None:
        of_numba: Any = super().__init__
        of_numba(place, base, stamp)
        self._base = base

    def save(self, key: Any, data: Any) -> None:
        """Write a kernel, then the list; an entry that another process adds meanwhile may be lost, and recompiled."""
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
    """The same in the user's folder: its size is bounded, and the least recently used kernels are removed first."""

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
        with contextlib.suppress(OSError):  # mark it as used, so that it stays
            path = os.path.join(self._cache_path, name)
            if os.stat(path).st_mtime < time.time() - _DAY:
                os.utime(path)
                os.utime(self._index_path)
        return found


class KernelCache(FunctionCache):
    """Numba's cache of one function, with the fingerprint of all that the function is made of in its keys."""

    _impl_class = _Impl
    #: How many kernels this process did not find, and so compiles.
    missed = 0
    #: The names of these.
    begun: ClassVar[set[str]] = set()
    _prepared: ClassVar[weakref.WeakSet[Any]] = weakref.WeakSet()

    def __init__(self, py_func: Any) -> None:
        of_numba: Any = super().__init__
        of_numba(py_func)
        making = os.environ.get(shipped.MAKING)
        place = os.path.join(making or shipped.FOLDER, py_func.__module__)
        python = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
        self._base = f"{py_func.__qualname__.replace('<', '').replace('>', '')}.{python}"
        self._shipped = IndexDataCacheFile(place, f"{self._base}-{py_func.__code__.co_firstlineno}", "shipped")
        self._making = making is not None
        self._store: _Store | None = None
        #: The locked files by which this process claims what it is compiling, by signature (``compile_together``).
        self._claims: dict[str, int] = {}

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached kernel of the function for these types, or None.

        Numba refreshes the compiler's registries at each look-up, which takes longer than loading the kernel.  Loaded
        code needs them to have been filled once; when something is compiled, they are refreshed anyway.
        """
        if target_context not in KernelCache._prepared:
            KernelCache._prepared.add(target_context)
            of_numba: Any = super().load_overload
            return of_numba(sig, target_context)
        found, guard = None, cast(Any, self._guard_against_spurious_io_errors)
        with guard():  # Numba ignores some errors of the disk
            found = self._load_overload(sig, target_context)
        return found  # noqa: RET504  - None if an error was ignored

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        of_numba: Any = super()._index_key
        settings = tuple(repr(getattr(_numba.config, name, None)) for name in _SETTINGS)
        parts = _parts_of(getattr(sig, "args", sig))
        return (*of_numba(sig, codegen), fingerprint(self._py_func), _MANNER, settings, *parts)

    def _kept(self) -> _Store:
        """Return the store, made at its first use: only then does all that the function names exist."""
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
        except Exception:  # damaged, or of types from another version of the program: pickle may raise anything
            self._forget()
            found = None
        if found is not None and self._making:
            self._ship(self._index_key(sig, target_context.codegen()), self._kept().load)
        if found is None and self._enabled and not self._making and shipped.fits():
            found = self._load_shipped(sig, target_context)
        if found is None and _together is not None:
            found = self._claim(_together, sig, target_context)
        if found is None:
            KernelCache.missed += 1
            KernelCache.begun.add(_called(self._py_func))
        return found

    def _claim(self, place: Path, sig: Any, target_context: Any) -> Any:
        """Wait while another process compiles this kernel, and return it; None: this process compiles it."""
        said = f"{self._py_func.__module__} {self._base} {fingerprint(self._py_func)} {sig}"
        try:
            claim = os.open(
                place / hashlib.sha256(said.encode()).hexdigest(), os.O_RDWR | os.O_CREAT | platforms.OPEN_FLAGS, 0o600
            )
        except OSError:  # the folder is gone: that start is over
            return None
        global _patient
        limit = time.monotonic() + _LONGEST
        while not _locks(claim):
            if not _patient or time.monotonic() > limit:
                _patient = False
                os.close(claim)
                return None
            time.sleep(_LOOK)
        of_numba: Any = super()._load_overload
        with contextlib.suppress(Exception):  # as above
            if (found := of_numba(sig, target_context)) is not None:
                os.close(claim)
                return found
        self._claims[str(sig)] = claim
        os.write(claim, _called(self._py_func).encode())  # for who shows how far it is
        return None

    def release(self) -> None:
        """Release the claims of what this process could not compile."""
        while self._claims:
            os.close(self._claims.popitem()[1])

    def _forget(self) -> None:
        """Remove the list of the function's cached kernels; it is written anew with the next kernel."""
        with contextlib.suppress(OSError):
            os.unlink(self._kept()._index_path)

    def _load_shipped(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel shipped with the program; None unless its files are unchanged since then."""
        store = self._shipped
        if not shipped.sound(Path(store._index_path)):
            return None
        key = self._index_key(sig, target_context.codegen())
        name = store._load_index().get(key)
        if name is None or not shipped.sound(Path(store._data_path(name))):
            return None
        return self._impl.rebuild(target_context, store.load(key))

    def _ship(self, key: Any, stored: Callable[[Any], Any]) -> None:
        """Write a kernel for shipping; ``stored`` gives what the cache stores of it by its key."""
        os.makedirs(self._shipped._cache_path, exist_ok=True)
        self._shipped.save(key, stored(key))

    def _save_overload(self, sig: Any, data: Any) -> None:
        if not isinstance(self._impl.locator, _NoCache):
            of_numba: Any = super()._save_overload
            self._kept()
            with contextlib.suppress(Exception):  # the old cache can be neither read nor removed: go on without it
                of_numba(sig, data)
        if self._making and self._impl.check_cachable(data):
            self._ship(self._index_key(sig, data.codegen), lambda _: self._impl.reduce(data))
        if (claim := self._claims.pop(str(sig), None)) is not None:
            os.close(claim)
