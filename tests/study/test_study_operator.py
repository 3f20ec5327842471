"""The operator of a session: what is seen tells no condition; pause, notes and stop do what they say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from run_scene import write_study

from itouch.plugin.discovery import Catalog
from itouch_tools.study.answer_sources import Script, Stopped
from itouch_tools.study.participant_session import Run
from itouch_tools.study.reading import load_study
from itouch_tools.study.session_display import Shown
from itouch_tools.study.study_store import Store

CATALOG = Catalog()


class Looks:
    """An operator who pauses before the second trial for a while, writes a note, and stops after the third."""

    def __init__(self, stops: int = 99) -> None:
        self.paused = self.stopped = self.held = False
        self.faces: list[tuple[str, int, int, tuple[tuple[str, bool], ...]]] = []
        self._stops, self._rested, self._written = stops, 0, False

    def show(self, face: Shown, lines: Sequence[tuple[str, bool]]) -> None:
        self.faces.append((face.cue, face.trial, face.void, tuple(lines)))
        if face.trial == 2 and face.cue == "pause" and not self._rested:
            self.paused = True
        if face.cue == "break":
            self._rested += 1
            self.paused = self._rested < 5
        self.stopped = face.trial > self._stops

    def notes(self) -> list[str]:
        written, self._written = self._written, True
        return [] if written else ["the door\tslammed\n"]


def session(folder: Path, operator: Looks, material: str = "") -> list[tuple[int, float]]:
    path = write_study(folder, repetitions=2)
    if material:
        text = path.read_text().replace(
            'set="block.material"', f'set="block.material" values="{";".join([material] * 3)}"'
        )
        path.write_text(text)
    made = []
    with Store.open(folder, create=True) as store:
        run = Run(load_study(path, CATALOG), "P1", store, Script(["steel"] * 9), CATALOG, operator=operator)
        for row in run.trials():
            made.append((row.place, row.begun_s))
    return made


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Looks, list[tuple[int, float]]]:
    folder, operator = tmp_path_factory.mktemp("operated"), Looks()
    return folder, operator, session(folder, operator)


def test_a_pause_is_before_the_next_trial_and_ends(whole: tuple[Path, Looks, list[tuple[int, float]]]) -> None:
    folder, operator, made = whole
    assert [place for place, _ in made] == list(range(6))
    begun = [seconds for _, seconds in made]
    waits = [later - sooner for sooner, later in zip(begun, begun[1:], strict=False)]
    assert waits[0] > waits[1] + 0.1  # five pictures, thirty a second
    assert max(waits[1:]) < min(waits[1:]) + 0.05
    assert operator.faces[-1][0] == "done"
    (line,) = (folder / "notes.tsv").read_text().splitlines()
    assert line.split("\t")[1:] == ["P1", "1", "the door slammed"]


def test_stop_ends_after_a_whole_trial(tmp_path: Path) -> None:
    operator = Looks(stops=3)
    with pytest.raises(Stopped):
        session(tmp_path, operator)
    with Store.open(tmp_path) as store:
        assert [row.place for row in store.rows("P1")] == [0, 1, 2]


def test_nothing_that_is_seen_tells_what_is_touched(tmp_path: Path) -> None:
    seen = []
    for material in ("wood", "steel"):
        operator = Looks()
        session(tmp_path / material, operator, material)
        seen.append(list(dict.fromkeys(operator.faces)))
    assert seen[0] == seen[1]
    assert ("arm: enabled", True) in seen[0][0][3]
    assert not any(word in repr(seen) for word in ("wood", "steel", "cork"))


def test_a_note_that_cannot_be_kept_ends_no_session(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On twins an error of the disk ended the session with a traceback, and the trial under way was lost."""
    (tmp_path / "notes.tsv").mkdir(parents=True)
    made = session(tmp_path, Looks())
    assert [place for place, _ in made] == list(range(6))
    assert "the note 'the door\tslammed\n' can't be kept: Is a directory" in capsys.readouterr().err
