"""Nothing in the framework is decided by the name of a channel or a field: the source is read to see that it stays so."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

import itouch
import itouch_evidence
import itouch_tools
from itouch.plugin import Device
from itouch.plugin.discovery import Catalog

PACKAGES = [Path(package.__file__ or "").parent for package in (itouch, itouch_tools, itouch_evidence)]
FRAMEWORK = PACKAGES[0].parent
PLUGINS = Path(__file__).parents[2] / "plugins"
#: Where the names of a device's own channels stand beside their declarations (virtual devices, examples as text), and
#: where those of limits are, which scenes write: ``temperature`` is one of them.
OWN = (
    "itouch/arms/", "itouch_tools/scaffold/", "itouch_tools/cli/explain/", "itouch/world/limits.py",
)  # fmt: skip


@functools.cache
def names() -> frozenset[str]:
    """Return the name of every channel of the installed devices, and of every number that their modalities offer."""
    catalog, found = Catalog(), {"temperature", "desired", "obtained", "true_flux", "readiness", "plate_ready"}
    for name in catalog.device_names:
        device = catalog.device(name)
        assert device is not None and issubclass(device, Device)
        found |= {channel.name for channel in (*device.reads, *device.commands)}
    for plugin in catalog.plugin_names:  # and the figures of a contact that plugins declare
        for local in catalog.modality_names(plugin):
            modality = catalog.modality(plugin, local)
            found |= {one.key for one in modality.measured} if modality is not None else set()
    return frozenset(found | {"deadman", "temperature_target", "output", "actual_current", "twist"})


#: Words that are names of channels or fields, and stand for something else: file, what they are there.
MEANT = {
    "itouch/monitors/heat.py": "limits", "itouch/monitors/default_limits.py": "limits", "itouch/monitors/every_device.py": "limits",
    "itouch/plugin/__init__.py": "what it exports", "itouch/plugin/channel.py": "default names of factories",
    "itouch/plugin/device.py": "what a twin is told", "itouch/plugin/impedance.py": "the twin's own channels",
    "itouch/schema/__init__.py": "what it exports",
    "itouch/scene/loader.py": "an attribute", "itouch/scene/rigs.py": "a kind of attribute", "itouch_tools/viewer/scales.py": "titles of units",
    "itouch/world/limits.py": "limits", "itouch/world/limit_texts.py": "limits",
    "itouch/world/replaced_limits.py": "limits", "itouch/recording/tracks.py": "recordings of before",
    "itouch/loop/contact_report.py": "the end of a key that says what is missing",
    "itouch/loop/contact_log.py": "keys that reports of before have", "itouch_tools/authoring/lint.py": "an attribute of a scene",
    "itouch_tools/sweeps/collecting.py": "a kind of figure", "itouch_tools/sweeps/sweep_elements.py": "a kind of figure",
    "itouch/recording/views.py": "keys of a viewer's schema", "itouch/recording/wellknown.py": "keys of a viewer's schema",
    "itouch_tools/export/rerun_viewer.py": "keys of a viewer's schema",
    "itouch_evidence/surface/course.py": "devices of the bench's own scenes", "itouch_evidence/surface/laws.py": "a key of the report",
}  # fmt: skip


def _first(node: ast.Call) -> str:
    if node.args and isinstance(node.args[0], ast.Constant) and isinstance(node.args[0].value, str):
        return node.args[0].value
    return ""


def declared(folder: Path) -> set[str]:
    """Return the names of fields and channels that the source of a folder declares by a literal."""
    found = set()
    for file in folder.rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)) if "Field(" in source or "Channel(" in source else ():
            if isinstance(node, ast.Call) and _last(node.func) in ("Field", "Channel"):
                found.add(_first(node))
    return found - {""}


def _last(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


#: Words of every day, by which plugins call a field too.
PLAIN = {"targets", "reached", "finger", "objects", "open", "line", "memory", "passed", "tracked", "beside", "driver"}


@functools.cache
def its_own() -> frozenset[str]:
    """Return what the framework declares itself, and may look for."""
    return frozenset().union(*map(declared, PACKAGES))


@functools.cache
def others() -> frozenset[str]:
    """Return what others declare, and the framework may not look for."""
    return names() | (
        declared(PLUGINS) - PLAIN - {part for name in its_own() for part in (name, name.rpartition(".")[2])}
    )


def _said(tree: ast.AST) -> Iterator[ast.Constant]:
    """Yield the strings that are neither documentation nor the name in a declaration."""
    apart = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            apart.add(id(node.value))
        elif isinstance(node, ast.Call) and _last(node.func) in ("Field", "Channel", "Measured") and node.args:
            apart.add(id(node.args[0]))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in apart:
            yield node


def decisions(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name where source says the name of a channel or field of somebody else.

    Comparing, looking up by ``[]``, ``get``, ``getattr`` or ``in``, and putting a field's name together are all found:
    what counts is that the name stands there, alone or as a part between dots, or as a piece such as ``_temperature``.
    """
    for node in _said(tree):
        word = node.value
        if word in its_own() - names() or not word.replace(".", "").replace("_", "").replace("*", "").isidentifier():
            continue
        pieces = {part for part in word.replace("*", "").split(".") if part}
        ends = {word.strip("_")} if word.startswith("_") or word.endswith("_") else set()
        split = {part for name in names() if "_" in name for part in name.split("_")} - {"target"} if ends else set()
        if pieces & others() or ends & (others() | split):
            yield node.lineno, word


