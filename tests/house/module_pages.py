"""Writes the page of all modules: ``python tests/house/rooms.py --write`` puts it beside the map of the rooms.

Each file stands there in the room that it is in, with the first line of its docstring and the constants that it says
something of (``#:``): who looks for a number, a default or an idea finds the file by a search on one page.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from sources import ROOT, SHELVES, Module, modules, shelf

PAGE = ROOT / "docs" / "reference" / "modules.md"
HEAD = """# Modules and constants

Every file of the program, by package and folder, with what it is for and the constants that stand in it. Search this page for a number, a default
or a word; the map in [Contributing](../contributing.md) says which rooms stand on which. Written by `python tests/house/rooms.py --write`.
"""


def page() -> str:
    """Return the page as Markdown."""
    order = [*SHELVES.values(), "plugin"]
    found: dict[str, list[Module]] = {}
    for module in modules().values():
        folder = str((module.path if module.is_package else module.path.parent / "_").relative_to(ROOT))
        found.setdefault(folder.rpartition("/")[0], []).append(module)
    lines = [HEAD]
    for folder in sorted(found, key=lambda folder: (_place(found[folder][0], order), folder)):
        lines.append(f"## {folder}\n")
        for module in sorted(found[folder], key=lambda module: (not module.is_package, module.path.name)):
            lines.append(f"- `{module.path.name}`: {plain(module.says)}")
            lines += [f"  - `{name}`: {plain(says)}" for name, says in constants(module)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _place(module: Module, order: list[str]) -> int:
    name = shelf(module.name)
    return order.index(name) if name in order else len(order)


def plain(text: str) -> str:
    """Return a line of a docstring as Markdown shows it, as it stands."""
    text = re.sub(r"`+([^`]*)`+", r"`\1`", text)
    return re.sub(r"([*_<\[\]])(?=(?:[^`]*`[^`]*`)*[^`]*$)", r"\\\1", text)


def constants(module: Module) -> Iterator[tuple[str, str]]:
    """Yield the constants of a module that a comment ``#:`` stands above, with what it says."""
    lines = module.text.splitlines()
    for node in module.tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        named = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        public = [name for name in named if re.fullmatch(r"[A-Z][A-Z0-9_]*", name)]
        above = node.lineno - 1
        said: list[str] = []
        while above > 0 and lines[above - 1].startswith("#:"):
            above -= 1
            said.insert(0, lines[above].removeprefix("#:").strip())
        if public and said:
            yield ", ".join(public), " ".join(said).rstrip(".:")
