"""The program's own source files as a graph: which module imports which, and how much code each has.

Everything here reads text; nothing of the program is imported.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: The import packages of the wheel, and where they lie.
PACKAGES = {
    "itouch": "framework/itouch",
    "itouch_tools": "framework/itouch_tools",
    "itouch_evidence": "framework/itouch_evidence",
    "itouch_thermal": "plugins/thermal/itouch_thermal",
    "contact_heat": "plugins/thermal/contact_heat",
    "itouch_xyz_table": "plugins/xyz_table/itouch_xyz_table",
    "itouch_encountered": "plugins/xyz_table/itouch_encountered",
    "itouch_usb_arm": "plugins/usb_arm/itouch_usb_arm",
    "itouch_arms": "plugins/arms/itouch_arms",
}
#: What the packages of the framework are for: what a touch needs, what people use it with, what shows that it is right.
SHELVES = {"itouch": "core", "itouch_tools": "tools", "itouch_evidence": "evidence"}
_IMPORT = re.compile(r"^[ \t]*((?:from [\w.]+ import (?:\([^)]*\)|[^\n(]+))|import [\w., ]+)", re.MULTILINE)
_LONG_STRING = re.compile(r'("""|\'\'\').*?\1', re.DOTALL)
#: Tokens that are no code.
_NOT_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING,
    tokenize.ENDMARKER,
}  # fmt: skip


@cache
def syntax(text: str) -> ast.Module:
    """Return the syntax tree of a file's text, which is for reading only: parsing takes longer than what is looked for."""
    return ast.parse(text)


@cache
def nodes(text: str) -> tuple[ast.AST, ...]:
    """Return all nodes of a file's syntax tree, those nearer to its root first, for reading only."""
    return tuple(walk(syntax(text)))


def walk(root: ast.AST) -> Iterator[ast.AST]:
    """Yield what ``ast.walk`` yields, in half the time."""
    found = [root]
    for node in found:
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, ast.AST):
                found.append(value)
            elif isinstance(value, list):
                found += [item for item in value if isinstance(item, ast.AST)]
        yield node


@dataclass(frozen=True)
class Module:
    """One file: its dotted name, its path and its text."""

    name: str
    path: Path
    text: str = field(repr=False)

    @property
    def tree(self) -> ast.Module:
        """Return the syntax tree of the file."""
        return syntax(self.text)

    @property
    def nodes(self) -> tuple[ast.AST, ...]:
        """Return all nodes of the syntax tree."""
        return nodes(self.text)

    @property
    def is_package(self) -> bool:
        return self.path.name == "__init__.py"

    @property
    def says(self) -> str:
        """Return the first line of the module's docstring, without its full stop."""
        return (ast.get_docstring(self.tree) or "").split("\n")[0].rstrip(".:")

    def code_lines(self) -> set[int]:
        """Return the numbers of the lines that hold code: no docstring, no comment, not blank."""
        docs: set[int] = set()
        for node in self.nodes:
            if (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                docs |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        lines: set[int] = set()
        for token in tokenize.generate_tokens(io.StringIO(self.text).readline):
            if token.type not in _NOT_CODE:
                lines |= set(range(token.start[0], token.end[0] + 1))
        return lines - docs

    def imported(self, names: Iterable[str], deferred: bool = True) -> set[str]:
        """Return the modules that this one imports, with the packages that Python runs on the way to them.

        The packages that the module itself lies in are left out: they have begun before it.

        Parameters
        ----------
        names
            All modules of the program: an imported name may be a module of a package, or something in it.
        deferred
            Whether imports inside functions count.  Those under ``TYPE_CHECKING`` always do.
        """
        known, found = set(names), set[str]()
        inside = set() if deferred else self._lines_of_functions()
        for line, statement in self._statements():
            if line in inside:
                continue
            node = ast.parse(statement).body[0]
            if isinstance(node, ast.Import):
                found |= {_longest(alias.name, known) for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                base = self._absolute(node)
                found |= {_longest(f"{base}.{alias.name}", known) for alias in node.names}
        own = {self.name, *_packages(self.name)}
        on_the_way = {above for name in found for above in _packages(name) if above in known}
        return (found | (on_the_way - own)) - {"", self.name}

    def _statements(self) -> Iterator[tuple[int, str]]:
        """Yield line and text of each import: a whole syntax tree of every file would take ten times as long."""
        text = _LONG_STRING.sub(lambda found: "\n" * found[0].count("\n"), self.text)
        for found in _IMPORT.finditer(text):
            yield text.count("\n", 0, found.start(1)) + 1, found[1]

    def _lines_of_functions(self) -> set[int]:
        lines: set[int] = set()
        for node in self.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines |= set(range(node.lineno, (node.end_lineno or 0) + 1))
        return lines

    def _absolute(self, node: ast.ImportFrom) -> str:
        parts = self.name.split(".") if self.is_package else self.name.split(".")[:-1]
        up = parts[: len(parts) - (node.level - 1)] if node.level else []
        return ".".join([*up, *([node.module] if node.module else [])])


def _packages(name: str) -> list[str]:
    """Return the packages that a module lies in, by their dotted names."""
    parts = name.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]


def _longest(name: str, known: set[str]) -> str:
    """Return the module of the program that a dotted name lies in, or nothing."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name


def shelf(name: str) -> str:
    """Return the shelf of a module: ``core``, ``tools``, ``evidence`` or ``plugins``."""
    return SHELVES.get(name.partition(".")[0], "plugins")


def modules(root: Path = ROOT) -> dict[str, Module]:
    """Return every module of the program by its name."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = path.relative_to(root / folder).with_suffix("").parts
            if "templates" in parts:  # what a new plugin begins with is text
                continue
            name = ".".join((package, *(part for part in parts if part != "__init__")))
            found[name] = _module(name, path, path.read_text(encoding="utf-8"))
    return found


#: A module that is as it was keeps its syntax tree: most tests of the house read them all.
_module = cache(Module)


def imports(every: dict[str, Module], deferred: bool = True) -> dict[str, set[str]]:
    """Return of each module the modules that it imports."""
    return {name: module.imported(every, deferred) for name, module in every.items()}


#: Fewer lines of code than this make a small module.
SMALL = 60


def small_with_one_importer(every: dict[str, Module], graph: dict[str, set[str]]) -> dict[str, str]:
    """Return the small modules that only one other imports, each with that one; packages are left out.

    ``graph``: of each module those that it imports.
    """
    importers: dict[str, list[str]] = {}
    for name, found in graph.items():
        for to in found:
            importers.setdefault(to, []).append(name)
    return {
        to: names[0]
        for to, names in sorted(importers.items())
        if len(names) == 1 and not every[to].is_package and len(every[to].code_lines()) < SMALL
    }


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import one another round about (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for to in sorted(graph.get(node, ())):
            if to not in index:
                visit(to)
                low[node] = min(low[node], low[to])
            elif to in stack:
                low[node] = min(low[node], index[to])
        if low[node] == index[node]:
            at = stack.index(node)
            group, stack[at:] = sorted(stack[at:]), []
            if len(group) > 1:
                found.append(group)

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found
