"""Mutation run of the supervisor: ``python tests/safety/mutants.py [--sample N] [--seed S] [MODULE ...]``.

Each mutant changes one operator, comparison, number or condition of one module, or drops one statement, in the syntax
tree.  The unit tests of the supervisor run against it in a process of its own; a mutant that none of them notices has
survived.  Only the standard library and pytest are needed; processes are forked from one that has imported all else.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "framework" / "itouch" / "safety"
#: The tests that must notice; those named after a module come first for it.
TESTS = ("guard", "readings", "heat", "carried", "supervisor", "hold_connect", "sequence")
FIRST = {
    "guard": "guard", "readings": "readings", "heat": "heat", "carried": "carried", "finger": "carried",
    "supervisor": "supervisor", "lifecycle": "supervisor", "hold": "hold_connect", "connect": "hold_connect",
    "sequence": "sequence", "trips": "supervisor",
}  # fmt: skip
#: How long [s] a mutant may take; one that hangs is noticed.
PATIENCE = 60
_OPTIONS = ("-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "-o", "filterwarnings=ignore")

_COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}  # fmt: skip
_BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitOr: ast.BitAnd,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change: the module, the line, what was changed, and the changed code."""

    module: str
    line: int
    what: str
    code: CodeType


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield the changed copies of one node."""
    if isinstance(node, ast.Compare):
        for index, operator in enumerate(node.ops):
            for other in _COMPARE.get(type(operator), ()):
                changed = copy.deepcopy(node)
                changed.ops[index] = other()
                yield f"{type(operator).__name__} -> {other.__name__}", changed
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in _BINARY and not _annotation(node):
        changed_op = copy.deepcopy(node)
        changed_op.op = _BINARY[type(node.op)]()
        yield f"{type(node.op).__name__} -> {type(changed_op.op).__name__}", changed_op
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield f"without {type(node.op).__name__}", node.operand
    elif isinstance(node, ast.BoolOp):
        changed_bool = copy.deepcopy(node)
        changed_bool.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield f"{type(node.op).__name__} -> {type(changed_bool.op).__name__}", changed_bool
    elif isinstance(node, (ast.If, ast.While, ast.IfExp)):
        turned = copy.deepcopy(node)
        turned.test = ast.UnaryOp(ast.Not(), node.test)
        yield "condition turned round", turned
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        for value in _numbers(node.value):
            yield f"{node.value!r} -> {value!r}", ast.Constant(value)
    elif isinstance(node, (ast.Assign, ast.Expr, ast.AugAssign, ast.Raise, ast.Delete)) and _droppable(node):
        yield "statement dropped", ast.Pass()


def _numbers(value: float) -> tuple[float, ...]:
    if isinstance(value, bool):
        return (not value,)
    return (value + 1,) if isinstance(value, int) else (value * 2.0 if value else 1.0,)


def _annotation(node: ast.AST) -> bool:
    """Tell whether an operator joins types: ``float | None``."""
    parts = [node.left, node.right] if isinstance(node, ast.BinOp) else []
    return any(isinstance(part, ast.Constant) and part.value is None for part in parts)


def _droppable(node: ast.stmt) -> bool:
    """Tell whether a statement can go: not a docstring, and not the only binding of a local name."""
    if isinstance(node, ast.Expr):
        return not isinstance(node.value, ast.Constant)
    if isinstance(node, ast.Assign):
        return all(isinstance(target, ast.Subscript) for target in node.targets)
    return True


def mutants(module: str, chosen: Container[int] | None = None) -> Iterator[Mutant]:
    """Yield the mutants of a module of the package: all of them, or those with the numbers chosen."""
    path = PACKAGE / f"{module}.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for number, (spot, child, what, changed) in enumerate(_spots(tree)):
        if chosen is None or number in chosen:
            yield Mutant(module, getattr(child, "lineno", 0), what, _compiled(tree, spot, child, changed, path))


def size(module: str) -> int:
    """Return how many mutants a module has."""
    return sum(1 for _ in _spots(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))))


def sample(modules: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Draw mutants of some modules at random."""
    every = [(module, number) for module in modules for number in range(size(module))]
    drawn = random.Random(seed).sample(every, min(count, len(every)))
    return [m for module in modules for m in mutants(module, {n for name, n in drawn if name == module})]


Spot = tuple[ast.AST, str, int | None]


