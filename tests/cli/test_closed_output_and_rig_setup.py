"""What asks a run to end, and what is said of where a virtual rig's devices are, without a run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from itouch.servo import prepare, realtime
from itouch_tools.cli import shutdown, virtual_rig
from itouch_tools.cli.shutdown import Stopping


def broken(*words: object) -> None:
    raise BrokenPipeError


def test_a_reader_that_goes_ends_a_run_once_and_never_again_after_a_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    quiet: list[str] = []
    monkeypatch.setattr(shutdown, "stop_writing", lambda: quiet.append("quiet"))
    stopping, asked = Stopping(), list[int]()
    shown = stopping.listened(broken)
    shown("before anything runs")
    stopping.bind(lambda: asked.append(1))
    for _ in range(3):
        shown("a line")
    assert (len(quiet), asked) == (4, [1])

    signalled = Stopping()
    signalled.bind(lambda: asked.append(2))
    signalled._note(2, None)
    signalled.listened(broken)("a line")
    assert asked == [1, 2]


def test_a_virtual_rig_says_where_each_device_is_before_it_is_ready(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done: list[str] = []
    rig: Any = SimpleNamespace(
        open=lambda: iter([("table", "/dev/one"), ("peltier", "/dev/two")]), run=lambda ends: done.append("run"),
        close=lambda: done.append("close"),
    )  # fmt: skip
    monkeypatch.setattr(
        prepare, "prepare", lambda *words, **more: SimpleNamespace(close=lambda: done.append("session"))
    )
    monkeypatch.setattr(virtual_rig, "VirtualRig", lambda session: rig)
    monkeypatch.setattr(realtime, "be_punctual", lambda: None)
    assert virtual_rig.main(["scene.xml", "--for", "1s"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "table: /dev/one", "peltier: /dev/two", "ready; Ctrl-C ends it",
    ]  # fmt: skip
    assert done == ["run", "close", "session"]
