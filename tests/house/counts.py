"""Prints how large the house is: ``python tests/house/counts.py [FOLDER ...]``.

Lines of code are those without docstrings, comments and blanks.  ``FOLDER`` is a checkout, this one by default; several
are printed side by side, so that before and after can be compared.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

from rooms import room
from sources import ROOT, SMALL, Module, circles, imports, modules, shelf, small_with_one_importer


def longest(every: dict[str, Module], many: int = 5) -> list[tuple[int, str]]:
    """Return the functions with the most lines of code, as lines and ``module.function``."""
    found = []
    for name, module in every.items():
        code = module.code_lines()
        for node in module.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = sum(node.lineno <= line <= (node.end_lineno or 0) for line in code)
                found.append((lines, f"{name}.{node.name}"))
    return sorted(found, reverse=True)[:many]


def repeated(every: dict[str, Module]) -> dict[tuple[str, str], list[str]]:
    """Return the modules whose file has the name of another one of the framework, or of the same plugin."""
    found = dict[tuple[str, str], list[str]]()
    for name, module in every.items():
        if module.path.name not in ("__init__.py", "__main__.py"):
            home = room(name) if shelf(name) == "plugins" else "framework"
            found.setdefault((home, module.path.name), []).append(name)
    return {of: names for of, names in found.items() if len(names) > 1}


def counts(root: Path = ROOT) -> dict[str, int | str]:
    """Return what is counted, by its name."""
    every = modules(root)
    graph = imports(every)
    code = Counter[str]()
    files = Counter[str]()
    for name, module in every.items():
        code[shelf(name)] += len(module.code_lines())
        files[shelf(name)] += 1
    importers = Counter(to for name, found in graph.items() for to in found)
    names = Counter(
        module.path.name for module in every.values() if module.path.name not in ("__init__.py", "__main__.py")
    )
    twice = repeated(every)
    found: dict[str, int | str] = {"lines of code": code.total(), "files": files.total()}
    for kind in ("core", "tools", "evidence", "plugins"):
        found[f"  {kind}: lines of code"] = code[kind]
        found[f"  {kind}: files"] = files[kind]
    suite = [module for name, module in every.items() if room(name) == "testing"]
    found["  core, of it the conformance suite: lines of code"] = sum(len(module.code_lines()) for module in suite)
    found["  core, of it the conformance suite: files"] = len(suite)
    found |= {
        "files with one importer": sum(importers[name] == 1 for name, module in every.items() if not module.is_package),
        f"  of them under {SMALL} lines of code": len(small_with_one_importer(every, graph)),
        "file names that occur twice or more": sum(count > 1 for count in names.values()),
        "  within the framework, or within one plugin": len(twice),
        "import circles, TYPE_CHECKING included": len(circles(imports(every, deferred=False))),
        "import circles, imports inside functions included": len(circles(graph)),
    }  # fmt: skip
    for place, (lines, name) in enumerate(longest(every), 1):
        found[f"longest function {place}"] = f"{lines} {name.rpartition('.')[2]} ({name.rpartition('.')[0]})"
    return found


def main(arguments: list[str]) -> None:
    """Print the counts of each checkout, one column each."""
    sides = [counts(Path(argument).resolve()) for argument in arguments] or [counts()]
    for row in sides[0]:
        print(f"{row:52}" + "  ".join(f"{side.get(row, ''):>12}" for side in sides))


if __name__ == "__main__":
    main(sys.argv[1:])
