"""How kernels are compiled: a function that only borrows arrays counts no references to them.

Numba counts the references to each array, also to one that a function is given and only passes on or takes a view of.
A function that makes no array and returns none needs no counts: whoever calls it holds its arrays for so long.  They
cost more than the calls themselves, a good part of a tick, and keep the compiler from optimizing across them.
"""

# ruff: noqa: SLF001  - Numba's intrinsics have no public name

from __future__ import annotations

from typing import Any, cast

from numba.core import extending, ir, types
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import NoPythonSupportedFeatureValidation

_intrinsic: Any = extending._Intrinsic
#: Operations that yield an array, or what holds some, without making one: they borrow what they are given.
_BORROWING = frozenset(("static_getitem", "build_tuple", "cast"))
#: Those that yield a part: of an array or a tuple it is borrowed, of a text it is a copy.
_ITEMS = frozenset(("static_getitem", "getitem", "typed_getitem"))
#: Functions that are compiled like kernels, or never count, and those whose arrays nobody counts, by identity.
_kernels: dict[int, Any] = {id(len): len}
_unowned: dict[int, Any] = {}
#: The attribute by which a package that knows nothing of this one marks a function like those in ``_unowned``.
UNOWNED = "counts_nothing"


def know(function: Any, *, unowned: bool = False) -> None:
    """Note a function that is compiled like kernels, or (``unowned``) one whose arrays are memory without counts."""
    (_unowned if unowned else _kernels)[id(function)] = function


class _Counted:
    """Tells whether a typed function needs counts of references."""

    def __init__(self, state: Any) -> None:
        self._function, self._kinds = state.func_ir, state.typemap
        self._models, self._given = state.targetctx.data_model_manager, state.args

    def holds(self, kind: Any) -> bool:
        """Tell whether what is of this type is counted: an array, or what holds some."""
        try:
            return bool(self._models.lookup(kind).contains_nrt_meminfo())
        except (KeyError, NotImplementedError):  # a type of somebody else's
            return True

    def counts(self, returned: Any) -> bool:
        """Tell whether the function needs counts; ``returned`` is the type of what it returns."""
        if self._function.is_generator or self.holds(returned) or not all(map(self._lends, self._given)):
            return True
        return any(self._makes(line) for block in self._function.blocks.values() for line in block.body)

    def _lends(self, kind: Any) -> bool:
        """Tell whether an argument of this type is of arrays, or not counted: a list from Python is a copy, and is."""
        if isinstance(kind, types.BaseTuple):
            return all(map(self._lends, iter(cast(Any, kind))))
        return isinstance(kind, types.Array) or not self.holds(kind)

    def _makes(self, line: Any) -> bool:
        """Tell whether an instruction makes something that is counted, or may do so."""
        if isinstance(line, ir.SetItem | ir.StaticSetItem | ir.SetAttr):
            return self.holds(self._kinds[line.value.name])  # Numba may copy what overlaps
        if not isinstance(line, ir.Assign):  # an error that says numbers keeps these in memory that is counted
            return isinstance(line, ir.StoreMap | ir.DynamicRaise | ir.DynamicTryRaise | ir.Print)
        what, held = line.value, self.holds(self._kinds[line.target.name])
        if not isinstance(what, ir.Expr):
            return isinstance(what, ir.Yield)
        if what.op == "call":
            return self._calls_for_counts(what, held)
        if held and what.op in _ITEMS and not isinstance(self._kinds[what.value.name], types.Array | types.BaseTuple):
            return True
        if what.op in ("getitem", "typed_getitem"):
            return held and self.holds(self._kinds[what.index.name])  # an index that is an array makes a copy
        if what.op in ("getattr", "exhaust_iter"):
            return held and not isinstance(self._kinds[what.value.name], types.BaseTuple)
        return held and what.op not in _BORROWING

    def _calls_for_counts(self, what: Any, held: bool) -> bool:
        kind = self._kinds[what.func.name]
        if isinstance(kind, types.NamedTupleClass):
            return False
        found = guard(get_definition, self._function, what.func)
        value = getattr(found, "value", None)
        if id(value) in _unowned or getattr(value, UNOWNED, False):
            return False
        given = [*what.args, *(each for _, each in what.kws), *([what.vararg] if what.vararg else [])]
        if isinstance(kind, types.ObjModeDispatcher):  # Python is given objects of the arrays, which count
            return any(self.holds(self._kinds[each.name]) for each in given)
        if held or id(value) in _kernels or isinstance(kind, types.Dispatcher):  # it counts by itself what it needs
            return held
        if isinstance(value, _intrinsic):  # what it is made of is written out, and counts nothing
            return False
        return any(self.holds(self._kinds[each.name]) for each in given)


@register_pass(mutates_CFG=False, analysis_only=False)
class _CountNothing(FunctionPass):
    """Switches the counts of references off for a function that needs none."""

    _name = "itouch_count_nothing"

    def __init__(self) -> None:
        of_numba: Any = super().__init__
        of_numba()

    def run_pass(self, state: Any) -> bool:
        """Look at a function whose types are known, before it is translated."""
        if not state.flags.nrt or _Counted(state).counts(state.return_type):
            return False
        state.flags.nrt = False
        state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return True


class Borrowing(Compiler):
    """Numba's compiler for kernels: an option ``pipeline_class`` of ``numba.jit``."""

    def define_pipelines(self) -> Any:
        """Return Numba's own pipeline, with the pass that leaves out counts."""
        builder: Any = DefaultPassBuilder
        manager = builder.define_nopython_pipeline(self.state)
        manager.add_pass_after(_CountNothing, NoPythonSupportedFeatureValidation)
        manager.finalize()
        return [manager]
