"""Files and modules that pages and decisions name in backticks exist: what has moved since is named as it is now.

A decision that was superseded may name what there was.  Docstrings are held to the same for names within a room.
"""

from __future__ import annotations

import importlib
import re
import sys
import warnings
from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from listings import DOCS, ROOT, pages
from test_links import prose

sys.path.insert(0, str(ROOT / "tests" / "house"))

from sources import PACKAGES

DECISIONS = DOCS / "explanation" / "decisions"
#: Names of what is not in the repository: programs or readers write it, it had this name, or it was considered only.
ELSEWHERE = {
    "itouch/compiled",  # in a wheel
    "itouch.xsd", "itouch_client.py", "itouch_my_lever/device.py",  # by `new-scene`, `study serve`, `new-plugin`
    "scenes/blocks.xml",  # by readers of the four materials
    "itouch/cli",  # in earlier commits
    "itouch.surfaces",  # a group of entry points that was decided against
}  # fmt: skip
_CODE = re.compile(r"[\w./-]+\.(?:py|js|css|c|ino)")
_FOLDER = re.compile(r"[\w.-]+(?:/[\w.-]+)*/?")
_DOTTED = re.compile(r"([a-z_]\w*(?:\.\w+)+)(?:\(.*\))?")


@cache
def ends_of_paths() -> frozenset[str]:
    """Return how each file and folder of the repository may be named: its path, or the end of that, whole folders only."""
    found = set[str]()
    for top in ("framework", "plugins", "tests", "docs", "scenes", ".ci"):
        for path in [ROOT / top, *(ROOT / top).rglob("*")]:
            parts = path.relative_to(ROOT).parts
            if "__pycache__" not in parts and "_build" not in parts:
                found.update("/".join(parts[first:]) for first in range(len(parts)))
    return frozenset(found | {path.name for path in ROOT.iterdir()})


@cache
def rooms() -> frozenset[str]:
    """Return the packages within the packages of the program, and the folders beside them that pages name."""
    inside = {path.parent.name for folder in PACKAGES.values() for path in (ROOT / folder).glob("*/__init__.py")}
    return frozenset(inside | set(PACKAGES) | {"framework", "plugins", "tests", "docs", "scenes"})


@cache
def is_there(dotted: str) -> bool:
    """Tell whether a dotted name is a module, something in one, or a group of entry points."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # old names that are kept for one version
                found = importlib.import_module(".".join(parts[:count]))
                for name in parts[count:]:
                    found = getattr(found, name)
        except ImportError:
            continue
        except AttributeError:
            break
        return True
    return dotted in entry_points().groups or dotted in {"itouch.tasks", "itouch.observers"}  # groups that none uses


def not_there(text: str, *, of_decision: bool = False) -> Iterator[str]:
    """Yield the names of files and modules in a text that lead nowhere.

    A decision names a file of the program with its folder: many folders have a ``page.py``.
    """
    for word in re.findall(r"`([^`\n]+)`", text):
        path = word.partition("::")[0].removeprefix("./").rstrip("/")
        dotted = _DOTTED.fullmatch(word)
        if path in ELSEWHERE:
            continue
        if _CODE.fullmatch(path):
            bare = of_decision and "/" not in path and not path.startswith("test_")
            if bare or path not in ends_of_paths():
                yield word
        elif _FOLDER.fullmatch(word) and "/" in word and path.split("/")[0] in rooms():
            if path not in ends_of_paths():
                yield word
        elif dotted and dotted[1].split(".")[0] in PACKAGES and not is_there(dotted[1]):
            yield word


@pytest.mark.parametrize("page", [*pages(), ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"], ids=lambda page: page.stem)
def test_files_and_modules_that_a_page_names_exist(page: Path) -> None:
    text = prose(page)
    if page.parent == DECISIONS and re.search(r"^\*\*Status\.\*\* Superseded", text, re.M):
        return
    assert list(not_there(text, of_decision=page.parent == DECISIONS)) == []


def test_constants_of_other_modules_that_a_docstring_names_exist() -> None:
    """Such as `world.limits.HOLD`: a module of a room, and a constant in it."""
    inside = rooms() - set(PACKAGES)
    wrong = []
    for folder in PACKAGES.values():
        for path in sorted((ROOT / folder).rglob("*.py")):
            for name in re.findall(r"`+(\w+\.\w+\.[A-Z][A-Z_]+)`+", path.read_text(encoding="utf-8")):
                if name.split(".")[0] in inside and not any(is_there(f"{package}.{name}") for package in PACKAGES):
                    wrong.append(f"{path.relative_to(ROOT)}: {name}")
    assert wrong == []


@pytest.mark.parametrize(
    ("text", "of_decision", "found"),
    [
        ("`cli/report.py`, `.ci/run`, `tests/docs/`, `itouch.Session`, `itouch.devices`, `itouch.build(scene)`", True, []),
        ("`test_code_references.py`, `loop/plan.py::build`, `m/s`, `servo.culprits`", True, []),
        ("`cli/reports.py`, `loop/tables`, `itouch.scene.nothing`", False,
         ["cli/reports.py", "loop/tables", "itouch.scene.nothing"]),
        ("`session_page.py`", True, ["session_page.py"]),
        ("`session_page.py`", False, []),
    ],
)  # fmt: skip
def test_what_is_not_there_is_seen(text: str, of_decision: bool, found: list[str]) -> None:
    assert list(not_there(text, of_decision=of_decision)) == found
