"""Lines of text in a picture: what is no longer written is gone, and only what has changed is laid out again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from itouch_tools.viewer import text

INK = (0.0, 0.0, 0.0)


class Label:
    """Stands for a label of Pyglet, which asks for a graphics driver."""

    def __init__(self, words: str, **said: Any) -> None:
        self.text, self.x, self.updates = words, said["x"], 0

    def begin_update(self) -> None:
        self.updates += 1

    def end_update(self) -> None:
        pass


@pytest.fixture
def labels(monkeypatch: pytest.MonkeyPatch) -> list[Label]:
    made = list[Label]()

    def label(words: str, **said: Any) -> Label:
        made.append(Label(words, **said))
        return made[-1]

    stands_for = SimpleNamespace(
        graphics=SimpleNamespace(Batch=lambda: SimpleNamespace(draw=lambda: None)),
        font=SimpleNamespace(have_font=lambda name: True), text=SimpleNamespace(Label=label),
    )  # fmt: skip
    monkeypatch.setattr(text, "pyglet", stands_for)
    return made


def written(lines: text.Text, *said: tuple[str, float]) -> None:
    lines.begin()
    for words, x in said:
        lines.put(words, x, 10.0, INK, size=12.0)
    lines.draw()


@pytest.mark.parametrize("x", [0.0, 30.0])
def test_a_line_that_is_not_written_again_is_gone_wherever_it_stood(x: float, labels: list[Label]) -> None:
    """At the edge of the picture, too, where the name of an object may stand that is half beside it."""
    lines = text.Text()
    written(lines, ("wood", 5.0), ("pyrex", x))
    assert [(label.text, label.x) for label in labels] == [("wood", 5), ("pyrex", x)]
    written(lines, ("wood", 5.0))
    assert [label.text for label in labels] == ["wood", ""]
    written(lines, ("wood", 5.0), ("pyrex", x))
    assert [label.text for label in labels] == ["wood", "pyrex"]
    assert [label.updates for label in labels] == [0, 1]
