"""The fingerprint of a compiled function: a digest of its code, of all that it calls, and of the constants they use.

Equal fingerprints mean equal machine code for equal types of arguments on one kind of processor, wherever the files
are and whenever they were written: what was compiled for one Python environment serves another.
"""

# ruff: noqa: SLF001  - what Numba compiles instead of a function has no public name

from __future__ import annotations

import enum
import hashlib
import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

#: Packages whose functions are identified by name alone: Numba checks its own version, and NumPy's is in the digest.
_OUTSIDE = frozenset(("builtins", "llvmlite", "math", "numba", "numpy"))


@lru_cache(maxsize=1024)
def fingerprint(function: Any) -> str:
    """Return a digest of a function's code, of all that it calls, and of the outside constants that they use."""
    found = hashlib.sha256(np.__version__.encode())
    for _, digest in _reached(function):
        found.update(digest)
    return found.hexdigest()


def made_of(function: Any) -> list[Any]:
    """Return a function and all that it calls, each once: functions as they are, and compiled ones."""
    return [part for part, _ in _reached(function)]


def _reached(function: Any) -> Iterator[tuple[Any, bytes]]:
    """Yield a function and all that it calls, each once with its own digest."""
    seen: set[int] = set()
    waiting: list[Any] = [function]
    while waiting:
        part = waiting.pop()
        digest, uses = _own(_Same(part))
        yield part, digest
        for use in uses:
            if id(use) not in seen:
                seen.add(id(use))
                waiting.append(use)


class _Same:
    """A value that is hashed and compared by identity: what a function is made of may not be hashable."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.value is self.value


@lru_cache(maxsize=8192)  # functions share most of what they call
def _own(value: _Same) -> tuple[bytes, tuple[Any, ...]]:
    """Return a digest of a function alone, and the functions that it uses."""
    parts = list(_parts(value.value))
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, bytes):
            digest.update(len(part).to_bytes(8, "little") + part)
    return digest.digest(), tuple(part for part in parts if not isinstance(part, bytes))


def _parts(value: Any) -> Iterator[Any]:
    """Yield the bytes that identify a value, and the functions that it wraps or uses."""
    inner = getattr(value, "py_func", None) or getattr(value, "_defn", None)
    if inner is not None:  # a compiled function or an intrinsic
        yield repr(sorted(getattr(value, "targetoptions", {}).items(), key=str)).encode()
        yield repr(sorted(getattr(value, "locals", {}).items())).encode()
        if not getattr(value, "_can_compile", True):  # for given types alone
            yield repr(getattr(value, "signatures", ())).encode()
        yield inner
    elif isinstance(value, FunctionType):
        yield f"{value.__module__}.{value.__qualname__}{value.__defaults__}{value.__kwdefaults__}".encode()
        if not _is_outside(value.__module__):
            yield from _used(value)
        yield from _stand_ins(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}{value.flags.c_contiguous}{value.flags.f_contiguous}".encode()
        yield value.tobytes()
    elif isinstance(value, tuple):
        yield repr(getattr(value, "_fields", "")).encode()
        for item in value:
            yield from _held(item)
    elif isinstance(value, enum.Enum):
        yield f"{type(value).__module__}.{type(value).__qualname__} {value.name} {value.value!r}".encode()
    elif isinstance(value, (int, float, complex, str, bytes, np.generic, np.dtype, slice, type(None))):
        yield f"{type(value).__name__} {value!r}".encode()
    elif isinstance(value, type) and issubclass(value, enum.Enum):
        yield f"{value.__module__}.{value.__qualname__} {[(each.name, each.value) for each in value]}".encode()
    elif type(value).__module__.startswith("numba.core.types"):
        yield repr(value).encode()
    else:
        kind = value if isinstance(value, type) else type(value)
        yield f"{kind.__module__}.{kind.__qualname__} {getattr(kind, '_fields', '')}".encode()
        if kind is not value and isinstance(name := getattr(value, "__name__", None), str):  # math.sin, np.exp, min
            yield f"{getattr(value, '__module__', '')}.{name}".encode()
        yield from _inside(value)
        yield from _stand_ins(value)


def _inside(value: Any) -> Iterator[Any]:
    """Yield what Numba compiles of a universal function, a stencil or a class: the kinds of things that it makes."""
    if (function := getattr(value, "_dispatcher", None)) is not None:  # vectorize, guvectorize
        built = getattr(value, "gufunc_builder", None)
        yield f"{getattr(value, 'identity', None)} {getattr(built, 'signature', '')}".encode()
        if getattr(value, "_frozen", False):  # for given types alone
            yield repr(value.types).encode()
        yield function
    elif (read := getattr(value, "kernel_ir", None)) is not None:  # stencil
        yield f"{value.mode} {value.neighborhood} {sorted(value.options.items(), key=str)}".encode()
        yield read.func_id.func
    elif (made := getattr(value, "class_type", None)) is not None and hasattr(made, "jit_methods"):  # jitclass
        yield repr(list(made.struct.items())).encode()
        properties = {f"{name} {way}": part for name, ways in made.jit_props.items() for way, part in ways.items()}
        for name, part in sorted({**made.jit_methods, **made.jit_static_methods, **properties}.items()):
            yield name.encode()
            yield part


def _is_outside(module: str | None) -> bool:
    return (module or "numba").partition(".")[0] in _OUTSIDE  # what has no module was made by Numba


@lru_cache(maxsize=1)
def _overloads(count: int) -> dict[int, list[Any]]:
    """Return what stands in for functions in compiled code, by their identities, by the first of Numba's list of it."""
    templates = sys.modules["numba.core.typing.templates"]
    found: dict[int, list[Any]] = {}
    for value, kind in templates.builtin_registry.globals[:count]:
        for template in getattr(kind, "templates", ()):
            if hasattr(template, "_overload_func"):
                found.setdefault(id(value), []).append(template)
    return found


