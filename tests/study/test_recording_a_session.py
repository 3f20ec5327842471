"""One recording a session, while the scene changes from trial to trial; the study is kept as it was frozen."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from run_scene import write_study
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.recording import RecordingError, read
from itouch.world import make_state
from itouch_tools.cli import main
from itouch_tools.study.reading import load_study
from itouch_tools.study.rig_session import each_level_once
from itouch_tools.study.store import Row, Store
from itouch_tools.study.touches import Toucher

ANSWERS = "wood\nsteel\ncork\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, list[Row]]:
    """Two sessions of one participant, recorded: the study, its folder, the rows."""
    folder = tmp_path_factory.mktemp("recorded")
    path, answers, data = write_study(folder, repetitions=1), folder / "answers.txt", folder / "data"
    for lines in (2, 3):
        answers.write_text("\n".join(ANSWERS.split()[:lines]))
        words = ["study", "run", str(path), "-o", str(data), "--participant", "P7", "--answers", str(answers)]
        assert main([*words, "--record"]) == (3 if lines == 2 else 0)
    with Store.open(data) as store:
        return path, data, store.rows("P7")


def test_a_session_is_one_file_that_holds_all_its_trials(made: tuple[Path, Path, list[Row]]) -> None:
    _, data, rows = made
    assert sorted(one.name for one in (data / "recordings").iterdir()) == ["P7-1.mcap", "P7-2.mcap"]
    assert [row.session for row in rows] == ["P7-1", "P7-1", "P7-2"]
    for name in ("P7-1", "P7-2"):
        own = [row for row in rows if row.session == name]
        recording = read(data / "recordings" / f"{name}.mcap")
        assert (np.diff(recording.ticks) == 1).all()  # no tick of any trial is missing
        assert recording.ticks[-1] + 1 >= round(own[-1].ended_s / recording.period)
        begun = {mark["payload"]: mark["time"] for mark in recording.marks if mark["name"] == "trial"}
        assert [f'{{"place":{row.place}}}' in begun for row in own] == [True] * len(own)
        for row in own:
            touched = [event["time"] for event in recording.events if event["kind"] == "BEGIN"]
            assert any(row.begun_s <= time <= row.ended_s for time in touched)


def test_its_forces_are_those_of_the_rows(made: tuple[Path, Path, list[Row]]) -> None:
    """After the scene has changed it is the State of the new one that is recorded."""
    _, data, rows = made
    recording = read(data / "recordings" / "P7-1.mcap")
    forces = np.linalg.norm(np.asarray(recording["finger.force"]), axis=1)
    times = np.asarray(recording.ticks) * recording.period
    for row in rows[:2]:
        during = forces[(times >= row.begun_s) & (times <= row.ended_s)]
        assert during.max() == pytest.approx(row.felt[0]["peak_force_N"], abs=0.02)


def test_nobody_is_told_a_condition_by_a_name_and_a_replay_is_refused(made: tuple[Path, Path, list[Row]]) -> None:
    _, data, _ = made
    names = [str(path.relative_to(data)) for path in data.rglob("*")]
    assert not any(word in name for name in names for word in ("wood", "steel", "cork"))
    with pytest.raises(RecordingError, match="its scene changed from trial to trial"):
        itouch.replay(data / "recordings" / "P7-1.mcap")


def test_the_study_is_kept_as_it_was_frozen(made: tuple[Path, Path, list[Row]]) -> None:
    path, data, _ = made
    (kept,) = (data / "frozen").iterdir()
    with Store.open(data) as store:
        frozen = store.frozen()
    assert frozen is not None
    assert kept.name == f"{frozen['digest'][:12]}.zip"
    with zipfile.ZipFile(kept) as archive:
        assert archive.read("study.xml") == path.read_bytes()
        assert archive.read("scene/scene.xml") == (path.parent / "scene.xml").read_bytes()


@pytest.mark.parametrize("study", ["four_materials", "flux_threshold", "metamers"])
def test_all_materials_have_the_same_state_so_that_hardware_can_be_recorded(study: str) -> None:
    """State had as many numbers as the modes of the object that was touched: hardware needed --no-record."""
    catalog = Catalog()
    file = load_study(SCENES / "studies" / f"{study}.xml", catalog)
    models = [Toucher(file, catalog).model(condition) for condition in each_level_once(file)]
    assert len(models) > 1 and len({len(model.modalities) for model in models}) == 1
    assert len({make_state(model).dtype for model in models}) == 1
