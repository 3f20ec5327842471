"""Fixtures for all tests: scenes in a temporary folder, and a catalog with devices of the tests' own."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from forms import (  # noqa: F401  - hooks
    pytest_addoption,
    pytest_configure,
    pytest_runtest_logreport,
    pytest_runtest_makereport,
    pytest_sessionfinish,
    pytest_terminal_summary,
    pytest_testnodedown,
)
from forms import pytest_collection_modifyitems as _choose
from hypothesis import HealthCheck, settings
from shipped import SCENES

# a machine may be busy with other work: how long an example takes says nothing
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.load_profile("any machine")

#: The files that take longest, longest first: a worker that began one of them last would be waited for.
LONGEST = ("test_matrix", "test_random_meshes", "test_restore", "test_live_window", "test_deaths", "test_device_suite")


@pytest.hookimpl(tryfirst=True)  # before the groups are read
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let a file's tests share a worker, because they share fixtures; begin with the files that take longest."""
    _choose(items)
    for item in items:
        item.add_marker(pytest.mark.xdist_group(str(item.path)))
    longest = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: longest.get(item.path.stem, len(longest)))


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """Return a copy of the shipped scenes that a test may change."""
    folder = tmp_path / "scenes"
    shutil.copytree(SCENES, folder)
    return folder


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    """Return a function that writes a file into the test's folder."""

    def put(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return put
