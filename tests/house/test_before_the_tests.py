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
    killed: list[bool] = []

    class Hangs:
        def wait(self, timeout: float | None = None) -> None:
            asked.append(timeout)
            if not killed:
                raise subprocess.TimeoutExpired([], timeout or 0.0)

        def kill(self) -> None:
            killed.append(True)

    spec = importlib.util.spec_from_file_location("the_conftest", ROOT / "tests" / "conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: Hangs())
    source = pytest.Config.ArgsSource
    config = SimpleNamespace(args_source=source.TESTPATHS, ArgsSource=source, getoption=lambda *_: 2)
    module.pytest_sessionstart(SimpleNamespace(config=config))
    assert asked == []  # the workers begin to collect
    module.pytest_xdist_node_collection_finished()
    module.pytest_xdist_node_collection_finished()  # of the other worker
    assert (asked, killed) == ([600.0, None], [True])
    assert capsys.readouterr().err.count("did not end in 600 s") == 1
