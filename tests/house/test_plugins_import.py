"""A plugin imports ``itouch.plugin`` and nothing else of the framework, whichever rooms there are, and by no other way."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec

import pytest
from sources import PACKAGES, ROOT, SHELVES

CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
#: Packages that give devices, modalities, carriers or monitors, by their entry points.
PLUGINS = sorted(
    {
        value.partition(":")[0].partition(".")[0]
        for group in ("itouch.devices", "itouch.modalities", "itouch.carriers", "itouch.monitors")
        for value in CONFIGURATION["project"]["entry-points"].get(group, {}).values()
    }
    - set(SHELVES)
)
#: What imports a module by a name that may be put together.
_DYNAMIC = {"import_module", "__import__", "find_spec", "resolve_name", "run_module", "exec", "eval"}


def _framework(name: str) -> bool:
    """Tell whether a module is the framework's, and none that a plugin may import."""
    top = name.partition(".")[0]
    return top in SHELVES and name != "itouch.plugin" and not name.startswith("itouch.plugin.")


def _there(name: str) -> bool:
    """Tell whether a text names a module of the framework that there is."""
    if not _framework(name) or not all(part.isidentifier() for part in name.split(".")):
        return False
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def reached(text: str, package: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of each module of the framework that a file of a plugin reaches past ``itouch.plugin``.

    Imports anywhere, also for types alone; modules that are imported by a text; and a text that is put together so that
    nobody can see what it names.
    """
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if _framework(alias.name))
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names = (
                [f"{node.module}.{alias.name}" for alias in node.names] if node.module == "itouch" else [node.module]
            )
            yield from ((node.lineno, name) for name in names if _framework(name))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            if _there(node.value):
                yield node.lineno, node.value
        elif isinstance(node, ast.Call) and node.args:
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            first = node.args[0]
            if called not in _DYNAMIC:
                continue
            if isinstance(first, ast.Constant):
                if isinstance(first.value, str) and "." not in first.value and _framework(first.value):
                    yield node.lineno, first.value
            elif isinstance(first, ast.JoinedStr):
                begin = first.values[0]
                own = isinstance(begin, ast.Constant) and str(begin.value).partition(".")[0] in (
                    package,
                    "contact_heat",
                )
                name = isinstance(begin, ast.FormattedValue) and ast.unparse(begin.value) == "__name__"
                if not own and not name:
                    yield node.lineno, ast.unparse(first)
            elif not isinstance(first, ast.Subscript | ast.Name):  # what those hold stands in the file as a text
                yield node.lineno, ast.unparse(first)


@pytest.mark.parametrize("package", PLUGINS)
def test_a_plugin_reaches_nothing_of_the_framework_but_what_is_for_plugins(package: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in sorted((ROOT / PACKAGES[package]).rglob("*.py"))
        for line, name in reached(path.read_text(encoding="utf-8"), package)
    ]
    assert found == []


def test_the_contracts_name_every_plugin_and_forbid_every_room() -> None:
    contracts = {one["name"]: one for one in CONFIGURATION["tool"]["importlinter"]["contracts"]}
    (mine,) = (one for name, one in contracts.items() if name.startswith("A plugin imports itouch.plugin"))
    assert sorted(mine["source_modules"]) == PLUGINS
    assert sorted(mine["forbidden_modules"]) == sorted(
        SHELVES
    )  # a package with all that is in it, also what is to come
    assert {one.removesuffix(".**") for one in mine["ignore_imports"]} == {"** -> itouch.plugin"}
    assert sorted(contracts["Plugins do not know one another"]["modules"]) == PLUGINS
    assert sorted(contracts["The framework names no plugin"]["forbidden_modules"]) == PLUGINS


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from itouch.plugin import Device\nfrom itouch.plugin.kernels import kernel", []),
        ("from itouch import plugin", []),
        ("import itouch", ["itouch"]),
        ("from itouch import build", ["itouch.build"]),
        ("def f():\n    from itouch.loop import Engine", ["itouch.loop"]),
        ("if TYPE_CHECKING:\n    from itouch.monitors.limits import FORCE", ["itouch.monitors.limits"]),
        ("from itouch.recording import reader", ["itouch.recording"]),
        ("from itouch_tools.export import x", ["itouch_tools.export"]),
        ("import_module('itouch')", ["itouch"]),
        ("importlib.import_module('itouch.session')", ["itouch.session"]),
        ("NAMES = {'a': 'itouch.safety'}\nimport_module(NAMES[a])", ["itouch.safety"]),
        ("sys.modules['itouch.loop']", ["itouch.loop"]),
        ("import_module(f'{top}.session')", ["f'{top}.session'"]),
        ("import_module('itou' + 'ch')", ["'itou' + 'ch'"]),
        ("import_module(f'mine.{name}')", []),
        ("import_module(f'{__name__}.{name}')", []),
        ("import_module('numpy')", []),
        ("GROUP = 'itouch.devices'", []),
    ],
)  # fmt: skip
def test_every_way_to_reach_past_it_is_seen(text: str, found: list[str]) -> None:
    assert [name for _, name in reached(text, "mine")] == found
