"""What is compiled before a whole run of the tests can't hold it up without end."""

from __future__ import annotations

import importlib.util
import subprocess
from types import SimpleNamespace
from typing import Any

import pytest
from sources import ROOT


def test_a_compilation_that_hangs_is_ended_and_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[object] = []

    class Hanging:
        args = ("python", "-c", "...")

        def __init__(self, *rest: Any) -> None: ...

        def wait(self, timeout: float | None = None) -> int:
            asked.append(timeout)
            if "killed" not in asked:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
            return -9

        def kill(self) -> None:
            asked.append("killed")

    spec = importlib.util.spec_from_file_location("the_conftest", ROOT / "tests" / "conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(subprocess, "Popen", Hanging)
    source = pytest.Config.ArgsSource
    config = SimpleNamespace(args_source=source.TESTPATHS, ArgsSource=source, getoption=lambda *_: 2)
    module.pytest_sessionstart(SimpleNamespace(config=config))
    assert asked[:3] == [600.0, "killed", None]
    assert "did not end in 600 s" in capsys.readouterr().err
