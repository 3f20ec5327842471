"""What comes of a run, and of one that fails: rows in this process and in a runner beside it."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from sweeping import COLLECT, OWN, VARIED, written

import itouch
from itouch.plugin.discovery import Catalog
from itouch_tools.sweeps import worker
from itouch_tools.sweeps.provenance import differences
from itouch_tools.sweeps.report_paths import advice, values
from itouch_tools.sweeps.run_plan import Run
from itouch_tools.sweeps.running import Running
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.work import Work, work_of
from itouch_tools.sweeps.worker import close_runners, work_on

BROKEN = (
    OWN
    + """
import os, signal
def broken(session):
    seed = int(session.state["seed"])
    if seed == 1:
        os.kill(os.getpid(), signal.SIGSEGV)
    if seed == 2:
        raise KeyError("what is this")
    if seed == 3:
        os._exit(7)
    if seed == 4:
        raise MemoryError("no more")
    if seed == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return "words" if seed == 6 else 1.0
"""
)
SEEDS = (
    '<run for="0.05 s" patience="100 s"/><seeds count="8"/><collect><call name="b" function="own.py:broken"/></collect>'
)


def work(folder: Path, inside: str = VARIED + COLLECT, own: str = OWN) -> tuple[Work, list[Run]]:
    file = load_sweep(written(folder, inside, own), Catalog())
    found = work_of(file, Catalog())
    plan = file.plan(found.digest)
    return found, [plan.run(number) for number in range(len(plan))]


@pytest.fixture
def runners() -> Iterator[None]:
    yield
    close_runners()


def test_a_row_says_what_a_session_says(tmp_path: Path) -> None:
    found, runs = work(tmp_path / "a")
    row = Running(found, tmp_path / "content").row(runs[3])
    text = (tmp_path / "a" / "first_touch.xml").read_text(encoding="utf-8")
    scene = tmp_path / "a" / "edited.xml"
    stiffness = dict(runs[3].sets)["wood/contact.stiffness"]
    edited = text.replace('probe="finger">', f'probe="finger" mass="{dict(runs[3].sets)["operator.mass"]}">')
    scene.write_text(edited.replace("1.2 N/mm", stiffness), encoding="utf-8")
    assert edited != text
    session = itouch.build(scene, seed=runs[3].seed)
    pushed, touched = [-math.inf], [0]

    def watch(tick: int) -> None:
        pushed[0] = max(pushed[0], float(session.state["finger.force"][2]))
        touched[0] += tick >= 200 and bool(session.state["finger.penetration"] > 0.0)

    session.taps.append(watch)
    session.run()
    assert row["status"] == "done"
    assert row["state"] == __import__("hashlib").sha256(session.state.tobytes()).hexdigest()
    assert row["force"] == session.report()["contacts"][0]["peak_force_N"]
    assert (row["push"], row["own_ticks"], row["own_seed"]) == (pushed[0], session.ticks, runs[3].seed)
    assert row["touching"] == pytest.approx(touched[0] * 1e-3)
    assert row["simulated_s"] == pytest.approx(session.ticks * 1e-3)


def test_rows_do_not_depend_on_what_ran_before(tmp_path: Path) -> None:
    found, runs = work(tmp_path / "a")
    one = Running(found, tmp_path / "one")
    forward = [one.row(run) for run in runs[:3]]
    other = Running(found, tmp_path / "other")
    assert [other.row(run) for run in reversed(runs[:3])] == forward[::-1]


def test_each_failure_is_a_row_with_its_reason_and_the_others_are_there(tmp_path: Path, runners: None) -> None:
    found, runs = work(tmp_path / "a", SEEDS, BROKEN)
    done = work_on(found, runs, 5)
    assert done.key == 5
    rows = [(row["seed"], row["status"], row["reason"]) for row in done.rows]
    assert rows[0] == (0, "done", "")
    assert rows[1] == (1, "crashed", "its process was ended by SIGSEGV")
    assert rows[2][:2] == (2, "error")
    assert "what is this" in rows[2][2]
    assert re.search(r" \(own\.py:\d+\)$", rows[2][2])  # where to look
    assert rows[3] == (3, "crashed", "ended its process with exit code 7")
    assert rows[4] == (4, "machine", "MemoryError: no more")
    assert rows[5][:2] == (5, "machine")
    assert "SIGKILL" in rows[5][2]
    assert rows[6][:2] == (6, "error")
    assert 'type="text"' in rows[6][2]
    assert rows[7] == (7, "done", "")
    assert done.retries == 2 + 2 + 3 + 3
    assert {row["digest"] for row in done.rows} == {run.digest for run in runs}


def test_a_run_that_hangs_is_ended(tmp_path: Path, runners: None, monkeypatch: pytest.MonkeyPatch) -> None:
    hanging = "import time\ndef broken(session):\n    time.sleep(600 if int(session.state['seed']) == 0 else 0)\n"
    found, runs = work(tmp_path / "a", SEEDS.replace('100 s"/><seeds count="8"', '1 s"/><seeds count="2"'), hanging)
    monkeypatch.setattr(worker, "TRIES_MACHINE", 1)
    (row,) = work_on(found, runs[:1]).rows
    assert (row["status"], row["reason"]) == ("hung", "took longer than 1 s")


def test_a_runner_leaves_no_folder_however_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each holds a copy of the scene's folder: a thousand sweeps would fill a disk."""
    found, runs = work(tmp_path / "a", SEEDS, BROKEN)
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    left, own = (place / f"{worker.FOLDER}{number}-abc" for number in (killed.pid, os.getpid()))
    for folder in (left, own):
        (folder / "scene").mkdir(parents=True)
    work_on(found, [runs[3], runs[0]])  # the first one ends its process
    assert not left.exists()  # of a worker that was killed, with its runner
    assert len(list(place.iterdir())) == 2  # own, and that of the runner that is kept for the next task
    close_runners()
    assert list(place.iterdir()) == [own]


