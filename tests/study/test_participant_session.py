"""A participant's session: through the command, from a script, killed at any instant."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import campaign
import pytest
from run_scene import write_study
from shipped import SCENES

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.study.analysis import analyse
from itouch_tools.study.answer_sources import AnswerError, Question, Script, Stopped
from itouch_tools.study.frozen import digest_of
from itouch_tools.study.participant_session import Run
from itouch_tools.study.progression import Course
from itouch_tools.study.reading import load_study
from itouch_tools.study.session_display import Shown
from itouch_tools.study.study_elements import Task
from itouch_tools.study.study_page import page
from itouch_tools.study.study_store import Row, Store
from itouch_tools.study.tasks import is_right, taken_answer
from itouch_tools.study.trials import Trial

CATALOG = Catalog()
ANSWERS = ["wood 0.31", "steel", "cork 0.2  # said slowly", "2", "steel 0.05"]


def scripted(folder: Path, count: int = 60) -> Path:
    path = folder / "answers.txt"
    path.write_text("\n".join((ANSWERS * count)[:count]) + "\n")
    return path


def kept(folder: Path, code: str | None = None) -> list[Row]:
    """Return the rows without what is the host's clock and the number of the session."""
    with Store.open(folder) as store:
        return [replace(row, ended_at="", session="") for row in store.rows(code)]


def run(path: Path, folder: Path, *more: str, code: str = "P07") -> int:
    return main(["study", "run", str(path), "-o", str(folder), "--participant", code, *more])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, list[Row]]:
    """A study that was run from the first to the last trial without a stop: its file, answers, and rows."""
    folder = tmp_path_factory.mktemp("whole")
    path = write_study(folder, more='<practice trials="2"/><breaks every="5" duration="0.2 s"/>')
    answers = scripted(folder)
    assert run(path, folder / "data", "--answers", str(answers)) == 0
    return path, answers, kept(folder / "data")


def test_a_session_keeps_every_trial(whole: tuple[Path, Path, list[Row]]) -> None:
    path, _, rows = whole
    file = load_study(path, CATALOG)
    planned = Course(file, "P07").planned
    assert [row.condition for row in rows] == [trial.condition for trial in planned]
    assert [row.place for row in rows] == list(range(11))
    assert Counter(row.condition["material"] for row in rows if row.block != "practice") == dict.fromkeys(
        ("wood", "steel", "cork"), 3
    )
    assert [row.answer for row in rows[:5]] == ["wood", "steel", "cork", "steel", "steel"]
    assert [row.right for row in rows] == [int(row.answer == row.condition["material"]) for row in rows]
    assert rows[0].reaction_s == pytest.approx(0.31, abs=0.002)  # on the servo's clock
    assert all(row.ended_s > row.begun_s for row in rows)
    assert all(a.ended_s <= b.begun_s for a, b in zip(rows, rows[1:], strict=False))
    assert rows[5].begun_s - rows[4].ended_s == pytest.approx(0.2, abs=0.005)  # the break
    assert all(0.3 < row.felt[0]["peak_force_N"] < 2.0 for row in rows)
    # the scene changed between trials, under the same arm
    forces = {row.condition["material"]: row.felt[0]["peak_force_N"] for row in rows}
    assert forces["steel"] > forces["cork"]


