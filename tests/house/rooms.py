"""Draws the map of the rooms from the imports: ``python tests/house/rooms.py [--write]``.

A room is a folder of the core or of the tools, one of their single files, all of the evidence, or a plugin.  The map has
the rooms from the top to the bottom, their shelf, what each is for (the first line of its docstring), and on which rooms
it stands: those that it imports, without those that are reached through another one of them.  ``--write`` puts the map into ``CONTRIBUTING.md``,
and every module with its constants on a page of the reference.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import module_pages
import sentence_page
from sources import ROOT, circles, imports, modules, shelf

PAGE = ROOT / "CONTRIBUTING.md"
#: Packages whose folders are rooms.
_DIVIDED = ("itouch", "itouch_tools")
_BEGIN, _END = "<!-- map: python tests/house/rooms.py --write -->\n", "<!-- end of the map -->"


def room(name: str) -> str:
    """Return the room that a module is in: ``itouch.loop.engine`` is in ``loop``."""
    root, _, rest = name.partition(".")
    return rest.split(".")[0] if root in _DIVIDED and rest else root


@cache
def graph() -> tuple[dict[str, str], dict[str, set[str]]]:
    """Return what each room is for, and the rooms that it imports."""
    every = modules()
    to: dict[str, set[str]] = {}
    for name, found in imports(every).items():
        to.setdefault(room(name), set()).update(room(other) for other in found)
    says = {name: every[whole(name, every)].says for name in to}
    for name in to:
        to[name].discard(name)
    # the package itself offers a session's functions to users, by name when they are asked for
    for package in _DIVIDED:
        to.pop(package)
    return says, {name: found - set(_DIVIDED) for name, found in to.items()}


def whole(name: str, every: Iterable[str]) -> str:
    """Return the dotted name of a room."""
    return next(dotted for dotted in (*(f"{package}.{name}" for package in _DIVIDED), name) if dotted in every)


def heights(to: dict[str, set[str]]) -> dict[str, int]:
    """Return how many rooms stand below each, one on the other."""
    if round_about := circles(to):
        raise SystemExit(f"rooms import one another: {round_about}")
    found: dict[str, int] = {}

    def height(name: str) -> int:
        if name not in found:
            found[name] = 1 + max((height(other) for other in to[name]), default=-1)
        return found[name]

    for name in to:
        height(name)
    return found


def beneath(name: str, to: dict[str, set[str]]) -> set[str]:
    """Return all rooms on which one stands, directly or not."""
    found: set[str] = set()
    todo = [name]
    while todo:
        new = to[todo.pop()] - found
        found |= new
        todo += new
    return found


def drawn() -> str:
    """Return the map as a table in Markdown."""
    says, to = graph()
    high = heights(to)
    every = modules()
    lines = ["| room | shelf | what it is | stands on |", "|---|---|---|---|"]
    for name in sorted(to, key=lambda name: (-high[name], name)):
        direct = to[name] - set().union(*(beneath(other, to) for other in to[name]))
        lines.append(
            f"| `{name}` | {shelf(whole(name, every))} | {says[name].replace('``', '`')} | {' '.join(sorted(direct))} |"
        )
    return "\n".join(lines) + "\n"


def kept(page: Path = PAGE) -> str:
    """Return the map that stands on the page."""
    found = re.search(re.escape(_BEGIN) + r"(.*?)" + re.escape(_END), page.read_text(encoding="utf-8"), re.DOTALL)
    return found[1] if found else ""


def write(page: Path = PAGE) -> None:
    """Put the map on the page, in the place of what is there."""
    text = page.read_text(encoding="utf-8")
    begin, end = text.index(_BEGIN) + len(_BEGIN), text.index(_END)
    page.write_text(text[:begin] + drawn() + text[end:], encoding="utf-8")


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        write()
        module_pages.PAGE.write_text(module_pages.page(), encoding="utf-8")
        sentence_page.PAGE.write_text(sentence_page.page(), encoding="utf-8")
    else:
        print(drawn(), end="")
