"""In which files of the program each code of a message is told, found in the source: for whoever changes a message."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from itouch.safety import Trip

#: The packages that are searched, of those that are installed.
_PACKAGES = (
    "itouch", "itouch_tools", "itouch_thermal", "itouch_xyz_table", "itouch_encountered", "itouch_usb_arm",
    "itouch_arms",
)  # fmt: skip

#: How the names of the classes and functions end that a code is given to.
_TELL = ("Problem", "Error", "Finding", "_refuse")


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
            for code in _told(ast.parse(path.read_bytes()), trips):
                found.setdefault(code, set()).add(path.relative_to(folder.parent).as_posix())
    return found


def _folders() -> Iterator[Path]:
    for name in _PACKAGES:
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent


def _told(tree: ast.Module, trips: dict[str, str]) -> Iterator[str]:
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