def _spots(tree: ast.Module) -> Iterator[tuple[Spot, ast.AST, str, ast.AST]]:
    """Yield each change of a tree: where the changed part stands, the part, what is changed, and the changed part."""
    inert = {id(part) for node in ast.walk(tree) for part in _inert(node)}
    for node in [node for node in ast.walk(tree) if id(node) not in inert]:
        for name, value in list(ast.iter_fields(node)):
            for index, child in list(enumerate(value) if isinstance(value, list) else [(None, value)]):
                if isinstance(child, ast.AST) and id(child) not in inert:
                    for what, changed in changes(child):
                        yield (node, name, index), child, what, changed


def _inert(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what has no effect when the program runs: annotations, messages, decorators."""
    parts: list[ast.AST | None] = []
    if isinstance(node, (ast.arg, ast.AnnAssign)):
        parts = [node.annotation]
    elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        parts = [*node.decorator_list, node.returns if isinstance(node, ast.FunctionDef) else None]
    elif isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Assign) and _names_slots(node)):
        parts = [node]
    for part in parts:
        if part is not None:
            yield from ast.walk(part)


def _names_slots(node: ast.Assign) -> bool:
    return any(isinstance(target, ast.Name) and target.id == "__slots__" for target in node.targets)


def _compiled(tree: ast.Module, spot: Spot, child: ast.AST, changed: ast.AST, path: Path) -> CodeType:
    ast.copy_location(changed, child)
    _put(spot, changed)
    try:
        return compile(ast.fix_missing_locations(copy.deepcopy(tree)), str(path), "exec")
    finally:
        _put(spot, child)


def _put(spot: Spot, part: ast.AST) -> None:
    node, name, index = spot
    if index is None:
        setattr(node, name, part)
    else:
        getattr(node, name)[index] = part


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Offers a mutant in the place of its module."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant

    def find_spec(self, name: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        """Answer for the one module."""
        if name != f"itouch.safety.{self.mutant.module}":
            return None
        return importlib.util.spec_from_loader(name, self)

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(self.mutant.code, module.__dict__)


def survives(mutant: Mutant) -> bool:
    """Tell whether the tests pass with a mutant, in a process of its own."""
    child = os.fork()
    if child == 0:
        os._exit(_run(mutant))
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _run(mutant: Mutant) -> int:
    import pytest

    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    sys.meta_path.insert(0, Changed(mutant))
    first = FIRST[mutant.module]
    try:
        for names in ((first,), tuple(name for name in TESTS if name != first)):
            files = [str(HERE / f"test_{name}.py") for name in names]
            if code := int(pytest.main([*_OPTIONS, *files])):
                return code
    except BaseException:
        return 99
    return 0


def prepare() -> None:
    """Import all that is slow to import, but nothing that is mutated."""
    import hypothesis.strategies  # noqa: F401
    import pytest  # noqa: F401

    import itouch.world  # noqa: F401

    sys.path.insert(0, str(HERE))
    assert not any(name.startswith("itouch.safety") for name in sys.modules)


def control(module: str) -> Mutant:
    """Return a module as it is: it must survive."""
    path = PACKAGE / f"{module}.py"
    return Mutant(module, 0, "nothing", compile(path.read_text(encoding="utf-8"), str(path), "exec"))


def campaign(chosen: Sequence[Mutant], *, show: bool = True) -> list[Mutant]:
    """Run mutants, and return those that survived."""
    alive = []
    for mutant in chosen:
        if survives(mutant):
            alive.append(mutant)
            if show:
                print(f"survived: {mutant.module}.py:{mutant.line}: {mutant.what}", flush=True)
    return alive


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; exit code 1 if less than 90 % are noticed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("modules", nargs="*", choices=[[], *FIRST], metavar="MODULE", help="default: all")
    parser.add_argument("--sample", type=int, help="only so many, drawn at random")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(argv)
    prepare()
    modules = options.modules or list(FIRST)
    if options.sample is None:
        every = [mutant for module in modules for mutant in mutants(module)]
    else:
        every = sample(modules, options.sample, options.seed)
    if not survives(control("guard")):
        print("the tests fail without any change: mend them first")
        return 2
    alive = campaign(every)
    part = 1.0 - len(alive) / len(every)
    print(f"{len(every)} mutants, {len(every) - len(alive)} killed, {len(alive)} survived: {100 * part:.1f} % killed")
    return 0 if part >= 0.9 else 1


if __name__ == "__main__":
    sys.exit(main())
