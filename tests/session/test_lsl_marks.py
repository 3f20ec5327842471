"""Marks of other programs, from a Lab Streaming Layer of a few lines: what comes in, and how long it is listened."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from itouch.session import lsl


class Inlet:
    """One stream of marks; the clock of its machine is 2 s behind."""

    def __init__(self, info: Any, recover: bool) -> None:
        self._waiting = info.waiting

    def time_correction(self, timeout: float) -> float:
        return 2.0

    def pull_sample(self, timeout: float) -> Any:
        return self._waiting.pop(0) if self._waiting else (None, None)


def stream(name: str, source: str, *samples: tuple[list[str], float]) -> Any:
    return SimpleNamespace(
        uid=lambda: source, source_id=lambda: source, name=lambda: name, waiting=list(samples)
    )  # fmt: skip


def test_marks_of_others_come_in_with_their_time_until_the_session_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = stream("eeg triggers", "amp-1", (["go"], 10.0), (["stop"], 11.5))
    ours = stream("itouch marks", "itouch-4711-marks", (["echo"], 10.0))
    layer: Any = SimpleNamespace(
        StreamInfo=lambda *words: None, StreamOutlet=lambda info: SimpleNamespace(push_sample=lambda row: None),
        ContinuousResolver=lambda **what: SimpleNamespace(results=lambda: [ours, theirs]), StreamInlet=Inlet,
        local_clock=lambda: 14.0,
    )  # fmt: skip
    monkeypatch.setattr(lsl, "_library", lambda: layer)
    monkeypatch.setattr(lsl, "replay_tracks", lambda model, state: ())
    posted, both = list[Any](), threading.Event()

    def post_mark(name: str, payload: dict[str, Any]) -> None:
        posted.append((name, payload["value"], payload["lsl_time"], payload["correction_s"]))
        if len(posted) == 2:
            both.set()

    session: Any = SimpleNamespace(
        model=SimpleNamespace(period=1e-3), state={"marks.count": 0, "tick": 5000}, taps=[], marks=[], ticks=5000,
        post_mark=post_mark,
    )  # fmt: skip
    with lsl.Streams(session) as streams:
        assert len(session.taps) == 1
        assert both.wait(60.0)
    assert posted == [("eeg triggers", "go", 10.0, 2.0), ("eeg triggers", "stop", 11.5, 2.0)]
    assert session.taps == []
    streams._thread.join(60.0)
    assert not streams._thread.is_alive()
