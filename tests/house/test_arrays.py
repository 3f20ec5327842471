"""Every public function that takes arrays says their shapes and units.

A docstring states a shape where it has a tuple of sizes such as ``(n, 3)`` or ``(tracks,)``, and a unit where it has one in
brackets, ``[m]``, or says what the entries count or are where they have no unit.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from sources import Module, modules

#: Names of NumPy for an array as a type.
_NUMPY = {"NDArray", "ndarray", "ArrayLike"}
#: A tuple of sizes: names, numbers, sums and products of them; or the shape of another thing that is named.
_SHAPE = re.compile(
    r"\((?:[\w+*/ -]+|\.{3}),(?: ?(?:[\w+*/ -]+|\.{3}),?)*\)|\b(?:same|their|any|its) shape\b|\bshaped like\b|\bshape \(\)"
)
#: A unit in brackets, or that the entries are such as have none.
_UNIT = re.compile(
    r"\[[^\]\n]+\]|\bunits?\b|\bdtype\b|\bind(?:ex|ices)\b|\bticks?\b|\bcounts?\b|\bpixels?\b|\bof length 1\b|\b0 to 1\b|\b0 or 1\b|"
    r"\b1 for\b|\bletters\b|\bbytes\b|\b(?:float|int|uint)(?:32|64|8)\b|\bdimensionless\b|\bmodes\b"
)


def _aliases(every: dict[str, Module]) -> dict[str, set[str]]:
    """Return of each module the names that stand for arrays in it: its own, and those that it imports."""
    own: dict[str, set[str]] = {}
    for name, module in every.items():
        found = set()
        for node in module.tree.body:
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Subscript | ast.BinOp):
                words = {part.id for part in ast.walk(node.value) if isinstance(part, ast.Name)}
                words |= {part.attr for part in ast.walk(node.value) if isinstance(part, ast.Attribute)}
                if words & _NUMPY:
                    found |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        own[name] = found
    seen = {name: set(found) for name, found in own.items()}
    for name, module in every.items():
        for node in _imports(module.tree):
            if node.module in own:
                seen[name] |= {alias.asname or alias.name for alias in node.names if alias.name in own[node.module]}
    return seen


def _imports(node: ast.AST) -> Iterator[ast.ImportFrom]:
    """Yield what is imported by name, at any depth; no expression has an import, and most of a tree is expressions."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, part, ()):
            if isinstance(inner, ast.ImportFrom):
                yield inner
            else:
                yield from _imports(inner)


def _takes_arrays(node: ast.FunctionDef, names: set[str]) -> bool:
    """Tell whether a parameter is an array, or may be one; not what is called with arrays."""
    for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
        if argument.annotation is None:
            continue
        text = ast.unparse(argument.annotation)
        if "Callable" not in text and names & set(re.findall(r"\w+", text)):
            return True
    return False


def _public(body: list[ast.stmt], above: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield the public functions of a module and the methods of its public classes; overloads and setters say nothing."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node.body, f"{above}{node.name}.")
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            silently = any(ast.unparse(one).endswith(("overload", ".setter")) for one in node.decorator_list)
            if not silently:
                yield f"{above}{node.name}", node


def silent(every: dict[str, Module]) -> dict[str, str]:
    """Return the functions that take arrays and say no shape or no unit, and which of the two."""
    found = {}
    for module, names in _aliases(every).items():
        for name, node in _public(every[module].tree.body):
            if not _takes_arrays(node, names | _NUMPY):
                continue
            doc = " ".join((ast.get_docstring(node) or "").split())
            lacks = [what for what, pattern in (("shape", _SHAPE), ("unit", _UNIT)) if not pattern.search(doc)]
            if lacks:
                found[f"{module}.{name}"] = " and ".join(lacks)
    return found


def test_functions_that_take_arrays_say_shapes_and_units() -> None:
    assert silent(modules()) == {}


SAYS = "Return the lengths (n,) [m] of vectors (n, 3) [m]."


@pytest.mark.parametrize(
    ("doc", "lacks"),
    [
        (SAYS, None),
        ("Return the lengths [m] of vectors, one each.", "shape"),
        ("Return the lengths (see above) of vectors [m].", "shape"),
        ("Return the lengths (n,) of vectors (n, 3).", "unit"),
        ("Return the lengths.", "shape and unit"),
    ],
)
def test_what_is_not_said_is_found(doc: str, lacks: str | None) -> None:
    text = f'''
from numpy.typing import NDArray
Array = NDArray[float]
def lengths(vectors: Array | None) -> Array:
    """{doc}"""
'''
    other = text.replace("Array = NDArray[float]", "from a import Array as Vectors").replace(
        "vectors: Array", "vectors: Vectors"
    )
    every = {name: Module(name, Path(f"{name}.py"), said) for name, said in (("a", text), ("b", other))}
    assert silent(every) == ({f"{name}.lengths": lacks for name in "ab"} if lacks else {})
    assert silent({"c": Module("c", Path("c.py"), text.replace("def l", "def _l"))}) == {}
