"""One recording a session, while the scene changes from trial to trial; the study is kept as it was frozen."""

from __future__ import annotations

import os
import signal
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import third_party_plugins
from run_scene import write_study
from shipped import SCENES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.recording import RecordingError, read
from itouch.world import make_state
from itouch_tools.cli import main
from itouch_tools.study import scene_switching
from itouch_tools.study.reading import load_study
from itouch_tools.study.rig_session import each_level_once
from itouch_tools.study.scene_switching import SceneSwitcher
from itouch_tools.study.study_store import Row, Store
from itouch_tools.study.touches import TouchRunner

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


def test_no_two_sessions_have_one_name(tmp_path: Path) -> None:
    """A session without a recording took the name of a recording that holds another, which ended before a trial."""
    path, answers, data = write_study(tmp_path, repetitions=1), tmp_path / "answers.txt", tmp_path / "data"
    words = ["study", "run", str(path), "-o", str(data), "--participant", "P7", "--answers", str(answers)]
    for lines, more in ((0, "--record"), (1, "--no-record"), (2, "--record"), (3, "--no-record")):
        answers.write_text("\n".join(ANSWERS.split()[:lines]))
        assert main([*words, more]) == (3 if lines < 3 else 0)
        if lines == 1:
            (data / "recordings" / "P7-1.mcap").unlink()
    with Store.open(data) as store:
        assert [row.session for row in store.rows("P7")] == ["P7-2", "P7-3", "P7-4"]
    assert [one.name for one in (data / "recordings").iterdir()] == ["P7-3.mcap"]


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
    models = [TouchRunner(file, catalog).model(condition) for condition in each_level_once(file)]
    assert len(models) > 1 and len({len(model.modalities) for model in models}) == 1
    assert len({make_state(model).dtype for model in models}) == 1


KEEPS = """
from dataclasses import dataclass

from itouch.plugin import Field, Modality, schema


@dataclass(frozen=True)
class KeepsParams:
    kept: int = schema.integer(low=1, high=9, default=1, doc="numbers in State")


class Keeps(Modality):
    Params = KeepsParams

    def compile(self, name, params, world):
        self.kept = params.kept
        return name

    def fields(self, model):
        return (Field("kept", size=self.kept, unit="1", doc="nothing, in so many numbers"),)

    def reset(self, model, state):
        pass

    def update(self, model, state, period):
        pass
"""


@pytest.fixture
def switcher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SceneSwitcher]:
    """The scene switcher of a study of which each condition has other fields of State."""
    listed = "[itouch.modalities]\nkeeper.keeps = keeper:Keeps\n"
    monkeypatch.syspath_prepend(str(third_party_plugins.install(tmp_path / "site", "keeper", listed, code=KEEPS)))
    path = write_study(tmp_path)
    scene = tmp_path / "scene.xml"
    scene.write_text(
        scene.read_text()
        .replace("<itouch ", '<itouch xmlns:keeper="urn:itouch:plugin:keeper" ')
        .replace("  </interaction>", "    <keeper:keeps/>\n  </interaction>")
    )
    factor = '<factor name="kept" levels="few many" values="1;9" set="keeps.kept"/>'
    path.write_text(path.read_text().replace("  <task", f"  {factor}\n  <task"))
    made = SceneSwitcher(load_study(path, Catalog()), Catalog(), seed=5, record=tmp_path / "P1-1.mcap")
    yield made
    made.close()
    assert [len(read(file).losses) for file in tmp_path.glob("*.mcap")] == [0] * len(list(tmp_path.glob("*.mcap")))


def touch(switcher: SceneSwitcher, kept: str) -> tuple[int, int]:
    """Touch the block once in a condition, and return the first and the last tick."""
    switcher.present({"material": "wood", "kept": kept})
    first = switcher.session.ticks
    switcher.go()
    switcher.run(lambda: switcher.session.done)
    return first, switcher.session.ticks - 1


def test_scenes_whose_states_have_other_fields_share_a_recording(tmp_path: Path, switcher: SceneSwitcher) -> None:
    """Each change of State began a file, a hundred of them in a session; hardware refused to be recorded."""
    spans = {name: list[tuple[int, int]]() for name in ("few", "many")}
    for kept in ("few", "many", "many", "few", "many"):
        spans[kept].append(touch(switcher, kept))
    switcher.close()
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == ["P1-1.2.mcap", "P1-1.mcap"]
    for name, kept in (("P1-1", "few"), ("P1-1.2", "many")):
        recording = read(tmp_path / f"{name}.mcap")
        assert recording.whole and recording.lost == 0
        ticks = recording.ticks
        for first, last in spans[kept]:
            assert np.array_equal(ticks[(ticks >= first) & (ticks <= last)], np.arange(first, last + 1))
        for first, last in spans["many" if kept == "few" else "few"]:
            assert not ((ticks >= first) & (ticks <= last)).any()
        assert sum(event["kind"] == "BEGIN" for event in recording.events) == len(spans[kept])
        with pytest.raises(RecordingError, match="its scene changed from trial to trial"):
            itouch.replay(tmp_path / f"{name}.mcap")


def test_few_recordings_are_open_at_a_time(
    tmp_path: Path, switcher: SceneSwitcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has a process and its memory; what is needed again after its end begins another file."""
    monkeypatch.setattr(scene_switching, "OPEN", 1)
    spans = [touch(switcher, kept) for kept in ("few", "many", "few")]
    switcher.close()
    names = ("P1-1", "P1-1.2", "P1-1.3")
    assert sorted(path.stem for path in tmp_path.glob("*.mcap")) == sorted(names)
    for name, (first, last) in zip(names, spans, strict=True):
        recording = read(tmp_path / f"{name}.mcap")
        assert recording.whole
        assert {first, last} <= set(recording.ticks.tolist())


def test_samples_that_are_lost_between_two_scenes_are_told(tmp_path: Path, switcher: SceneSwitcher) -> None:
    """Ticks in another file are not lost; those after another scene has begun are."""
    touch(switcher, "few")
    touch(switcher, "many")
    switcher.present({"material": "wood", "kept": "few"})
    recorder = switcher.session.recorder
    assert recorder is not None
    switcher.session.taps.remove(recorder.tap)
    switcher.session.run(0.005)
    switcher.session.taps.append(recorder.tap)
    switcher.session.run(0.005)
    switcher.close()
    recording = read(tmp_path / "P1-1.mcap")
    assert recording.lost == 5 and "5 samples were lost while recording" in recording.losses
    (tmp_path / "P1-1.mcap").unlink()


def test_a_recording_of_which_no_session_goes_on_is_ended_with_the_others(
    tmp_path: Path, switcher: SceneSwitcher
) -> None:
    """Also where its writing process has died meanwhile, which is told when a session goes on in it."""
    touch(switcher, "few")
    recorder = switcher.session.recorder
    assert recorder is not None
    touch(switcher, "many")
    os.kill(recorder.process_id, signal.SIGKILL)
    touch(switcher, "few")
    assert ["the writing process died" in loss for loss in switcher.losses] == [True]
    touch(switcher, "many")
    assert switcher.session.recorder is None  # what can't be recorded whole is not recorded in parts
    switcher.close()
    assert read(tmp_path / "P1-1.2.mcap").whole
    (tmp_path / "P1-1.mcap").unlink()