def test_another_version_is_refused_by_name(tmp_path: Path, runners: None) -> None:
    found, runs = work(tmp_path / "a")
    other = Work(**{**{f: getattr(found, f) for f in Work.__slots__},
                    "identity": {**found.identity, "numba": "0.1", "itouch-py": "0.0.9 (abc)"}})  # fmt: skip
    done = work_on(other, runs[:1])
    assert not done.rows
    assert "numba is " in done.refused
    assert ", not 0.1" in done.refused
    assert "itouch-py is 0.1.0" in done.refused
    assert differences(found.identity, found.identity) == []


def test_work_travels_as_text(tmp_path: Path) -> None:
    found, _ = work(tmp_path / "a")
    again = Work.loads(found.dumps())
    assert again.parts() == found.parts()
    assert again.digest == found.digest
    assert again.files == found.files


def test_what_is_changed_is_another_digest(tmp_path: Path) -> None:
    first, _ = work(tmp_path / "a")
    same, _ = work(tmp_path / "b")
    assert same.digest == first.digest
    seen = {first.digest}
    for index, (inside, own) in enumerate(
        [
            (VARIED + COLLECT.replace("max", "min"), OWN),
            (VARIED + COLLECT, OWN + "\n# more\n"),
            ('<run for="1 s"/>' + VARIED + COLLECT, OWN),
        ]  # fmt: skip
    ):
        seen.add(work(tmp_path / f"c{index}", inside, own)[0].digest)
    assert len(seen) == 4
    patient, _ = work(tmp_path / "d", '<run patience="5 s"/>' + VARIED + COLLECT)
    assert patient.digest == first.digest  # how long one waits for a run changes nothing of it


REPORT = {
    "contacts": [{"object": "a", "n": 1.0}, {"object": "b", "n": 3.0}],
    "servo": {"ticks": 5},
    "devices": {"x": {"n": 2}},
}


@pytest.mark.parametrize(
    ("key", "found"),
    [
        ("servo.ticks", [5]), ("contacts[0].n", [1.0]), ("contacts[-1].n", [3.0]), ("contacts[9].n", []),
        ("contacts[object=b].n", [3.0]), ("contacts[*].n", [1.0, 3.0]), ("devices[*].n", [2]), ("servo.tick", []),
    ],
)  # fmt: skip
def test_places_in_a_report(key: str, found: list[object]) -> None:
    assert values(REPORT, key) == found


def test_a_key_that_is_not_there_has_advice() -> None:
    assert advice(REPORT, "servo.tick") == "did you mean 'ticks'?"
    assert advice(REPORT, "contcts[0].n") == "did you mean 'contacts'?"
    assert advice(REPORT, "servo.ticks") == ""
