"""One way to the hardware: only the supervisor writes to devices, and it is tested to the last branch."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import mutation
from shipped import REPOSITORY

FRAMEWORK = REPOSITORY / "framework"
UNIT = [str(Path(__file__).parent / f"test_{name}.py") for name in mutation.SAFETY]
#: What takes half of the time with the compiler off, and reaches no branch that nothing else there reaches.
SLOW = (
    "time_in_the_cold_is_used_up", "obeys_goes_down_however", "still_feels_something_is_no_reason", "lifted_quickly_and",
    "still_presses_goes_on and True", "no_way_leads_further", "wired_backwards_lets_go_of_the_finger",
)  # fmt: skip


def device_writes(path: Path) -> list[int]:
    """Return the lines that call ``write`` of something called a device, but for devices that wrap another one."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), []
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
    assert len(writers.pop("itouch/safety/supervisor.py")) == 1
    carriers = {name for name in writers if not name.startswith(("itouch/exchange/", "itouch/servo/"))}
    assert carriers == set()  # threads and sockets carry on what the supervisor has let through


def test_every_branch_of_the_supervisor_is_tested(tmp_path: Path) -> None:
    # with the compiler off: coverage sees the branches of compiled functions as Python runs them
    data = {**os.environ, "COVERAGE_FILE": str(tmp_path / "coverage"), "NUMBA_DISABLE_JIT": "1"}
    run = [
        "run",
        "--branch",
        "--source=itouch.safety,itouch.monitors",
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-k",
        " and ".join(f"not ({words})" for words in SLOW),
        *UNIT,
    ]
    done = subprocess.run(
        [sys.executable, "-m", "coverage", *run], env=data, cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]
    report = [sys.executable, "-m", "coverage", "report", "--fail-under=100", "--show-missing", "--skip-covered"]
    done = subprocess.run(report, env=data, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