#: The files of each room, by its path.
ROOMS = {
    str(room.relative_to(FRAMEWORK)): sorted(room.glob("*.py"))
    for package in PACKAGES
    for room in (package, *sorted(package.rglob("*/")))
    if any(room.glob("*.py"))
}


@pytest.mark.parametrize("room", ROOMS)
def test_no_source_compares_with_the_name_of_a_channel_or_field(room: str) -> None:
    found = {}
    for file in ROOMS[room]:
        short = str(file.relative_to(FRAMEWORK))
        if not short.startswith(OWN) and short not in MEANT:
            found[short] = list(decisions(ast.parse(file.read_text(encoding="utf-8"))))
    found = {file: places for file, places in found.items() if places}
    assert not found, f"find the channel by its role (itouch.plugin.Role): {found}"


def test_every_room_is_looked_at() -> None:
    files = {file for package in PACKAGES for file in package.rglob("*.py")}
    assert {file for room in ROOMS.values() for file in room} == files
    assert len(files) > 600


@pytest.mark.parametrize("short", MEANT)
def test_every_exception_is_needed(short: str) -> None:
    assert list(decisions(ast.parse((FRAMEWORK / short).read_text(encoding="utf-8"))))


@pytest.mark.parametrize(
    "code",
    [
        'channel.name == "pose"', '"deadman" in device.reading', 'c.name in ("wrench", "pose_target")',
        'device.command("current")', 'carrier.reading["pose"]', 'channel.name.endswith("_temperature")',
        'sent.get("current")', '{"pose", "twist"} <= names', 'getattr(device, "heat_flux", None)',
        'table.get("wrench")', 'state[f"{name}.twin.axes"]', 'state[f"{name}.sent.wrench"]', 'reads = ("*.deadman",)',
        '_of(table, "pose", "surface.*")', 'WANTED = {"plate_temperature": 1}', 'n.startswith("skin_")',
        'state["heat.desired"]', 'entry["true_flux"]',
    ],
)  # fmt: skip
def test_the_test_sees_what_it_looks_for(code: str) -> None:
    assert list(decisions(ast.parse(code)))


@pytest.mark.parametrize(
    "code",
    [
        "channel.role is Role.DEADMAN", 'handle.command("pause")', 'event.name == "begin"', 'state["objects.pose"]',
        'Field("pose", unit="m", doc="a pose")', 'told = "the current of the plate"', 'state[f"{name}.hip"]',
    ],
)  # fmt: skip
def test_the_test_lets_pass_what_is_none(code: str) -> None:
    assert not list(decisions(ast.parse(code)))
