"""Nothing in the framework is decided by the name of a channel or a field: the source is read to see that it stays so."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import itouch
from itouch.plugin import Device
from itouch.plugin.discovery import Catalog

FRAMEWORK = Path(itouch.__file__).parent
#: Where the names of a device's own channels stand beside their declarations (virtual devices, examples as text), and
#: where those of limits are, which scenes write: ``temperature`` is one of them.
OWN = ("arms/", "scaffold/", "cli/explain/", "world/limits.py", "world/limitcheck.py")


def names() -> set[str]:
    """Return the name of every channel of the installed devices, and of every number that their modalities offer."""
    catalog, found = Catalog(), {"temperature", "desired", "obtained", "true_flux", "readiness", "plate_ready"}
    for name in catalog.device_names:
        device = catalog.device(name)
        assert device is not None and issubclass(device, Device)
        found |= {channel.name for channel in (*device.reads, *device.commands)}
    return found | {"deadman", "temperature_target", "output", "actual_current", "twist"}


NAMES = names()


def _literals(node: ast.expr) -> Iterator[str]:
    """Yield the strings of a literal, or of a tuple, set, list or dictionary of them."""
    for part in [node] if isinstance(node, ast.Constant) else ast.iter_child_nodes(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield part.value


def _last(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def decisions(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name where a channel's or field's name is compared with, or looked up by, a literal."""
    for node in ast.walk(tree):
        found: list[str] = []
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            named = any(_last(side) in ("name", "names", "channel", "reading", "command", "sent") for side in sides)
            found = [word for side in sides for word in _literals(side)] if named else []
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            method, owner = node.func.attr, _last(node.func.value)
            if (
                method in ("reading", "command")
                or (method in ("startswith", "endswith", "removesuffix") and owner == "name")
                or method == "get"
                and owner in ("reading", "command", "sent")
            ):
                found = list(_literals(node.args[0]))
        elif isinstance(node, ast.Subscript) and _last(node.value) in ("reading", "command", "sent"):
            found = list(_literals(node.slice)) if isinstance(node.slice, ast.Constant) else []
        for word in found:
            if word in NAMES or any(
                word == "_" + part or word == part + "_" for name in NAMES for part in name.split("_")
            ):
                yield node.lineno, word


@pytest.mark.parametrize("file", sorted(FRAMEWORK.rglob("*.py")), ids=lambda file: str(file.relative_to(FRAMEWORK)))
def test_no_name_decides(file: Path) -> None:
    short = str(file.relative_to(FRAMEWORK))
    if short.startswith(OWN):
        pytest.skip("names of its own channels")
    found = list(decisions(ast.parse(file.read_text())))
    assert not found, f"{short}: find the channel by its role (itouch.plugin.Role): {found}"


@pytest.mark.parametrize(
    "code",
    [
        'channel.name == "pose"', '"deadman" in device.reading', 'c.name in ("wrench", "pose_target")',
        'device.command("current")', 'carrier.reading["pose"]', 'channel.name.endswith("_temperature")',
        'sent.get("current")', '{"pose", "twist"} <= names',
    ],
)  # fmt: skip
def test_the_test_sees_what_it_looks_for(code: str) -> None:
    assert list(decisions(ast.parse(code)))


@pytest.mark.parametrize("code", ["channel.role is Role.DEADMAN", 'handle.command("pause")', 'event.name == "begin"'])
def test_the_test_lets_pass_what_is_none(code: str) -> None:
    assert not list(decisions(ast.parse(code)))
