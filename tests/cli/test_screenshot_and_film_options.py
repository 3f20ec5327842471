"""What ``--screenshot`` and ``--film`` hand to what draws, without a display."""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from program import program
from shipped import SCENES

from itouch_tools.cli import pictures


@pytest.mark.parametrize(("screenshot", "film"), [("a.png", None), (None, "a.mp4"), ("a.png", "a.mp4")])
def test_each_file_that_is_asked_for_is_drawn_and_no_other(
    screenshot: str | None, film: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    class Filming:
        def __init__(self, *parts: object, **more: Any) -> None:
            asked.append(more)

        def tap(self, tick: int) -> None: ...

        def close(self) -> None:
            asked.append({"closed": True})

    module = ModuleType("itouch_tools.viewer.film")
    module.Filming = Filming  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "itouch_tools.viewer.film", module)
    monkeypatch.setattr(pictures, "need", lambda *words: None)
    session: Any = SimpleNamespace(
        model=SimpleNamespace(period=1e-3), state={}, statistics=SimpleNamespace(faults=[]), taps=[],
        clock=SimpleNamespace(pace="fast"),
    )  # fmt: skip
    options = Namespace(screenshot=screenshot, film=film, at=None, size=(640, 480))
    with pictures.taking(session, options, end=1.0):
        assert len(session.taps) == 1
    assert session.taps == [] and asked[1:] == [{"closed": True}]
    assert (asked[0]["screenshot"], asked[0]["film"]) == (screenshot or "", film or "")


def test_a_picture_of_a_time_before_a_session_goes_on_is_refused(tmp_path: Path) -> None:
    scene = str(SCENES / "first_touch.xml")
    for words in (
        ("run", scene, "--headless", "--for", "0.4s", "--save", "half.itouch"),
        ("run", "half.itouch", "--headless", "--for", "0.1s", "--record", "rest.mcap"),
    ):
        assert program(*words, cwd=tmp_path).returncode == 0
    for words in (("run", "half.itouch", "--for", "0.1s"), ("replay", "rest.mcap")):
        done = program(*words, "--screenshot", "a.png", "--at", "0.1s", cwd=tmp_path)
        assert done.returncode == 2
        assert "--at 0.1 s is before the start, which is at 0.4 s: choose a later time" in done.stderr
    assert not (tmp_path / "a.png").exists()
