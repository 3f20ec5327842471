"""Every public function that takes arrays says their shapes and units.

A docstring states a shape where it has a tuple of sizes such as ``(n, 3)`` or ``(tracks,)``, and a unit where it has one in
brackets, ``[m]``, or says what the entries count or are where they have no unit.

Of a kernel's arguments Numba infers the types, so that ``Any`` hides what they are.  The docstring of the kernel, or that
of its module for all of its kernels, says of each whether it is a record, by the name of its class, whose docstring
says shapes and units once; an array, by shape and unit; or a number.
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
    r"\b1 for\b|\bletters\b|\bbytes\b|\b(?:float|int|uint)(?:32|64|8)\b|\bdimensionless\b|\bmodes\b",
    re.IGNORECASE,
)

#: Decorators that make a kernel.
_KERNEL = {
    "kernel",
    "linked",
    "inlined",
    "nogil_kernel",
    "addressed_kernel",
    "part_of_its_caller",
    "entry",
    "inner",
    "njit",
}
#: The name of a class, in single backticks.
_CLASS = re.compile(r"(?<!`)`(?:\w+\.)*(\w+)`(?!`)")
#: What has no unit either, and words for a number.
_CHOICE = re.compile(r"\bwhether\b|\bcodes?\b|\bnumbers? of\b|\bhow (?:many|often)\b", re.IGNORECASE)
_NUMBER = re.compile(r"\bnumbers?\b", re.IGNORECASE)
#: Arguments and fields, which may be called like a unit.
_NAMES = re.compile(r"``\w+``")
#: A clause that gives one shape to all arguments.
_ALL = re.compile(r"\b(?:arrays|scalars) have shape \(1,\)", re.IGNORECASE)
#: An entry of a section: its names, and what is said of them.
_ENTRY = re.compile(r"^(\w+(?:, \w+)*)(?: : .*)?\n((?:[ ]{4}.*(?:\n|$)|\n)+)", re.MULTILINE)
#: What arrays have too.
_OF_ARRAYS = {"shape", "size", "ndim"}


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
            texts = (("shape", _SHAPE, doc), ("unit", _UNIT, _NAMES.sub("", doc)))
            lacks = [what for what, pattern, text in texts if not pattern.search(text)]
            if lacks:
                found[f"{module}.{name}"] = " and ".join(lacks)
    return found


class Records:
    """The classes of records, by module and name, and the names by which each module has them."""

    def __init__(self, every: dict[str, Module]) -> None:
        self.docs: dict[tuple[str, str], str] = {}
        self.have_arrays: set[tuple[str, str]] = set()
        self._imported: dict[str, dict[str, str]] = {}
        names = _aliases(every)
        for module, source in every.items():
            for node in source.tree.body:
                if isinstance(node, ast.ClassDef):
                    marks = {ast.unparse(one).partition("(")[0] for one in (*node.bases, *node.decorator_list)}
                    if marks & {"NamedTuple", "dataclass"}:
                        self.docs[module, node.name] = " ".join((ast.get_docstring(node) or "").split())
                        fields = [ast.unparse(one.annotation) for one in node.body if isinstance(one, ast.AnnAssign)]
                        if any((names[module] | _NUMPY | {"Any"}) & set(re.findall(r"\w+", field)) for field in fields):
                            self.have_arrays.add((module, node.name))
        known = {name for _, name in self.docs}
        for module, source in every.items():
            self._imported[module] = {
                alias.asname or alias.name: node.module
                for node in _imports(source.tree)
                if node.module
                for alias in node.names
                if alias.name in known
            }

    def found(self, text: str, module: str) -> set[tuple[str, str]]:
        """Return the records that a module's text names, each so that one class alone is meant."""
        every = set()
        for match in _CLASS.finditer(text):
            name, whole = match[1], match[0].strip("`")
            near = {(module, name), (self._imported[module].get(name, ""), name)} if whole == name else set()
            same = [key for key in self.docs if key[1] == name and f".{key[0]}.{name}".endswith(f".{whole}")]
            meant = [key for key in same if key in near] or same
            every |= set(meant) if len(meant) == 1 else set()
        return every


def _kernels(every: dict[str, Module]) -> Iterator[tuple[str, ast.FunctionDef, list[str]]]:
    """Yield the public kernels with arguments of any type: module, function, and the names of these arguments."""
    for module, source in every.items():
        for _, node in _public(source.tree.body):
            marks = {ast.unparse(one).partition("(")[0].rpartition(".")[2] for one in node.decorator_list}
            arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            hidden = [one.arg for one in arguments if one.annotation and ast.unparse(one.annotation) == "Any"]
            if marks & _KERNEL and hidden:
                yield module, node, hidden


