"""What the desk of a study on hardware passes on to its session: each answer once, until it is asked again."""

from __future__ import annotations

import queue
from types import SimpleNamespace
from typing import Any

import pytest

from itouch_tools.study import rig_windows


class Participant:
    """One who has something to say each time somebody looks."""

    def __init__(self, *says: str | None) -> None:
        self.says, self.asked, self.told = list(says), list[str](), list[str]()

    def ask(self, question: Any) -> None:
        self.asked.append(question.place)

    def tell(self, words: str) -> None:
        self.told.append(words)

    def poll(self, elapsed: float) -> str | None:
        return self.says.pop(0) if self.says else None


def test_an_answer_is_passed_on_once_and_another_one_only_if_it_was_not_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rig_windows, "DeadMansSwitch", lambda link: SimpleNamespace(hold=lambda held: None))
    handle: Any = SimpleNamespace(link=None, others=queue.Queue())
    participant, passed = Participant(None, "warm", "cold", "7"), list[tuple[str, dict[str, Any]]]()
    desk = rig_windows.RigWindows(handle, participant)  # type: ignore[arg-type]
    monkeypatch.setattr(desk, "_pass_on", lambda kind, content: passed.append((kind, content)))

    def turns(count: int, *messages: dict[str, Any]) -> list[Any]:
        for message in messages:
            handle.others.put(message)
        found = list(desk._listen())
        for _ in range(count):
            desk._turn()
        return found

    assert turns(2) == [] and passed == [], "nobody was asked"
    ask = {"kind": "ask", "place": 3, "words": "warmer?", "choices": ["warm", "cold"]}
    assert turns(4, ask, {"kind": "trial", "number": 3}) == [{"kind": "trial", "number": 3}]
    assert (participant.asked, passed) == ([3], [("answer", {"place": 3, "answer": "warm"})])
    turns(3, {"kind": "tell", "words": "one of: hot, cold"})
    assert participant.told == ["one of: hot, cold"]
    assert passed[1:] == [("answer", {"place": 3, "answer": "cold"})]
    turns(3, {**ask, "place": 4})
    assert passed[2:] == [("answer", {"place": 4, "answer": "7"})]
    turns(1, {"kind": "stopped"})
    assert desk.stopped
