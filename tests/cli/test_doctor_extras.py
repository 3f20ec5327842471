"""The doctor says of every extra whether it is there: none of pyproject.toml is forgotten, none of developers told."""

from __future__ import annotations

import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

from itouch_tools.cli.doctor.machine_checks import extras, named

PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


def test_every_extra_of_the_project_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    users = {name for name, needs in listed.items() if needs} - {"test", "lint", "docs", "mutation", "bids"}
    found = extras()
    assert found.status in ("ok", "note")
    words = found.found.replace("; not: ", ", ")
    assert all(f"{name} (" in words or f", {name}" in words for name in users), words

    def without(package: str) -> str:
        if package == "viser":
            raise PackageNotFoundError(package)
        return version(package)

    monkeypatch.setattr("itouch_tools.cli.doctor.machine_checks.version", without)
    lacking = extras()
    assert "web" in lacking.found.partition("; not: ")[2].split(", ") and "viser" not in lacking.found
    assert lacking.status == "note" and "pip install 'itouch-py[" in lacking.advice


def test_requirements_are_sorted_by_what_asks_for_them() -> None:
    lines = ["numpy<3,>=2.2", 'viser<2,>=1.0; extra == "web"', "a.b-c ; python_version < '4' and extra == 'two'",
             'itouch-py[sweep]; extra == "cluster"', 'dask>=2025.1; extra == "cluster"', 'pytest; extra == "test"']  # fmt: skip
    assert named(lines) == {"web": ["viser"], "two": ["a.b-c"], "cluster": ["dask"]}
