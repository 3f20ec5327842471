"""The page of all codes, each with an example whose message is printed by the program itself."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from itouch.safety import Trip
from itouch_tools.authoring.codes import HEADINGS, Code
from itouch_tools.cli.explain import examples
from itouch_tools.cli.explain.example import Example, play

_HEAD = """# Messages and their codes

Generated from the program: the table of its codes, an input that gives each, and what it prints then.

Every problem of a file has a code, a sentence, a place (`file:line:column`) and advice. All problems of a scene are
reported at once, nothing is started, and the exit code is 2. Only what may be the consequence of another problem waits
until that is mended, as do names that may stand in a file which can't be read. A *warning* is reported too, but does
not stop; beside problems that are found while the files are read, those of the compiled scene are left out. A
device that is stopped while it runs is a *fault*: its code is printed, stands in the report under `trip`, and is
`fault.trip.label` of the `itouch.DeviceFaultError` that is raised; the exit code is 1. `itouch-py explain CODE` prints
what stands here, but for the files of the program in which a code is told: they are for whoever changes a message.
"""

#: The packages that are searched, of those that are installed.
_PACKAGES = (
    "itouch", "itouch_tools", "itouch_thermal", "itouch_xyz_table", "itouch_encountered", "itouch_usb_arm",
    "itouch_arms",
)  # fmt: skip

#: How the names of the classes and functions end that a code is given to.
_TELL = ("Problem", "Error", "Finding", "_refuse")


def page() -> str:
    """Return the reference of all codes as Markdown; runs every example."""
    return "\n".join([_HEAD, *_lines()])


def _lines() -> Iterator[str]:
    known = examples()
    for heading, codes in HEADINGS.items():
        yield f"## {heading}\n"
        for code in codes:
            yield from _entry(code, known[code.name])


def _entry(code: Code, example: Example) -> Iterator[str]:
    yield f"### {code.name}\n"
    files = ", ".join(f"`{file}`" for file in told_in(code.name))
    yield f"{_sentence(code.wrong)} {_sentence(code.remedy)}{f' Reported in {files}.' if files else ''}\n"
    yield f"```{_language(example)}\n{example.text.strip()}\n```\n"
    for name, text in _beside(example):
        yield f"with `{name}` beside it,\n\n```text\n{text}\n```\n"
    if example.plugin:
        yield "where the plugin is not a bundled one but a small one made for this example.\n"
    command = "python" if example.words[0] == "python" else "itouch-py"
    yield f"`{command} {' '.join(example.words[command == 'python' :])}` prints\n"
    yield f"```text\n{_told(code.name, example)}\n```\n"


def _beside(example: Example) -> Iterator[tuple[str, str]]:
    """Yield the short files that a reader should see beside the scene."""
    for name, content in example.files.items():
        hidden = name == example.shown or example.note or example.plugin
        if not hidden and isinstance(content, str) and len(content.splitlines()) <= 8:
            yield name, content.strip()


def _sentence(text: str) -> str:
    end = "" if text.endswith("?") else "."
    return text[0].upper() + text[1:] + end


def _language(example: Example) -> str:
    return "text" if example.note else "python" if example.shown.endswith(".py") else "xml"


def _told(name: str, example: Example) -> str:
    """Return the message of an example, the same in every run."""
    told = _message(name, play(example))
    for pattern, usual in example.varies:
        told = re.sub(pattern, usual, told)
    return told


def _message(name: str, printed: str) -> str:
    """Cut what a run prints to the message."""
    blocks = printed.strip().split("\n\n")
    if any(block.startswith(("error[", "warning[")) for block in blocks):
        return printed.strip()
    lines = printed.splitlines()
    begin = next((k for k, line in enumerate(lines) if f"fault[{name}]" in line), 0)
    end = next((k for k in range(begin + 1, len(lines)) if not lines[k].startswith("  ")), len(lines))
    return "\n".join(lines[begin:end])


def told_in(code: str) -> list[str]:
    """Return the files in which a code is told, as ``package/folder/file.py``, sorted."""
    return sorted(_places().get(code, ()))


@cache
def _places() -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    trips = {trip.name: trip.label for trip in Trip}
    for folder in _folders():
        for path in folder.rglob("*.py"):
            if path.parent.name == "explain":  # its examples name every code
                continue
            for code in _codes_told(ast.parse(path.read_bytes()), trips):
                found.setdefault(code, set()).add(path.relative_to(folder.parent).as_posix())
    return found


def _folders() -> Iterator[Path]:
    for name in _PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent


def _codes_told(tree: ast.Module, trips: dict[str, str]) -> Iterator[str]:
    """Yield each code that begins a problem, an error or a finding here, and each trip that a function here names."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args:
            name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            first = node.args[0]
            if name.endswith(_TELL) and isinstance(first, ast.Constant) and isinstance(first.value, str):
                yield first.value
        elif isinstance(node, ast.FunctionDef):  # sets of trips stand outside of functions
            for part in ast.walk(node):
                if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id == "Trip":
                    yield trips.get(part.attr, "")
