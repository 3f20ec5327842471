"""Ways on which Numba takes longer to start or to compile than it has to, made shorter; its results stay the same.

Why: docs/explanation/decisions/0099-numba-is-spared-what-it-repeats.md.
"""

# ruff: noqa: SLF001  - what is shortened is within Numba

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable
from typing import Any

from llvmlite import binding
from numba.core import codegen, event, ir, targetconfig
from numba.core.types import functions
from numba.core.typing import templates
from numba.np import linalg

_linalg: Any = linalg
_events: Any = event
_flags: Any = targetconfig.ConfigStack


#: What a function inherits of how its caller is compiled, and the option by which it settles that itself.
_INHERITED = {"nrt": "_nrt", "fastmath": "fastmath", "error_model": "error_model", "forceinline": "forceinline"}


def take() -> None:
    """Take these ways in this process, from now on."""
    _compare_quickly(targetconfig.TargetConfig)
    _remember_calls(functions.BaseFunction)
    _share_between_callers(templates._OverloadFunctionTemplate)
    _list_variables_by_type(ir.Inst)
    _optimize_what_has_a_body(codegen.CPUCodeLibrary)
    _tell_of_the_lock_who_listens()
    _look_for_blas_when_it_is_used()


def _compare_quickly(options: Any) -> None:
    """Let options of compilations be compared by what is set in them: all others have their defaults in both.

    Numba compares them for each overload of each call that it types; looking at all of them, defaults included, took a
    twelfth of a first start.  Its hash is that of their names, and so the same for all.
    """
    by_all = options.__eq__

    def equal(self: Any, other: Any) -> Any:
        if self is other:
            return True
        if type(self) is not type(other):
            return by_all(self, other)
        one, two = self._values, other._values
        return one == two or all(getattr(self, name) == getattr(other, name) for name in one.keys() | two.keys())

    def digest(self: Any) -> int:
        return len(self.options)

    options.__eq__, options.__hash__ = equal, digest


def _remember_calls(kind: Any) -> None:
    """Type a call of a function of Numba's own, or of an operator, once for the same types of arguments.

    Numba tries one template after the other for each call, each time that it goes through a function, and again when it
    writes its code; hardly one search in twenty finds something new.  It remembers as much itself of the functions that
    templates are written as, by the same key but for what is not inherited; what failed is tried again.
    """
    search = kind.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        known = self.__dict__.setdefault("_itouch_calls", {})
        key = context, tuple(args), tuple(kws.items()) if kws else (), _inherited(_INHERITED)
        if (found := known.get(key)) is None:
            signature = search(self, context, args, kws)
            known[key] = signature, self._impl_keys[signature.args]
            return signature
        signature, implementation = found
        self._impl_keys[signature.args] = implementation  # other arguments may have led to another one since
        return signature

    kind.get_call_type = get_call_type


def _inherited(names: Iterable[str]) -> tuple[object, ...] | None:
    """Return these of the options of the compilation that is under way, which what it calls may inherit; None: none is.

    All others, as whether Python may call the function, or whether it lets go of the lock, are the caller's own.
    """
    top = _flags.top_or_none()
    if top is None:
        return None
    return tuple([top.fastmath.encode() if name == "fastmath" else getattr(top, name) for name in names])


def _share_between_callers(kind: Any) -> None:
    """Compile a function that others call once for the same types and what it inherits, whoever calls it.

    Numba compiles it anew for callers that differ in any option at all.
    """

    def _get_impl(self: Any, args: Any, kws: Any) -> Any:
        free = [name for name, option in _INHERITED.items() if option not in self._jit_options]
        key = self.context, tuple(args), tuple(kws.items()), _inherited(free)
        if (found := self._impl_cache.get(key)) is None:
            found = self._build_impl(key, args, kws)
        return found

    kind._get_impl = _get_impl


#: What a value in a line of Numba's own language is, or holds.
_NOTHING, _VARIABLE, _INSTRUCTION, _SEQUENCE, _TABLE = range(5)


def _list_variables_by_type(kind: Any) -> None:
    """List the variables of an instruction by the types of what it holds, each of which is looked into once.

    Numba does so all the time that it compiles, and asks of each value five times what it is.
    """
    kinds: dict[type, int] = {}

    def kind_of(cls: type) -> int:
        order = (ir.Var, _VARIABLE), (ir.Inst, _INSTRUCTION), ((list, tuple), _SEQUENCE), (dict, _TABLE)
        kinds[cls] = found = next((number for bases, number in order if issubclass(cls, bases)), _NOTHING)
        return found

    def listed(self: Any, value: Any) -> list[Any]:
        cls = type(value)
        what = kinds[cls] if cls in kinds else kind_of(cls)
        if what == _VARIABLE:
            return [value]
        if what == _INSTRUCTION:
            found: list[Any] = value.list_vars()
            return found
        found = []
        if what != _NOTHING:
            for each in value if what == _SEQUENCE else value.values():
                cls = type(each)
                what = kinds[cls] if cls in kinds else kind_of(cls)
                if what == _VARIABLE:
                    found.append(each)
                elif what != _NOTHING:
                    found += listed(self, each)
        return found

    kind._rec_list_vars = listed


def _optimize_what_has_a_body(kind: Any) -> None:
    """Let LLVM optimize the functions that a module defines, not those that it only calls, which are most."""
    optimize = kind._optimize_functions

    def optimize_functions(self: Any, module: Any) -> None:
        optimize(self, _Defined(module))

    kind._optimize_functions = optimize_functions


class _Defined:
    """A module of LLVM whose functions are those that have a body."""

    def __init__(self, module: Any) -> None:
        object.__setattr__(self, "_module", module)

    @property
    def functions(self) -> list[Any]:
        return [each for each in self._module.functions if not each.is_declaration]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self._module, name, value)


def _tell_of_the_lock_who_listens() -> None:
    """Make no event of LLVM's lock while nobody listens for it: each of the many calls makes two."""
    lock: Any = binding.ffi.lib._lock
    listeners = _events._registered["numba:llvm_lock"]
    lock._cblist[:] = [(_when(listeners, begin), _when(listeners, end)) for begin, end in lock._cblist]


def _when(listeners: list[Any], tell: Any) -> Any:
    def told() -> None:
        if listeners:
            tell()

    return told


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
