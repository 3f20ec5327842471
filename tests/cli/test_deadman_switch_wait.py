"""A session without a window and without a switch: it says what it waits for, and ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from itouch.schema import ItouchError
from itouch_tools.cli.live import Waiting


def watched(*, phase: str = "ready", switch: bool = False, **times: float) -> tuple[Waiting, Any]:
    handle = SimpleNamespace(link=SimpleNamespace(phase=phase), name="scene-1", stopped=False)
    handle.request_stop = lambda: setattr(handle, "stopped", True)
    device = SimpleNamespace(name="table", twin=False, reading=lambda name: object() if switch else None)
    model = SimpleNamespace(devices={"table": device})
    return Waiting(handle, model, **times), handle  # type: ignore[arg-type]


def test_the_wait_for_a_switch_is_told_once_and_ends(capsys: pytest.CaptureFixture[str]) -> None:
    waiting, handle = watched(again=1e3, patience=1e3)
    for _ in range(5):
        waiting.look()
    said = capsys.readouterr().err
    assert said.count("nobody holds a dead-man's switch") == 1
    for words in ("'table'", "Space", "itouch-py view scene-1", 'deadman="centre"', "Ctrl-C"):
        assert words in said
    assert not handle.stopped
    waiting, handle = watched(again=1e3, patience=0.0)
    with pytest.raises(ItouchError, match="nothing was enabled"):
        waiting.look()
    assert handle.stopped


@pytest.mark.parametrize(("phase", "switch"), [("running", False), ("ready", True)])
def test_no_wait_is_told_where_no_switch_is_missing(
    phase: str, switch: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    waiting, handle = watched(phase=phase, switch=switch, patience=0.0)
    waiting.look()
    handle.link.phase = "ready"  # what ran once has been enabled
    waiting.look()
    assert capsys.readouterr().err == ""
    assert not handle.stopped
