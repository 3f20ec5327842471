"""The three packages of the framework: a touch needs the core alone, and old names of what has moved go on working."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import warnings
from importlib import import_module

import pytest
from shipped import SCENES
from sources import PACKAGES, modules

import itouch
from itouch.moved import PLACES
from itouch_tools.cli import main


def fresh(code: str, *options: str) -> str:
    """Return what a new interpreter prints."""
    done = subprocess.run([sys.executable, *options, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_a_touch_needs_nothing_but_the_core() -> None:
    """A scene is built, run and reported; no module of the other shelves is there after it."""
    code = f"""
import itouch, sys
session = itouch.build({str(SCENES / "first_touch.xml")!r})
session.run(0.05)
session.report()
session.close()
print(sorted(name for name in sys.modules if name.startswith(("itouch_tools", "itouch_evidence"))))
"""
    assert fresh(code).splitlines()[-1] == "[]"


#: Old names of what has moved, and where it is now.
MOVED = (
    ("itouch.study.statistics", "logistic_gee", "itouch_tools.study.statistics"),
    ("itouch.study.client", "connect", "itouch_tools.study.client"),
    ("itouch.study.observers", "FluxObserver", "itouch_tools.study.observers"),
    ("itouch.report.notebook", "curve", "itouch_tools.report.notebook"),
    ("itouch.sweeps.figures", "bits", "itouch_tools.sweeps.figures"),
    ("itouch.bench.faults.truth", "Truth", "itouch_evidence.faults.truth"),
    ("itouch_thermal.identify.command", "main", "itouch_thermal.identify.estimate"),
)


def test_what_has_moved_is_found_under_its_old_name_with_a_warning() -> None:
    code = "".join(
        f"from {old} import {name} as old\nfrom {new} import {name} as new\nassert old is new, {old!r}\n"
        for old, name, new in MOVED
    )
    said = fresh(code, "-W", "always::DeprecationWarning")
    tops = [next(top for top in PLACES if old.startswith(top)) for old, _, _ in MOVED]
    for top in set(tops):  # told once in a process, with the line that is to be changed
        line = 3 * tops.index(top) + 1
        told = f"<string>:{line}: DeprecationWarning: '{top}' is '{PLACES[top]}' now: import from there"
        assert said.count(told) == said.count(f"'{top}' is") == 1


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [("itouch.testing", "Finding", "CheckResult"), ("itouch.testing", "DeviceSubject", "DeviceHarness"),
     ("itouch.testing", "ModalitySubject", "ModalityHarness"), ("itouch.contact.meshfile", "Finding", "MeshFinding"),
     ("itouch.plugin", "Touch", "TwinInputs")],
)  # fmt: skip
def test_an_old_name_in_a_module_is_the_new_one_with_a_warning(module: str, old: str, new: str) -> None:
    home = import_module(module)
    with pytest.warns(DeprecationWarning, match=f"'{module}.{old}' is '{new}' now: import that") as told:
        assert getattr(home, old) is getattr(home, new)
    assert told[0].filename == __file__
    with pytest.raises(AttributeError, match=f"module '{module}' has no attribute 'Nothing'"):
        home.Nothing  # noqa: B018


def test_a_module_that_never_was_is_not_found() -> None:
    for name in ("itouch.nothing", "itouch.cli"):
        with pytest.raises(ModuleNotFoundError, match=name):
            import_module(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        with pytest.raises(ModuleNotFoundError, match="nothing"):
            import_module("itouch.study.nothing")


def test_tools_that_users_ask_for_by_the_name_of_the_core_are_there() -> None:
    assert itouch.sweep is import_module("itouch_tools.sweeps.sweep_client").sweep


def test_the_safety_report_is_a_command_like_any_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert " safety-report write limits, trips, worst case and tests of a scene, for a board " in words


def test_what_is_named_as_module_and_function_is_there() -> None:
    """What a lower room may not import it has by name (decision 104): a name that was changed in one place is found."""
    name = re.compile(rf"((?:{'|'.join(PACKAGES)})(?:\.\w+)*):(\w+)")
    named = {
        (module.name, *found.groups())
        for module in modules().values()
        for node in module.nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and (found := name.fullmatch(node.value))
    }
    assert len(named) > 5
    assert [one for one in sorted(named) if not hasattr(import_module(one[1]), one[2])] == []


def test_what_a_package_offers_is_there() -> None:
    """Each name of ``__all__``, also where it is imported only when it is asked for."""
    old = {"itouch_thermal.solver"}  # says that it is old when it is imported, which another test waits for
    packages = [
        import_module(name) for name, module in sorted(modules().items()) if module.is_package and name not in old
    ]
    offered = [(package, name) for package in packages for name in getattr(package, "__all__", ())]
    assert len(offered) > 100
    assert [f"{package.__name__}.{name}" for package, name in offered if not hasattr(package, name)] == []