def _said_of(doc: str, name: str) -> Iterator[str]:
    """Yield what a docstring says of an argument: its entry, and each clause that names it."""
    for names, body in _ENTRY.findall(doc):
        if name in names.split(", "):
            yield body
    for clause in re.split(r"[.;]\s(?![^\[\]]*\])|\n\n", doc):
        if f"``{name}``" in clause:
            yield clause


def _used(node: ast.FunctionDef, name: str) -> str:
    """Return what a function uses an argument as: record, array, or nothing that tells."""
    found = ""
    for part in ast.walk(node):
        value = getattr(part, "value", None)
        if isinstance(value, ast.Name) and value.id == name:
            if isinstance(part, ast.Attribute) and part.attr not in _OF_ARRAYS:
                return "record"
            if isinstance(part, ast.Subscript | ast.Attribute):
                found = "array"
    return found


def vague(every: dict[str, Module]) -> tuple[dict[str, str], set[tuple[str, str]]]:
    """Return the kernels that do not say what an argument is, each with these arguments; and the records that are named."""
    found, named, records, names = {}, set(), Records(every), _aliases(every)
    for module, node, arguments in _kernels(every):
        doc, whole = ast.get_docstring(node) or "", ast.get_docstring(every[module].tree) or ""
        alone = len(arguments) == 1 and not _takes_arrays(node, names[module] | _NUMPY)
        lacks = []
        for name in arguments:
            said = " ".join((*_said_of(doc, name), *_said_of(whole, name), *([doc] if alone else [])))
            said, used, of = " ".join(said.split()), _used(node, name), records.found(said, module)
            about = _NAMES.sub("", said)
            bare = _UNIT.search(about) or _CHOICE.search(about)
            array = bare and (_SHAPE.search(said) or _ALL.search(" ".join(doc.split())))
            number = not used and (bare or _NUMBER.search(about))
            named |= of
            if not (of or (used != "record" and array) or number):
                lacks.append(name)
        if lacks:
            found[f"{module}.{node.name}"] = ", ".join(lacks)
    return found, named


def test_kernels_say_what_their_arguments_are() -> None:
    every = modules()
    assert len(list(_kernels(every))) > 100
    assert vague(every)[0] == {}


def test_records_of_kernels_say_shapes_and_units() -> None:
    every = modules()
    records, lacks = Records(every), {}
    for key in vague(every)[1]:
        wanted = [("unit", _UNIT)] + ([("shape", _SHAPE)] if key in records.have_arrays else [])
        lacks[".".join(key)] = [what for what, pattern in wanted if not pattern.search(records.docs[key])]
    assert {name: what for name, what in lacks.items() if what} == {}


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


@pytest.mark.parametrize(
    ("doc", "lacks"),
    [
        ("Move ``body``, a `Body`, by ``way`` (3,) [m] at ``index``, a number.", None),
        (
            "Move.\n\n    Parameters\n    ----------\n    body\n        A `Body`.\n    way, index\n        (3,) [m].",
            None,
        ),
        ("Move ``body``, a `Body`; ``way`` (3,) [m] and ``index`` say how.", None),
        ("Move ``body`` by ``way`` (3,) [m] at ``index``, a number.", "body"),
        ("Move ``body``, a `Nobody`, by ``way`` (3,) [m] at ``index``, a number.", "body"),
        ("Move ``body`` (7,) [m] by ``way`` (3,) [m] at ``index``, a number.", "body"),
        ("Move ``body``, a `Body`. ``way`` [m]. ``index``, a number.", "way"),
        ("Move a `Body` by a way (3,) [m] at an index.", "body, way, index"),
    ],
)
def test_what_is_hidden_is_found(doc: str, lacks: str | None) -> None:
    text = f'''
class Body(NamedTuple):
    """Where it is [m]."""
    at: float
@linked
def move(body: Any, way: Any, index: Any) -> float:
    """{doc}"""
    return shifted(body.at + way[0], index)
'''
    found, named = vague({"a": Module("a", Path("a.py"), text)})
    assert found == ({"a.move": lacks} if lacks else {})
    assert ("a", "Body") in named or "body" in (lacks or "")
