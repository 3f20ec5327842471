"""What fails in real time is tried again where the machine was late, and only there; and what always fails has failed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import punctuality
import pytest

LATE = 2.0 * punctuality.LATE


@pytest.mark.parametrize(
    ("after", "during", "fails", "tries", "outcome"),
    [
        (0.0, 0.0, 0, 1, "passed"), (0.0, 0.0, 1, 1, "failed"), (LATE, 0.0, 1, 2, "passed"),
        (LATE, 0.0, 9, 3, "skipped"), (0.0, LATE, 1, 2, "passed"), (0.0, LATE, 9, 3, "failed"),
        (LATE, LATE, 9, 3, "skipped"),
    ],
)  # fmt: skip
def test_it_is_tried_again_where_the_machine_was_late(
    monkeypatch: pytest.MonkeyPatch, after: float, during: float, fails: int, tries: int, outcome: str
) -> None:
    """``after``, ``during``: how long [s] the machine kept a loop waiting after the test, and the test itself."""
    tried = 0

    def run(item: object, log: bool, nextitem: object) -> list[Any]:
        nonlocal tried
        tried += 1
        failed = tried <= fails
        return [SimpleNamespace(outcome="failed" if failed else "passed", failed=failed)]

    def waits() -> Iterator[float]:
        for number in range(100):
            yield number * during

    monkeypatch.setattr(punctuality, "runtestprotocol", run)
    monkeypatch.setattr(punctuality, "kept_waiting", lambda seconds: after)
    monkeypatch.setattr(punctuality, "waited", waits().__next__)
    item: Any = mock.MagicMock(path=Path("test_it.py"))
    punctuality.pytest_runtest_protocol(item, None)
    (told,) = (call.kwargs["report"].outcome for call in item.ihook.pytest_runtest_logreport.call_args_list)
    assert (told, tried) == (outcome, tries)


def test_how_long_it_has_waited_for_a_processor_only_grows() -> None:
    before = punctuality.waited()
    assert 0.0 <= before <= punctuality.waited()