def test_a_session_that_is_stopped_goes_on_to_the_same_rows(
    whole: tuple[Path, Path, list[Row]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, answers, rows = whole
    lines = answers.read_text().splitlines()
    for end in (1, 4, 5, 9):
        (tmp_path / "some.txt").write_text("\n".join(lines[:end]) + "\n")
        assert run(path, tmp_path / "data", "--answers", str(tmp_path / "some.txt")) == 3
        told = capsys.readouterr().out
        assert f"(the script has {end} answer{'s' * (end > 1)}, and line {end + 1} would be that of this trial)" in told
        assert "the same command goes on from here" in told
        assert kept(tmp_path / "data") == rows[:end]
    assert run(path, tmp_path / "data", "--answers", str(answers)) == 0
    assert kept(tmp_path / "data") == rows
    assert run(path, tmp_path / "data", "--answers", str(answers)) == 0  # nothing is left, nothing is made
    assert "0 new trials" in capsys.readouterr().out
    assert kept(tmp_path / "data") == rows


_KILLED = """
import os, signal, sys
from itouch_tools.cli import main
from itouch_tools.study.study_store import Store
when, number, argv = sys.argv[1], int(sys.argv[2]), sys.argv[3:]
made = 0
add = Store.add
def killing(self, row, standing=None):
    global made
    made += 1
    if when == "before" and made == number:
        os.kill(os.getpid(), signal.SIGKILL)
    if when == "within" and made == number:
        self._trials.set_trace_callback(lambda words: os.kill(os.getpid(), signal.SIGKILL) if "standing" in words else None)
    add(self, row, standing)
    if when == "after" and made == number:
        os.kill(os.getpid(), signal.SIGKILL)
Store.add = killing
sys.exit(main(argv))
"""


def killed(path: Path, folder: Path, answers: Path, when: str, number: int) -> int:
    argv = ["study", "run", str(path), "-o", str(folder), "--participant", "P07", "--answers", str(answers)]
    command = [sys.executable, "-c", _KILLED, when, str(number), *argv]
    return subprocess.run(command, capture_output=True, check=False, timeout=600).returncode


def test_killed_at_a_write_nothing_is_lost_or_doubled(whole: tuple[Path, Path, list[Row]], tmp_path: Path) -> None:
    path, answers, rows = whole
    made = 0
    for when, number, gains in (("before", 2, 1), ("within", 3, 2), ("after", 2, 2)):
        assert killed(path, tmp_path, answers, when, number) == -signal.SIGKILL
        made += gains
        assert kept(tmp_path) == rows[:made], when
    assert run(path, tmp_path, "--answers", str(answers)) == 0
    assert kept(tmp_path) == rows


@pytest.mark.long
def test_killed_at_500_random_instants_and_at_each_write(whole: tuple[Path, Path, list[Row]], tmp_path: Path) -> None:
    path, answers, rows = whole
    for index, _ in enumerate(rows):
        for when in ("before", "within", "after"):
            folder = tmp_path / f"{when}{index}"
            assert killed(path, folder, answers, when, index + 1) == -signal.SIGKILL
            assert run(path, folder, "--answers", str(answers)) == 0
            assert kept(folder) == rows
    rng, kills = random.Random(500), 0
    argv = [sys.executable, "-m", "itouch_tools.cli", "study", "run", str(path), "--participant", "P07", "--answers",
            str(answers), "-o"]  # fmt: skip
    begin = time.monotonic()
    subprocess.run([*argv, str(tmp_path / "timed")], capture_output=True, check=True)
    lasts, turn = time.monotonic() - begin, 0
    while kills < 500:
        folder = tmp_path / f"random{turn}"
        turn += 1
        for _ in range(200):
            process = subprocess.Popen([*argv, str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(rng.uniform(0.0, lasts))
            ended = process.poll() is not None
            if not ended:
                os.kill(process.pid, signal.SIGKILL)
                kills += 1
            process.wait()
            there = kept(folder) if (folder / "trials.sqlite").exists() else []
            assert there == rows[: len(there)]
            if ended:
                break
        assert run(path, folder, "--answers", str(answers)) == 0
        assert kept(folder) == rows


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("DELETE FROM trials WHERE place = 1", "trial 2 of P07 is missing in the data"),
        ("UPDATE standing SET state = x'00'", "the State after trial 4 is damaged"),
    ],
)
def test_data_that_another_program_has_changed_are_refused_before_a_trial(
    whole: tuple[Path, Path, list[Row]], tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str, told: str
) -> None:
    """Without a row that was deleted a whole trial was run, which could not be kept as its place was taken."""
    path, answers, _ = whole
    (tmp_path / "four.txt").write_text("\n".join(answers.read_text().splitlines()[:4]))
    assert run(path, tmp_path / "data", "--answers", str(tmp_path / "four.txt")) == 3
    with contextlib.closing(sqlite3.connect(tmp_path / "data" / "trials.sqlite")) as connection, connection:
        connection.execute(change)
    before = kept(tmp_path / "data")
    assert run(path, tmp_path / "data", "--answers", str(answers)) == 2
    assert told in capsys.readouterr().err
    assert kept(tmp_path / "data") == before


def test_a_staircase_is_rebuilt_from_its_rows(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    text = path.read_text().replace(
        '<factor name="material" levels="wood steel cork" set="block.material"/>',
        '<staircase name="hard" procedure="up-down" set="wood/contact.stiffness" unit="N/mm" low="0.5" high="2" '
        'start="1.5" standard="0.6" step="0.1" trials="5"/>',
    ).replace('kind="identify" factor="material"', 'kind="colder" factor="hard" standard="0.6"')  # fmt: skip
    path.write_text(text)
    (tmp_path / "all.txt").write_text("\n".join(["1", "2", "1", "1", "2"] * 4))
    assert run(path, tmp_path / "a", "--answers", str(tmp_path / "all.txt")) == 0
    rows = kept(tmp_path / "a")
    assert len(rows) == 5
    assert len({row.level for row in rows}) > 2
    for end in range(1, 6):
        (tmp_path / "some.txt").write_text("\n".join((["1", "2", "1", "1", "2"] * 4)[:end]))
        assert run(path, tmp_path / "b", "--answers", str(tmp_path / "some.txt")) in (0, 3)
        assert kept(tmp_path / "b") == rows[:end]


def test_a_staircase_without_heat_goes_by_the_levels(tmp_path: Path) -> None:
    """Nothing feels heat in this scene: which was colder is not known, and must not be taken from fluxes of 0."""
    path = write_study(tmp_path)
    stairs = '<staircase name="hard" procedure="up-down" set="wood/contact.stiffness" unit="N/mm" low="0.5" high="2" '
    stairs += 'start="1.5" standard="0.6" step="0.1" trials="12"/>'
    text = path.read_text().replace(
        '<factor name="material" levels="wood steel cork" set="block.material"/>', stairs
    ).replace('kind="identify" factor="material"', 'kind="colder" factor="hard" standard="0.6"')  # fmt: skip
    path.write_text(text)
    (tmp_path / "a.txt").write_text("1\n" * 12)
    assert run(path, tmp_path / "a", "--answers", str(tmp_path / "a.txt")) == 0
    rows = kept(tmp_path / "a")
    assert all(row.felt[0]["mean_flux_W_m2"] is None for row in rows)
    levels = [[float(one["hard"]) for one in row.shown] for row in rows]
    assert [row.right for row in rows] == [int(first > second) for first, second in levels]
    assert {row.right for row in rows} == {0, 1}


def test_without_heat_and_levels_nothing_was_colder(tmp_path: Path) -> None:
    path = write_study(tmp_path, repetitions=1)
    task = 'kind="colder" factor="material" standard="wood"'
    path.write_text(path.read_text().replace('kind="identify" factor="material"', task))
    (tmp_path / "a.txt").write_text("1\n" * 3)
    assert run(path, tmp_path / "a", "--answers", str(tmp_path / "a.txt")) == 0
    rows = kept(tmp_path / "a")
    assert [row.right for row in rows] == [None] * 3
    assert page(analyse(load_study(path, CATALOG), rows, draws=20), {})


def test_of_equal_levels_the_answer_is_at_chance() -> None:
    task = Task(kind="colder", factor="hard", standard="0.6")
    trial = Trial(0, "main", {}, ({"hard": "0.6"}, {"hard": "0.6"}), 1, "hard")
    assert [is_right(task, trial, answer, [None, None]) for answer in "01"] == [0, 1]
    below = replace(trial, shown=({"hard": "0.6"}, {"hard": "0.5"}))
    assert [is_right(task, below, answer, [None, None]) for answer in "01"] == [1, 0]
    assert [is_right(task, below, answer, [900.0, 950.0]) for answer in "01"] == [0, 1]  # heat is known: it decides


def test_a_void_trial_is_marked_and_comes_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_study(tmp_path, repetitions=1, contact='force="5 N" repeats="2"')
    assert run(path, tmp_path / "data", "--answers", str(scripted(tmp_path))) == 0
    rows = kept(tmp_path / "data")
    assert all("was out of the window" in row.void for row in rows)
    assert all(row.answer is None for row in rows)
    assert Counter(row.repeats if row.repeats is not None else row.place for row in rows) == {0: 3, 1: 3, 2: 3}
    said = capsys.readouterr().out
    assert f"trial 1: void ({rows[0].void}), comes again\n" in said
    assert f"trial 9: void ({rows[8].void}), not repeated any more\n" in said


def test_deviations_are_refused_or_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, answers = write_study(tmp_path, repetitions=1), scripted(tmp_path, 1)
    folder = tmp_path / "data"
    assert run(path, folder, "--answers", str(answers)) == 3
    scene = tmp_path / "scene.xml"
    scene.write_text(scene.read_text().replace("0.6 N/mm", "0.7 N/mm"))
    assert run(path, folder, "--answers", str(answers)) == 2
    assert "this one differs" in capsys.readouterr().err
    assert run(path, folder, "--answers", str(answers), "--deviation", "cork was replaced") == 3
    assert run(path, folder, "--answers", str(answers)) == 3  # it stands now
    assert main(["study", "report", str(path), str(folder)]) == 0
    assert "cork was replaced" in (folder / "report.html").read_text()
    path.write_text(path.read_text().replace('seed="5"', 'seed="6"'))
    assert run(path, folder, "--answers", str(answers), "--deviation", "another seed") == 2
    assert "other orders need another folder" in capsys.readouterr().err


def test_the_instructions_are_frozen_with_the_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = write_study(tmp_path, more='<instructions file="lies mich.md"/>'), tmp_path / "data"
    words = tmp_path / "lies mich.md"
    words.write_text("Press as hard as you like.")
    assert main(["study", "freeze", str(path), str(folder)]) == 0
    (kept_copy,) = (folder / "frozen").iterdir()
    with zipfile.ZipFile(kept_copy) as archive:
        assert archive.read("instructions/lies mich.md") == words.read_bytes()
    words.write_text("Hardly press.")
    assert main(["study", "freeze", str(path), str(folder)]) == 2
    assert "this one differs" in capsys.readouterr().err
    words.write_text("Press as hard as you like.")
    assert main(["study", "freeze", str(path), str(folder)]) == 0


def test_data_that_were_frozen_without_their_instructions_go_on(tmp_path: Path) -> None:
    path, folder = write_study(tmp_path, more='<instructions file="read.md"/>'), tmp_path / "data"
    (tmp_path / "read.md").write_text("Press.")
    file = load_study(path, CATALOG)
    folder.mkdir()
    with Store.open(folder, create=True) as store:
        store.freeze(name="s", seed=5, digest=digest_of(file, earlier=True), program="0.1.0", frozen="2026-01-01")
    assert digest_of(file) != digest_of(file, earlier=True)
    assert main(["study", "freeze", str(path), str(folder)]) == 0
    assert main(["study", "report", str(path), str(folder)]) == 0


def test_files_that_the_scene_names_at_any_level_are_frozen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = write_study(tmp_path, repetitions=1), tmp_path / "data"
    for name in "ab":
        shutil.copy(SCENES / "meshes/pebble.stl", tmp_path / f"{name}.stl")
    scene = tmp_path / "scene.xml"
    mesh = '<mesh name="stone" file="a.stl" scale="1 mm" pos="200 0 11 mm" material="wood"/></world>'
    scene.write_text(scene.read_text().replace("</world>", mesh))
    more = '<factor name="mesh" levels="a.stl;b.stl" set="stone.file"/>'
    path.write_text(path.read_text().replace("  <task", f"  {more}\n  <task"))
    assert main(["study", "freeze", str(path), str(folder)]) == 0
    (kept_copy,) = (folder / "frozen").iterdir()
    with zipfile.ZipFile(kept_copy) as archive:
        assert archive.read("scene/b.stl") == (tmp_path / "b.stl").read_bytes()
    turned = bytearray((tmp_path / "b.stl").read_bytes())
    turned[0] ^= 1  # in the head, which says nothing of the shape
    (tmp_path / "b.stl").write_bytes(turned)
    assert main(["study", "freeze", str(path), str(folder)]) == 2
    assert "this one differs" in capsys.readouterr().err


def test_a_scene_that_is_a_link_is_frozen(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir()
    path = write_study(tmp_path / "study")
    scene = tmp_path / "study/scene.xml"
    shared = scene.rename(tmp_path / "shared/any.xml")
    scene.symlink_to(shared)
    before = digest_of(load_study(path, CATALOG))
    shared.write_text(shared.read_text().replace("0.15 s", "0.16 s"))
    assert digest_of(load_study(path, CATALOG)) != before


def test_a_report_is_refused_of_data_of_another_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `study run` refuses to go on with them; the report that is there stays as it is."""
    path, folder = write_study(tmp_path, repetitions=1), tmp_path / "data"
    assert run(path, folder, "--answers", str(scripted(tmp_path, 1))) == 3
    assert main(["study", "report", str(path), str(folder)]) == 0
    before = (folder / "report.html").read_bytes()
    written = path.read_text()
    changes = [
        ('kind="identify"', 'kind="rate"', "P07 was asked 'identify', and the task of 'study' is 'rate'"),
        ('seed="5"', 'seed="6"', "this one differs: it has seed 6"),
        ("<order", "<!-- a note --><order", "this one differs; change the files back (frozen/"),
    ]
    for old, new, said in changes:
        path.write_text(written.replace(old, new))
        capsys.readouterr()
        assert main(["study", "report", str(path), str(folder)]) == 2
        assert said in capsys.readouterr().err
        assert (folder / "report.html").read_bytes() == before
    path.write_text(written.replace('kind="identify"', 'kind="rate"'))
    assert run(path, folder, "--answers", str(scripted(tmp_path, 1)), "--deviation", "ratings are finer") == 2


def test_who_is_not_there_cannot_be_forgotten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mistyped code must not look as if the personal data of somebody were deleted."""
    with Store.open(tmp_path, create=True) as store:
        store.describe("P08", {"handedness": "left"})
    assert main(["study", "forget", str(tmp_path), "--participant", "P80"]) == 2
    assert "knows no participant 'P80', nothing was deleted: the participants are P08" in capsys.readouterr().err
    assert main(["study", "forget", str(tmp_path), "--participant", "P08"]) == 0


def test_a_person_is_forgotten_by_one_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = write_study(tmp_path, repetitions=1), tmp_path / "data"
    assert run(path, folder, "--answers", str(scripted(tmp_path, 2))) == 3
    with Store.open(folder) as store:
        store.describe("P07", {"handedness": "left-handed-for-sure"})
    assert main(["study", "report", str(path), str(folder)]) == 0
    before = json.loads((folder / "report.json").read_text())
    assert main(["study", "forget", str(folder), "--participant", "P07"]) == 0
    assert "are deleted" in capsys.readouterr().out
    assert not any(b"left-handed-for-sure" in each.read_bytes() for each in folder.rglob("*") if each.is_file())
    assert main(["study", "report", str(path), str(folder)]) == 0
    assert json.loads((folder / "report.json").read_text()) == before
    assert main(["study", "forget", str(tmp_path / "none"), "--participant", "P07"]) == 2


def test_the_recordings_of_a_person_go_only_if_they_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = write_study(tmp_path, repetitions=1), tmp_path / "data"
    assert run(path, folder, "--answers", str(scripted(tmp_path, 2)), "--record") == 3
    # a session's further file, where State has other fields, has a name that no session of another participant can have
    (folder / "recordings" / "P07-1.2.mcap").write_bytes(b"of the same session")
    others = [folder / "recordings" / name for name in ("P07-1-1.mcap", "P071-1.mcap", "AP07-1.mcap")]
    for other in others:
        other.write_bytes(b"another's")
    assert main(["study", "report", str(path), str(folder)]) == 0
    before = json.loads((folder / "report.json").read_text())
    forget = ["study", "forget", str(folder), "--participant", "P07"]
    assert main(forget) == 0
    assert "2 recordings of the sessions: kept" in capsys.readouterr().out
    assert (folder / "recordings" / "P07-1.mcap").exists()
    assert main([*forget, "--recordings"]) == 0
    assert "2 recordings of the sessions: deleted, too" in capsys.readouterr().out
    assert sorted((folder / "recordings").iterdir()) == sorted(others)
    assert main([*forget, "--recordings"]) == 0
    assert "recording" not in capsys.readouterr().out.replace("personal data", "")
    assert main(["study", "report", str(path), str(folder)]) == 0
    assert json.loads((folder / "report.json").read_text()) == before


def test_a_disk_that_recordings_have_filled_is_emptied_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """SQLite opens nothing for writing on a full disk: the data could not be exported, nor the recordings deleted."""
    path, folder = write_study(tmp_path, repetitions=1), tmp_path / "data"
    assert run(path, folder, "--answers", str(scripted(tmp_path, 2)), "--record") == 3
    recording = folder / "recordings" / "P07-1.mcap"
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0 if recording.exists() else 1 << 30))
    os.utime(folder, (0, 0))
    assert main(["study", "export", str(folder), "--tsv", str(tmp_path / "t.tsv")]) == 0
    assert folder.stat().st_mtime == 0.0, "a file was made on the full disk"
    assert run(path, folder, "--answers", str(scripted(tmp_path))) == 2
    assert "the disk is full" in capsys.readouterr().err
    assert main(["study", "forget", str(folder), "--participant", "P07", "--recordings"]) == 0
    assert not recording.exists()
    assert run(path, folder, "--answers", str(scripted(tmp_path))) == 0


@pytest.mark.parametrize("code", ["", "../P07", "P 07", "x" * 33, "P07\n"])
def test_a_participants_code_of_other_characters_is_refused(
    tmp_path: Path, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(write_study(tmp_path), tmp_path / "data", code=code) == 2
    assert "a code has letters, digits" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_what_is_shown_never_says_the_condition(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two orders of conditions, one and the same picture for picture: only the answers' choices name materials."""
    shown: dict[str, list[Shown]] = {}
    for material in ("wood", "cork"):
        folder = tmp_path / material
        path = write_study(folder, repetitions=1)
        path.write_text(path.read_text().replace('set="block.material"', f'set="block.material" values="{material};{material};{material}"'))  # fmt: skip
        file = load_study(path, CATALOG)
        faces: list[Shown] = shown.setdefault(material, [])
        with Store.open(folder, create=True) as store:
            list(Run(file, "P1", store, Script(["steel"] * 9), CATALOG, show=faces.append).trials())
    said = [[(face.cue, face.question, face.choices, face.trial, face.void) for face in faces] for faces in shown.values()]  # fmt: skip
    once = [list(dict.fromkeys(faces)) for faces in said]
    assert once[0] == once[1]
    assert {face[0] for face in once[0]} >= {"approach", "contact", "answer", "done"}
    out = capsys.readouterr().out
    assert not any(name in out for name in ("wood", "cork", "steel"))


def test_a_typed_answer(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path), CATALOG).study
    assert taken_answer(study, " Wood ") == "wood"
    assert taken_answer(study, "3") == "cork"
    assert taken_answer(study, "4") is None
    assert taken_answer(study, "oak") is None
    assert taken_answer(study, "") is None


def test_a_script_says_what_is_wrong_with_it() -> None:
    with pytest.raises(AnswerError, match="answer 2"):
        Script(["wood 1", "wood -3"])
    script = Script(["# heading", "", "wood 2", "7"])
    script.ask(Question(0, "?", ()))
    assert (script.poll(1.9), script.poll(2.0)) == (None, "wood")
    script.ask(Question(1, "?", ()))
    assert script.poll(0.5) == "7"
    with pytest.raises(Stopped):
        script.ask(Question(2, "?", ()))


def test_masking_noise_is_played_on_request_and_its_absence_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same rows with it and without."""
    from itouch_tools.sound import masking

    rows = []
    for noise, mute in (("no", ()), ("yes", ()), ("yes", ("--mute",))):
        folder = tmp_path / f"{noise}{len(mute)}"
        path = write_study(folder, repetitions=1, more=f'<blind approach="0.1 s" noise="{noise}"/>')
        monkeypatch.setattr(masking.Masker.__init__, "__kwdefaults__", {"output": masking.Silence})
        assert run(path, folder / "data", "--answers", str(scripted(tmp_path, 3)), *mute) == 0
        assert ("is not heard" in capsys.readouterr().err) == (noise == "yes" and not mute)
        rows.append([(row.answer, row.felt, row.begun_s) for row in kept(folder / "data")])
    assert rows[0] == rows[1] == rows[2]


def test_a_written_answer_that_is_none_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_study(tmp_path, repetitions=1)
    (tmp_path / "a.txt").write_text("wood\nstel\ncork\n")
    assert run(path, tmp_path / "data", "--answers", str(tmp_path / "a.txt")) == 2
    assert "answer 2: 'stel' is none of the answers: wood, steel, cork" in capsys.readouterr().err
    assert len(kept(tmp_path / "data")) == 1


def test_an_answer_may_end_with_a_number() -> None:
    script = Script(["plate 1", "plate 2 3"])
    for place, after in ((0, 0.5), (1, 3.0)):
        script.ask(Question(place, "Which?", ("plate 1", "plate 2")))
        assert script.poll(after - 0.1) is None
        assert script.poll(after) == f"plate {place + 1}"


@pytest.mark.parametrize("code", campaign.some(["P01", "P02", "P03"], 1))
def test_heat_is_right_from_the_first_trial_on_whatever_scene_was_before(tmp_path: Path, code: str) -> None:
    """Through the command, blind: what the display knows of its plate goes on from scene to scene."""
    study = SCENES / "studies" / "four_materials.xml"
    (tmp_path / "a.txt").write_text("wood\n" * 3)
    answers = str(tmp_path / "a.txt")
    main(["study", "run", str(study), "--participant", code, "--answers", answers, "-o", str(tmp_path / "data")])
    rows = kept(tmp_path / "data", code)
    assert len(rows) == 3
    assert not [row.void for row in rows if row.void]
    assert max(felt["flux_error_rms"] for row in rows for felt in row.felt) < 0.02


def test_a_skin_that_was_not_back_is_marked_in_its_touch(tmp_path: Path) -> None:
    shutil.copytree(SCENES, tmp_path / "scenes")
    study = tmp_path / "scenes" / "studies" / "four_materials.xml"
    text = study.read_text().replace("duration=", 'skin-return="0.05 K" skin-wait="0.2 s" duration=')
    study.write_text(re.sub('<practice.*?/>|repetitions="10"', "", text))
    (tmp_path / "a.txt").write_text("wood\n" * 2)
    main(
        [
            "study",
            "run",
            str(study),
            "--participant",
            "P1",
            "--answers",
            str(tmp_path / "a.txt"),
            "-o",
            str(tmp_path / "d"),
        ]
    )
    rows = kept(tmp_path / "d", "P1")
    assert [[felt["skin_back"] for felt in row.felt or []] for row in rows] == [[True], [False]]
    result = analyse(load_study(study, CATALOG), rows, draws=20)
    assert result["skin_not_back"] == 1
    assert "the skin was not back before 1 touch that counts" in page(result, {})
