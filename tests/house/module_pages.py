"""Writes the page of all files: ``python tests/house/rooms.py --write`` puts it beside the map of the rooms.

Each file stands there in the room that it is in, with the first line of its docstring, or of its first comment, and the
constants that it says something of, above them (``#:``) or behind: who looks for a number, a default or an idea finds
the file by a search on one page.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from sources import ROOT, SHELVES, Module, modules, shelf

PAGE = ROOT / "docs" / "reference" / "modules.md"
HEAD = """# Modules and constants

This page lists every file of the program, by package and folder, with its purpose and its constants, internal ones (`_NAME`) included. Search this
page for a number, a default or a word; the map in [Contributing](../contributing.md) says which rooms import which. After the modules come what is not
Python (firmware, the page of a session, templates) and the scenes. Written by `python tests/house/rooms.py --write`.
"""
#: Files that are no modules of the wheel's packages: how a first comment is found in each kind; templates end with ``.in``.
COMMENT = {
    ".py": r'\A\s*"""(.*?)"""',
    ".xml": r"<!--(.*?)-->",
    ".html": r"\{#(.*?)#\}",
    ".css": r"/\*(.*?)\*/",
    ".c": r"/\*(.*?)\*/",
    ".h": r"/\*(.*?)\*/",
    ".js": r"//([^\n]*)",
    ".ino": r"//([^\n]*)",
    ".yml": r"\A#([^\n]*)",
    ".toml": r"\A#([^\n]*)",
    ".md": r"\A#*\s*([^\n]*)",
}
#: Kinds of files that belong to the program only as templates.
_NOT_PROGRAM = (".yml", ".toml", ".md")
#: A first sentence that is shorter than this does not say enough by itself [characters].
_SHORT = 60
#: Longest value of a constant that is shown [characters].
_LONGEST = 40


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
    for folder, files in others().items():
        lines.append(f"## {folder}, not in a package\n" if folder in found else f"## {folder}\n")
        for path in files:
            lines.append(f"- `{path.name}`: {plain(first_comment(path))}")
            text = path.read_text(encoding="utf-8")
            named = constants(Module(path.stem, path, text)) if path.suffix == ".py" else defined(text)
            lines += [f"  - `{name}`: {plain(says)}" for name, says in named]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def others() -> dict[str, list[Path]]:
    """Return the other files that make the program, by their folder: firmware, templates, pages, scenes."""
    inside = {module.path for module in modules().values()}
    found: dict[str, list[Path]] = {}
    for root in ("framework", "plugins", "scenes"):
        for path in sorted((ROOT / root).rglob("*")):
            kind = Path(path.stem).suffix if path.suffix == ".in" else path.suffix
            if kind in COMMENT and path not in inside and (path.suffix == ".in" or kind not in _NOT_PROGRAM):
                found.setdefault(str(path.parent.relative_to(ROOT)), []).append(path)
    return found


def first_comment(path: Path) -> str:
    """Return the first sentence of a file's first comment, the next one too if that is short, without a full stop."""
    kind = Path(path.stem).suffix if path.suffix == ".in" else path.suffix
    said = re.search(COMMENT[kind], path.read_text(encoding="utf-8"), re.DOTALL)
    sentences = (
        re.split(r"(?<=[a-z\d)\]]\.|[a-z\d)\]]\?) ", " ".join(said[1].split("\n\n")[0].split())) if said else [""]
    )
    text = sentences[0]
    if len(text) < _SHORT and len(sentences) > 1:
        text = f"{text} {sentences[1]}"
    return text.rstrip(".:")


def defined(text: str) -> Iterator[tuple[str, str]]:
    """Yield the constants of a C header of which a comment says something, above them or behind, and what it says."""
    for above, group in re.findall(r"(?:/\* ([^/]*?) \*/\n)?((?:#define \w+ .+\n)+)", text):
        lines = re.findall(r"#define (\w+) (.*?)(?: +/\* (.*?) \*/)?\n", group)
        shown = [f"{name} = {value}" for name, value, behind in lines if not behind]
        if above and shown:
            yield ", ".join(shown), " ".join(above.split()).rstrip(".")
        yield from ((f"{name} = {value}", behind.rstrip(".")) for name, value, behind in lines if behind)


def _place(module: Module, order: list[str]) -> int:
    name = shelf(module.name)
    return order.index(name) if name in order else len(order)


def plain(text: str) -> str:
    """Return a line of a docstring as Markdown shows it, as it stands."""
    text = re.sub(r"`+([^`]*)`+", r"`\1`", text)
    return re.sub(r"([*_<$\[\]])(?=(?:[^`]*`[^`]*`)*[^`]*$)", r"\\\1", text)


def _segment(lines: list[str], node: ast.expr) -> str:
    """Return the text of an expression that stands in one line, else nothing; `ast` would split the file for each."""
    if node.end_lineno != node.lineno:
        return ""
    return lines[node.lineno - 1].encode()[node.col_offset : node.end_col_offset].decode()


def constants(module: Module) -> Iterator[tuple[str, str]]:
    """Yield the constants of a module of which a comment says something, and what it says.

    The comment stands above (``#:``), also of several lines of public constants, or behind one (``#``).
    """
    lines = module.text.splitlines()
    names: list[str] = []
    says, last = "", 0  # and in which line another one of these may follow
    for node in module.tree.body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        named = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        if not named or not all(re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name) for name in named):
            continue
        end = node.end_lineno or node.lineno
        value = _segment(lines, node.value)
        shown = re.fullmatch(rf"(?!TypeVar)[^\n`]{{1,{_LONGEST}}}", value) and re.search(r"[\d\"']", value)
        name = ", ".join(named) + (f" = {value}" if shown else "")
        above = node.lineno - 1
        said: list[str] = []
        while above > 0 and lines[above - 1].startswith("#:"):
            above -= 1
            said.insert(0, lines[above].removeprefix("#:").strip())
        stands_above = bool(said)
        behind = lines[end - 1].encode()[node.end_col_offset or 0 :].decode().strip()
        if not said and re.match(r"# (?!noqa|type:|fmt:|pragma)\S+ \S", behind):
            said = [behind.removeprefix("#").strip()]
        grouped = (
            shown and not said and node.lineno == last + 1 and not any(one.startswith("_") for one in (*names, *named))
        )
        if not grouped:
            if names:
                yield ", ".join(names), says
            names, says = [], ""
        if said or names:
            names.append(name)
            says, last = " ".join(said).rstrip(".:") or says, end if stands_above or grouped else 0
    if names:
        yield ", ".join(names), says
