"""A plugin imports ``itouch.plugin`` and nothing else of the framework, whichever rooms there are, and by no other way."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec, resolve_name

import pytest
from sources import PACKAGES, ROOT, SHELVES, syntax

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
#: Those of them that take a name relative to a package, their second argument.
_RELATIVE = {"import_module", "find_spec", "resolve_name"}


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
    for node in ast.walk(syntax(text)):
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
        elif isinstance(node, ast.Call):
            yield from ((node.lineno, name) for name in _by_a_text(node, package))


def _by_a_text(call: ast.Call, package: str) -> Iterator[str]:
    """Yield what a call imports of the framework by a text, or the text if nobody can see what it names."""
    called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    first = _given(call, 0, "name")
    if called not in _DYNAMIC or first is None:
        return
    if isinstance(first, ast.Constant):
        if isinstance(first.value, str) and "." not in first.value and _framework(first.value):
            yield first.value
    elif isinstance(first, ast.JoinedStr):
        begin = first.values[0]
        own = isinstance(begin, ast.Constant) and str(begin.value).partition(".")[0] in (package, "contact_heat")
        name = isinstance(begin, ast.FormattedValue) and ast.unparse(begin.value) == "__name__"
        if not own and not name:
            yield ast.unparse(first)
    elif not isinstance(first, ast.Subscript | ast.Name):  # what those hold stands in the file as a text
        yield ast.unparse(first)
    if called in _RELATIVE:
        yield from _beside(first, _given(call, 1, "package"))


def _beside(name: ast.expr, base: ast.expr | None) -> Iterator[str]:
    """Yield the module of the framework that a name names relative to a package; without one it is absolute."""
    if base is None or (isinstance(base, ast.Name) and base.id in ("__name__", "__package__")):
        return
    if not isinstance(base, ast.Constant):  # a package without a dot in its name is no text that is seen elsewhere
        yield ast.unparse(base)
    elif isinstance(base.value, str) and base.value.partition(".")[0] in SHELVES:
        if not isinstance(name, ast.Constant):
            yield base.value
        elif str(name.value).startswith(".") and _framework(whole := resolve_name(str(name.value), base.value)):
            yield whole


def _given(call: ast.Call, place: int, name: str) -> ast.expr | None:
    """Return the argument of a call at a place, or of that name; None: it is not given."""
    if len(call.args) > place:
        return call.args[place]
    return next((one.value for one in call.keywords if one.arg == name), None)


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
        ("import_module('.session', 'itouch')", ["itouch.session"]),
        ("import_module('.session', package='itouch')", ["itouch.session"]),
        ("import_module('..session', 'itouch.plugin')", ["itouch.session"]),
        ("name = '.session'\nimport_module(name, 'itouch')", ["itouch"]),
        ("name = '..session'\nimport_module(name, 'itouch.plugin')", ["itouch.plugin"]),
        ("top = 'itouch'\nimport_module('.session', top)", ["top"]),
        ("import_module(name='itouch')", ["itouch"]),
        ("import_module('.channel', 'itouch.plugin')", []),
        ("import_module('.part', __package__)", []),
        ("import_module('.part', package=__name__)", []),
        ("import_module('.part', 'mine')", []),
        ("__import__('mine', globals())", []),
        ("import_module(f'mine.{name}')", []),
        ("import_module(f'{__name__}.{name}')", []),
        ("import_module('numpy')", []),
        ("GROUP = 'itouch.devices'", []),
    ],
)  # fmt: skip
def test_every_way_to_reach_past_it_is_seen(text: str, found: list[str]) -> None:
    assert [name for _, name in reached(text, "mine")] == found
