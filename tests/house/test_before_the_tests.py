"""What is compiled before a whole run of the tests can't hold it up without end."""

from __future__ import annotations

import importlib.util
import subprocess
from types import SimpleNamespace

import pytest
from sources import ROOT


def test_a_compilation_that_hangs_is_ended_and_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[float | None] = []

    def hang(words: list[object], *, timeout: float | None = None, **_: object) -> None:
        asked.append(timeout)
        raise subprocess.TimeoutExpired([str(word) for word in words], timeout or 0.0)

    spec = importlib.util.spec_from_file_location("the_conftest", ROOT / "tests" / "conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(subprocess, "run", hang)
    source = pytest.Config.ArgsSource
    config = SimpleNamespace(args_source=source.TESTPATHS, ArgsSource=source, getoption=lambda *_: 2)
    module.pytest_sessionstart(SimpleNamespace(config=config))
    assert asked == [600.0]
    assert capsys.readouterr().err.count("did not end in 600 s") == 1