@lru_cache(maxsize=1)
def _attributes(count: int) -> dict[str, list[Any]]:
    """Return what others than Numba compile for a method or an attribute, by its name, by the first of Numba's list."""
    templates = sys.modules["numba.core.typing.templates"]
    found: dict[str, list[Any]] = {}
    for template in templates.builtin_registry.attributes[:count]:
        stand_in = getattr(template, "_overload_func", None)
        if stand_in is not None and not _is_outside(stand_in.__module__):
            found.setdefault(template._attr, []).append(template)
    return found


def _of_attributes(names: Iterable[str]) -> Iterator[Any]:
    """Yield what may be compiled for attributes of these names: of which type a value is, only Numba finds out."""
    if (templates := sys.modules.get("numba.core.typing.templates")) is None:
        return
    known = _attributes(len(templates.builtin_registry.attributes))
    for name in sorted(known.keys() & set(names)):
        for template in known[name]:
            yield f"{name} {getattr(template, '_inline', '')}".encode()
            yield template._overload_func


def _stand_ins(function: Any) -> Iterator[Any]:
    """Yield what others than Numba let it compile instead of a function, and how: nothing in the function shows it."""
    if (templates := sys.modules.get("numba.core.typing.templates")) is None:
        return
    for template in _overloads(len(templates.builtin_registry.globals)).get(id(function), ()):
        stand_in, inline = template._overload_func, template._inline.value
        itself = stand_in.__module__ == "numba.core.extending"  # register_jitable
        if itself or not _is_outside(stand_in.__module__):
            yield repr(sorted(template._jit_options.items(), key=str)).encode()
            yield inline if isinstance(inline, FunctionType) else str(inline).encode()
            yield stand_in


def _used(function: FunctionType) -> Iterator[Any]:
    """Yield the code of a function, and what its names refer to in its module and in the modules that it names."""
    names: set[str] = set()
    yield from _code(function.__code__, names, function.__doc__)
    for cell in function.__closure__ or ():
        yield from _held(cell.cell_contents)
    yield from _of_attributes(names)
    outer = function.__globals__
    modules = [outer[name] for name in sorted(names) if isinstance(outer.get(name), ModuleType)]
    for name in sorted(names):
        if name in outer and not isinstance(outer[name], ModuleType):
            yield name.encode()
            yield from _held(outer[name])
    seen = set()
    while modules:  # also modules reached through others: package.module.constant
        module = modules.pop()
        if module.__name__ in seen:
            continue
        seen.add(module.__name__)
        if _is_outside(module.__name__):
            yield module.__name__.encode()
            named = [vars(module)[name] for name in sorted(names) if name in vars(module)]
            modules += [value for value in named if isinstance(value, ModuleType)]
            for value in named:
                yield from _stand_ins(value)
            continue
        for name in sorted(names):
            value = getattr(module, name, None)
            if isinstance(value, ModuleType):
                modules.append(value)
            elif hasattr(module, name):
                yield f"{module.__name__}.{name}".encode()
                yield from _held(value)


def _held(value: Any) -> Iterator[Any]:
    """Yield a function as it is, to be visited in its turn; of any other value, yield its parts."""
    if isinstance(value, FunctionType) or hasattr(value, "py_func") or hasattr(value, "_defn"):
        yield value
    else:
        yield from _parts(value)


def _code(code: CodeType, names: set[str], doc: str | None = None) -> Iterator[bytes]:
    """Yield the bytes of a code object and of those nested in it, without ``doc``; collect the names that they use."""
    yield code.co_code
    yield f"{code.co_argcount} {code.co_kwonlyargcount} {code.co_varnames}".encode()  # callers may pass by name
    names.update(code.co_names)
    for place, constant in enumerate(code.co_consts):
        if place == 0 and doc is not None and constant == doc:
            continue
        if isinstance(constant, CodeType):
            yield from _code(constant, names)
        elif isinstance(constant, frozenset):
            yield repr(sorted(constant, key=repr)).encode()
        else:
            yield repr(constant).encode()
