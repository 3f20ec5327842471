"""Prints how many lines of the framework speak of heat or plates: ``python tests/meaning/heat_words.py [FOLDER ...]``.

A line is *said* where the word stands in a docstring or a comment, *declared* where it stands in the declaration of a
quantity, an attribute, a rule, a code of a message or a role, in the text of a message, or in an import; else it is
*code*.  Nothing is renamed or left undocumented to lower a count: it shows where a particular kind of display is spoken
of.  ``FOLDER`` is the folder ``framework`` of a checkout, of this one by default; several are printed one after the other.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from pathlib import Path

FRAMEWORK = Path(__file__).parents[2] / "framework"
_WORDS = re.compile(r"plate|heat|flux|temperature|skin|dose", re.IGNORECASE)
#: Calls that declare something: what stands in them is said to whoever reads it.
_DECLARES = {
    "Field", "Channel", "Quantity", "Measured", "Rule", "Code", "Limit", "Problem", "Scale", "quantity", "temperature",
    "choice", "flag", "child", "children", "ref", "text", "integer", "name", "file", "Trip", "namedtuple",
}  # fmt: skip
#: Where heat and surfaces belong: the monitors, and the code of surface and touch-off.
HOME = re.compile(r"monitors/|loop/(surface|touchoff|render|touch|missing|rig)|safety/(carried|finger)|twin/|bench/")

#: Before meaning was declared: the commit, its lines in all, and by room those of code outside of where they belong, as
#: this file counts them.
COMMIT, BEFORE_ALL = "ccd28ae", 625
BEFORE = {
    "arms": 0, "bench": 0, "cli": 7, "contact": 10, "exchange": 2, "faults": 0, "loop": 17, "plugin": 8, "recording": 7, "report": 38, "safety": 93, "scaffold": 3, "scene": 1, "schema": 2, "servo": 0, "testing": 2, "twin": 0, "viewer": 43, "world": 57,
}  # fmt: skip


def kinds(source: str) -> dict[int, str]:
    """Return of each line that speaks of heat or plates whether it is said, declared or code."""
    tree, declared = ast.parse(source), set[int]()
    docs = set[int]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docs |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        called = node.func if isinstance(node, ast.Call) else None
        name = called.attr if isinstance(called, ast.Attribute) else called.id if isinstance(called, ast.Name) else ""
        if isinstance(node, ast.Import | ast.ImportFrom) or name in _DECLARES:
            declared |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))  # type: ignore[attr-defined]
        if isinstance(node, ast.ClassDef) and any(getattr(base, "attr", "") == "Enum" for base in node.bases):
            declared |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    found: dict[int, str] = {}
    order = ("said", "declared", "code")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        for offset, line in enumerate(token.string.splitlines() or [""]):
            number = token.start[0] + offset
            if token.type not in (tokenize.NAME, tokenize.STRING, tokenize.COMMENT) or not _WORDS.search(line):
                continue
            sentence = token.type == tokenize.STRING and " " in line.strip("\"' ")
            kind = (
                "said" if token.type == tokenize.COMMENT or number in docs
                else "declared" if number in declared or sentence else "code"
            )  # fmt: skip
            found[number] = max(found.get(number, "said"), kind, key=order.index)
    return found


def counted(folder: Path = FRAMEWORK) -> Counter[tuple[str, str]]:
    """Return the number of such lines by room and kind."""
    found: Counter[tuple[str, str]] = Counter()
    for file in folder.rglob("*.py"):
        package, *inner = file.relative_to(folder).parts
        if package == "itouch_evidence":  # the room that it was before there were three packages
            inner.insert(0, "bench")
        short = "/".join(inner)
        for kind in kinds(file.read_text(encoding="utf-8")).values():
            found[short.split("/")[0], kind] += 1
            if kind == "code" and not HOME.match(short):
                found["outside", short.split("/")[0]] += 1
    return found


def main(folders: list[str]) -> None:
    """Print the counts of folders."""
    for folder in folders or [str(FRAMEWORK)]:
        lines = counted(Path(folder))
        rooms = {room for room, _ in lines} - {"outside"}
        outside = {room: lines["outside", room] for room in rooms}
        print(f"{'':12}{'code':>6}{'declared':>10}{'said':>6}{'all':>6}{'outside':>9}{'before':>8}   {folder}")
        for room in sorted(rooms, key=lambda room: -lines[room, "code"]):
            row = [lines[room, kind] for kind in ("code", "declared", "said")]
            before = BEFORE.get(room)
            print(
                f"{room:12}{row[0]:6}{row[1]:10}{row[2]:6}{sum(row):6}{outside[room]:9}{before if before is not None else '-':>8}"
            )
        row = [sum(lines[room, kind] for room in rooms) for kind in ("code", "declared", "said")]
        old, new = (sum(n for room, n in outside.items() if (room in BEFORE) is known) for known in (True, False))
        print(f"{'in all':12}{row[0]:6}{row[1]:10}{row[2]:6}{sum(row):6}{old + new:9}{sum(BEFORE.values()):8}")
        print(
            f"at {COMMIT} there were {BEFORE_ALL} lines in all; code outside of the monitors, of surface and touch-off, and"
        )
        print(
            f"of what is measured: {sum(BEFORE.values())} then, {old} now in the rooms that there were, {new} in those that came since"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
