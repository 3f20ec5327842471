"""The first hour of a new user in interpreters from which all that only Linux has was taken away."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import itouch

HERE = Path(__file__).resolve().parent
SCENES = HERE.parents[1] / "scenes"
#: What must end so; all else ends with 0.
CODES = {"check FOLDER/missing.xml": 2, f"run {SCENES / 'four_materials_wire.xml'}": 2}


def toured(system: str, folder: Path, *more: str) -> list[dict[str, Any]]:
    environment = {**os.environ, "PYTHONPATH": str(HERE / system), "ITOUCH_TEST_DRAWS": "1"}
    command = [sys.executable, str(HERE / "tour.py"), str(SCENES), str(folder), *more]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Digests of the two States that the tour reaches, as this machine reaches them."""
    path, found = tmp_path_factory.mktemp("here") / "a.itouch", {}
    with itouch.build(SCENES / "four_materials.xml") as session:
        session.run(1.5)
        session.save(path)
        found["state a"] = hashlib.sha256(session.state.tobytes()).hexdigest()
    with itouch.restore(path) as session:
        session.run(0.5)
        session.save(path)
    found["state b"] = hashlib.sha256(itouch.restore(path).state.tobytes()).hexdigest()
    return found


def check(told: list[dict[str, Any]], folder: Path, states: dict[str, str]) -> None:
    assert len(told) >= 16
    for entry in told:
        step = entry["step"].replace(str(folder), "FOLDER")
        assert entry["code"] == CODES.get(step, 0), entry
    for step, digest in states.items():
        assert next(entry["said"] for entry in told if entry["step"] == step) == digest
    refused = next(entry["said"] for entry in told if "four_materials_wire" in entry["step"])
    assert "hardware needs Linux" in refused and "--twin all" in refused
    assert not list(folder.parent.glob("**/*.memory"))
    assert (folder / "a.png").stat().st_size > 10_000 and (folder / "a.html").exists()


#: What "mac" lacks, "win" lacks, too: the short form tours the poorer one.
SYSTEMS = [pytest.param("mac", marks=pytest.mark.long), "win"]


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_tour_is_as_on_linux(system: str, tmp_path: Path, states: dict[str, str]) -> None:
    check(toured(system, tmp_path), tmp_path, states)


@pytest.mark.long
@pytest.mark.parametrize("system", ["mac", "win"])
def test_the_tour_with_a_study_is_as_on_linux(system: str, tmp_path: Path, states: dict[str, str]) -> None:
    check(toured(system, tmp_path, "--long"), tmp_path, states)


@pytest.mark.parametrize("system", ["mac", "win"])
def test_the_interpreter_has_really_lost_them(system: str) -> None:
    code = "import os, sys, signal; print(sys.platform, hasattr(os, 'memfd_create'), hasattr(signal, 'SIGHUP'))"
    environment = {**os.environ, "PYTHONPATH": str(HERE / system)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == (["darwin", "False", "True"] if system == "mac" else ["win32", "False", "False"])


@pytest.mark.long
@pytest.mark.parametrize("system", ["mac", "win"])
def test_a_first_start_compiles_there(system: str, tmp_path: Path) -> None:
    """Several processes compile together, and open files by which one tells the others what it is at."""
    environment = {**os.environ, "PYTHONPATH": str(HERE / system), "ITOUCH_KERNELS": str(tmp_path / "kernels")}
    words = ["run", str(SCENES / "first_touch.xml"), "--headless", "--for", "0.1s", "--pace", "fast"]
    code = f"from itouch_tools.cli import main; raise SystemExit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "0.100 s simulated" in done.stdout
