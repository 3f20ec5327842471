"""One way to the hardware: only the supervisor writes to devices, and it is tested to the last branch."""

from __future__ import annotations

import ast
from pathlib import Path

import branches
from shipped import REPOSITORY

FRAMEWORK = REPOSITORY / "framework"


def device_writes(path: Path) -> list[int]:
    """Return the lines that call ``write`` of something called a device, but for devices that wrap another one."""
    source = path.read_text(encoding="utf-8")
    if ".write(" not in source:
        return []
    tree, found = ast.parse(source), []
    wrapping: list[ast.AST] = [
        node for node in ast.walk(tree)
        if (isinstance(node, ast.FunctionDef) and node.name == "write")
        or (isinstance(node, ast.ClassDef) and "Device" in {ast.unparse(base) for base in node.bases})
    ]  # fmt: skip
    passed_on = {id(node) for function in wrapping for node in ast.walk(function)}
    for node in [node for node in ast.walk(tree) if id(node) not in passed_on]:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "write":
            owner = ast.unparse(node.func.value)
            if "device" in owner.lower():
                found.append(node.lineno)
    return found


def test_only_the_supervisor_writes_to_a_device() -> None:
    writers = {
        str(path.relative_to(FRAMEWORK)): lines
        for path in FRAMEWORK.rglob("*.py")
        if (lines := device_writes(path)) and "testing" not in path.parts
    }
    assert len(writers.pop("itouch/safety/actuation.py")) == 1
    carriers = {name for name in writers if not name.startswith(("itouch/exchange/", "itouch/servo/"))}
    assert carriers == set()  # threads and sockets carry on what the supervisor has let through


def test_every_branch_of_the_supervisor_is_tested(tmp_path: Path) -> None:
    said = "`python tests/branches.py` chooses tests anew; what it says is missing has no test"
    assert branches.uncovered(branches.listed(), tmp_path / "coverage") == "", said


def test_the_cheapest_tests_that_take_every_branch_are_chosen() -> None:
    one, two, three = (("guard.py", line, line + 1) for line in (1, 2, 3))
    taken = {
        "all, slowly": frozenset({one, two, three}),
        "first": frozenset({one}),
        "second": frozenset({two}),
        "rest": frozenset({two, three}),
    }
    cost = {"all, slowly": 9.0, "first": 1.0, "second": 0.1, "rest": 1.0}
    assert branches.choose(cost, taken) == ["first", "rest"]  # the second, chosen first, is not needed any more
    assert branches.choose(cost | {"all, slowly": 0.1}, taken) == ["all, slowly"]
