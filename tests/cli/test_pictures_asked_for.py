"""What ``--screenshot`` and ``--film`` hand to what draws, without a display."""

from __future__ import annotations

import sys
from argparse import Namespace
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

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
