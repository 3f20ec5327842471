"""Threads that a plugin leaves running write when nobody expects it: what is sent stays in its limits all the same."""

from __future__ import annotations

import itertools
import math
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_plugin_fault_isolation import Hum, Rod, RodTwin, engine

import itouch
from itouch.plugin import Record

#: What the threads write, again and again: no number, far too much, and what is allowed.
WORDS = (math.nan, 1e9, -1e9, math.inf, 0.5)


class Sent:
    """What reached the twin, tick by tick."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.forces: list[np.ndarray] = []
        step, forces = RodTwin.step, self.forces

        def watched(twin: RodTwin, state: Record, command: Record, touch: Any, period: float) -> None:
            forces.append(command["wrench"][:3].copy())
            step(twin, state, command, touch, period)

        monkeypatch.setattr(RodTwin, "step", watched)


@pytest.fixture
def often() -> Iterator[None]:
    """Let threads take turns as often as the interpreter can."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(usual)


def scribbling(words: tuple[float, ...], stop: threading.Event) -> type[Hum]:
    class Scribbling(Hum):
        """Has threads that write into all that it was ever given, also while others work."""

        def update(self, model: Any, state: Record, period: float) -> None:
            super().update(model, state, period)
            if int(state["tick"]) == 20:
                for first in range(2):
                    turn = itertools.islice(itertools.cycle(words), first, None)
                    threading.Thread(target=self.scribble, args=(state, turn), daemon=True).start()

        def scribble(self, state: Record, turn: Iterator[float]) -> None:
            own, others = state["arm.command.wrench"], ("arm.pose", "arm.sent.wrench", "hold", "finger.hip")
            while not stop.is_set():
                own[:3] = next(turn)
                for name in others:
                    try:
                        state[name] = next(turn)
                    except (ValueError, OverflowError):  # is not its own
                        continue

    return Scribbling


@pytest.mark.usefixtures("often")
@pytest.mark.parametrize("words", [WORDS, WORDS[1:3], WORDS[4:]], ids=["no numbers", "too much", "allowed"])
def test_what_threads_write_is_limited_like_all_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[float, ...]
) -> None:
    stop, sent = threading.Event(), Sent(monkeypatch)
    session = engine(tmp_path, scribbling(words, stop), type("Told", (Rod,), {"Twin": RodTwin}))
    tripped = False
    try:
        session.run(0.4)
    except itouch.DeviceFaultError as error:
        tripped = "not" in str(error)
    finally:
        stop.set()
    forces = np.array(sent.forces)
    assert np.isfinite(forces).all()
    sizes = np.linalg.norm(forces, axis=1)
    assert sizes.max() <= 2.0 + 1e-12  # its ceiling
    grown = np.diff(np.concatenate([[0.0], sizes]))
    assert grown.max() <= 1.0 + 1e-9  # 1000 N/s
    if tripped:
        assert any(not math.isfinite(word) for word in words)
        assert session.status("arm").name == "FAULT" and not session.state["arm.sent.wrench"].any()
    else:
        assert sizes[-1] > 0.0 or words == WORDS  # they did write
