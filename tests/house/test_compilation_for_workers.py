"""What is compiled for a whole run of the tests is waited for, but not without end, and is over with the run."""

from __future__ import annotations

import fcntl
import importlib.util
import itertools
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from sources import ROOT


@pytest.fixture
def conftest(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("the_conftest", ROOT / "tests" / "conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.delenv(module.TOGETHER, raising=False)
    return module


@pytest.fixture
def compiled(conftest: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """Lock what a process that compiles locks, until it was waited for three times; give the times of waiting."""
    monkeypatch.setenv(conftest.TOGETHER, str(tmp_path))
    slept: list[float] = []
    with open(tmp_path / "most", "ab") as held:
        fcntl.flock(held, fcntl.LOCK_EX)

        def sleep(seconds: float) -> None:
            slept.append(seconds)
            if len(slept) == 3:
                fcntl.flock(held, fcntl.LOCK_UN)

        # its own clock: threads of other tests in this process sleep on
        monkeypatch.setattr(conftest, "time", SimpleNamespace(sleep=sleep, monotonic=time.monotonic))
        yield slept


def of(name: str) -> SimpleNamespace:
    return SimpleNamespace(path=Path(f"{name}.py"))


def test_a_worker_begins_when_what_most_tests_need_is_compiled(conftest: ModuleType, compiled: list[float]) -> None:
    conftest.pytest_runtest_setup(of("test_of_what_is_compiled"))
    assert len(compiled) == 3


def test_one_that_needs_nothing_compiled_begins_at_once_and_goes_on(
    conftest: ModuleType, compiled: list[float]
) -> None:
    conftest.pytest_runtest_setup(of(conftest.UNCOMPILED[0]))
    conftest.pytest_runtest_setup(of("test_of_what_is_compiled"))
    assert compiled == []


def test_a_compilation_that_hangs_is_told(
    conftest: ModuleType, compiled: list[float], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ticks = itertools.count(0.0, 250.0)
    monkeypatch.setattr(conftest.time, "monotonic", lambda: next(ticks))
    conftest.pytest_runtest_setup(of("test_of_what_is_compiled"))
    assert len(compiled) == 2
    assert capsys.readouterr().err.count("did not end in 600 s") == 1


def test_the_process_that_compiles_holds_the_lock_and_ends_with_the_run(
    conftest: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conftest, "MOST", "import time; time.sleep(600.0)")
    started: list[subprocess.Popen[bytes]] = conftest._compiling
    source = pytest.Config.ArgsSource
    config = SimpleNamespace(args_source=source.TESTPATHS, ArgsSource=source, getoption=lambda *_: 2)
    conftest.pytest_sessionstart(SimpleNamespace(config=config))
    (process,) = started
    place = Path(os.environ[conftest.TOGETHER])
    with open(place / "most", "ab") as held, pytest.raises(BlockingIOError):
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    conftest.pytest_unconfigure()
    assert process.returncode and not place.exists() and conftest.TOGETHER not in os.environ


@pytest.mark.parametrize("asked", [("ARGS", 2), ("TESTPATHS", None)])
def test_a_part_of_the_tests_and_one_worker_compile_for_themselves(
    conftest: ModuleType, asked: tuple[str, int | None]
) -> None:
    source = pytest.Config.ArgsSource
    config = SimpleNamespace(args_source=source[asked[0]], ArgsSource=source, getoption=lambda *_: asked[1])
    conftest.pytest_sessionstart(SimpleNamespace(config=config))
    assert conftest._compiling == [] and conftest.TOGETHER not in os.environ


def test_files_that_begin_early_are_there_and_named_once(conftest: ModuleType) -> None:
    named = (*conftest.UNCOMPILED, *conftest.LONGEST)
    assert len(set(named)) == len(named)
    assert set(named) <= {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
