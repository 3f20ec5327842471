"""Functions take what they work on by name, in few parts: no function has so many parameters that a call is unreadable.

Compiled functions take named tuples of arrays (`itouch.plugin.kernels`), or blocks whose parts have named places.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from sources import Module, modules, walk

#: Most parameters of a function, without ``self``.
MOST = 12
#: Functions that have more, how many, and why; a line that is no longer needed must go.
MORE: dict[str, int] = {
    "itouch.safety.monitor_step.ask": 13,  # as its monitor's own arguments, so that nothing is copied in a tick
}


def counted(module: Module) -> Iterator[tuple[str, int]]:
    """Yield each function of a module, and how many parameters it has."""
    methods = {id(item) for node in module.nodes if isinstance(node, ast.ClassDef) for item in node.body}
    for node in module.nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args
            static = any(ast.unparse(one) == "staticmethod" for one in node.decorator_list)
            own = 1 if id(node) in methods and not static else 0
            count = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs) - own
            yield f"{module.name}.{node.name}", count


def test_no_function_has_too_many_parameters() -> None:
    found = [one for module in modules().values() for one in counted(module)]
    assert len(found) > 5000
    assert {name: count for name, count in found if count > MOST} == MORE


#: Decorators of functions that work on flat arrays, without what precedes an underscore.  (Those of the contact engine
#: take its arrays by `itouch.contact.layout`; what they count through are quaternions and small tuples.)
COMPILED = ("kernel", "inlined", "linked")
#: Numbers that stand for a place beyond the third in a flat array, in compiled functions of these modules, and why.
LITERALS = {
    "itouch.contact.halfspaces": 1,  # a small tuple
    "itouch.loop.touchoff": 4,  # the rotation in a pose: place (3,), quaternion (4,)
    "itouch.monitors.arm_kernels": 6,  # the torque in a wrench: force (3,), torque (3,)
    "itouch.safety.limiting": 2,  # figures whose meaning depends on the kind of channel
    "itouch_thermal.flux.late_readings": 1,  # the derivatives in a row, which are all that follows the first number
    "itouch_xyz_table.axes": 2,  # the rotation in a pose, and the last component of a force
}


def literals(module: Module) -> int:
    """Return how often a compiled function of a module names a place by a number instead of by its name."""
    found = 0
    for function in module.nodes:
        compiled = isinstance(function, ast.FunctionDef) and any(
            ast.unparse(one).rpartition("_")[2] in COMPILED for one in function.decorator_list
        )
        for node in walk(function) if compiled else ():
            if isinstance(node, ast.Subscript):
                where = node.slice
                begin = where.lower if isinstance(where, ast.Slice) else where
                first = 0 if isinstance(where, ast.Slice) else 2
                found += isinstance(begin, ast.Constant) and isinstance(begin.value, int) and begin.value > first
    return found


def test_compiled_functions_name_the_places_in_flat_arrays() -> None:
    found = {name: literals(module) for name, module in modules().items()}
    assert sum("@kernel" in module.text or "@linked" in module.text for module in modules().values()) > 50
    assert {name: count for name, count in found.items() if count} == LITERALS
