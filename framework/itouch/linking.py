"""Functions that only other compiled functions call: they become machine code as part of these alone.

Numba optimizes each function with all that it calls, and makes machine code of it, before it compiles what calls it;
there it optimizes all of that once more, and makes machine code of it again.  For a function that nobody calls from
elsewhere, the first of the two is in vain.
"""

# ruff: noqa: SLF001  - Numba's libraries have no public way in

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary

from itouch.reference_counting import Borrowing

#: With what the names of the variables begin that hold what a compiled function needs of Python, e.g. for its errors.
_ENVIRONMENT = "_ZN08NumbaEnv"


class LinkedLibrary(JITCodeLibrary):
    """The code of a function with all that it calls, to be linked into what calls it; it can't be run by itself."""

    def finalize(self) -> None:
        """Take in what the function calls, and leave optimizing and machine code to what calls it."""
        of_numba: Any = self
        of_numba._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            of_numba._final_module.link_in(library._get_module_for_linking(), preserve=True)
        of_numba._finalize_dynamic_globals()
        self._define_environments()
        self._finalized = True

    def _define_environments(self) -> None:
        """Make the variables for what is needed of Python, which Numba fills in when a function is compiled."""
        module: Any = self._final_module
        codegen: Any = self._codegen
        found = [each for each in module.global_variables if each.name.startswith(_ENVIRONMENT)]
        known = codegen._engine.is_symbol_defined
        if lines := [str(each) for each in found if not (each.is_declaration or known(each.name))]:
            alone: Any = _parsed("\n".join(lines))
            alone.triple, alone.data_layout = module.triple, module.data_layout
            codegen._add_module(alone)
            codegen._engine.finalize_object()


_library: Any = LinkedLibrary
_parsed: Any = binding.parse_assembly


class Linked(Borrowing):
    """Numba's compiler for such a function: an option ``pipeline_class`` of ``numba.jit``."""

    def compile_extra(self, func: Callable[..., object]) -> Any:
        """Compile a function into a library of its own."""
        if self.state.library is None:
            self.state.library = _library(self.state.targetctx.codegen(), func.__qualname__)
        of_numba: Any = super().compile_extra
        return of_numba(func)
