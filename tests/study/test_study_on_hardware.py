"""A study on hardware: the devices of a stranger, opened once, at rest while the scene changes; faults, deaths, resume."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_rig import DOWN, UP, Person, install

from itouch.loop import DeviceFaultError
from itouch.plugin.discovery import Catalog
from itouch.recording import read
from itouch.safety import Trip
from itouch.schema import ItouchError
from itouch.servo import ServoError, sessions
from itouch.servo.link import attach
from itouch.session import Session
from itouch_tools.cli import main
from itouch_tools.study import rig_windows
from itouch_tools.study.answer_sources import Script
from itouch_tools.study.client import connect
from itouch_tools.study.reading import load_study
from itouch_tools.study.scene_switching import SceneSwitcher, note_stop
from itouch_tools.study.session_display import Shown
from itouch_tools.study.study_store import Row, Store

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]


class Touches:
    """What the participant does at each cue; ``also`` does more."""

    def __init__(self, person: Person, also: Callable[[Shown], None] | None = None) -> None:
        self.person, self.also, self.cues = person, also, list[str]()

    def __call__(self, face: Shown) -> None:
        if not self.cues or face.cue != self.cues[-1]:
            self.cues.append(face.cue)
        if face.cue == "go":
            self.person.set(height=DOWN)
        elif face.cue != "contact":
            self.person.set(height=UP)
        if self.also is not None:
            self.also(face)


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.syspath_prepend(str(install(tmp_path)))
    monkeypatch.setenv("STUDY_BENCH", str(tmp_path))
    return Person(tmp_path)


def rows(folder: Path) -> list[Row]:
    with Store.open(folder / "data") as store:
        return store.rows()


def begin(folder: Path, *, record: bool = False) -> Any:
    file = load_study(folder / "study.xml", Catalog())
    (folder / "data").mkdir(exist_ok=True)
    with Store.open(folder / "data", create=True):
        pass
    return rig_windows.launch(file, "P1", folder / "data", record=record)


def attend(handle: Any, touches: Touches, answers: list[str]) -> list[dict[str, Any]]:
    with handle:
        return list(rig_windows.RigWindows(handle, Script(answers), show=touches).attend())


def test_a_study_on_a_rig_opens_it_once_and_lets_it_rest_while_the_scene_changes(tmp_path: Path, rig: Person) -> None:
    touches = Touches(rig)
    told = attend(begin(tmp_path, record=True), touches, ["low 0.1", "mid 0.1", "high 0.1"])
    made = rows(tmp_path)
    assert [one["place"] for one in told if one["kind"] == "trial"] == [0, 1, 2]
    assert [(row.void, row.answer) for row in made] == [("", "low"), ("", "mid"), ("", "high")]
    assert {row.condition["height"] for row in made} == {"low", "mid", "high"}
    assert all(0.09 < (row.reaction_s or 0.0) < 2.0 for row in made)
    for device in ("stick", "lift", "plate"):
        assert [entry["what"] for entry in rig.sent(device)] == ["open", "close"], device
    (_, plate), (_, lift) = rig.sent("plate"), rig.sent("lift")
    pulses = [number for _, number in plate["sent"]]
    assert pulses.count(0.0) >= 4  # off before the first trial, between two, and at the end
    assert max(pulses) == 0.3
    assert pulses[-1] == 0.0
    wanted = {"low": 20.0, "mid": 20.3, "high": 20.6}  # the surface of each scene, in the order of the trials
    assert rig.touched_at(*wanted.values()) == [wanted[row.condition["height"]] for row in made]
    assert min(number for _, number in lift["sent"][100:]) < 0.018  # it went back meanwhile
    (recording,) = (tmp_path / "data" / "recordings").iterdir()
    assert main(["inspect", str(recording)]) == 0


def test_scenes_whose_states_have_other_fields_share_a_recording_each(tmp_path: Path, rig: Person) -> None:
    """As real and rendered do, which have other modalities or controllers."""
    study = (tmp_path / "study.xml").read_text()
    more = '<factor name="cooling" levels="short long" values="1;9" set="cool.kept"/>'
    (tmp_path / "study.xml").write_text(study.replace("  <task", f"  {more}\n  <task"))
    told = attend(
        begin(tmp_path, record=True), Touches(rig), [f"{height} 0.1" for height in ("low", "mid", "high") * 2]
    )
    made = rows(tmp_path)
    assert [row.void for row in made] == [""] * 6, told
    assert [entry["what"] for entry in rig.sent("stick")] == ["open", "close"]  # it was opened once
    folder = tmp_path / "data" / "recordings"
    assert sorted(one.name for one in folder.iterdir()) == ["P1-1.2.mcap", "P1-1.mcap"]
    placed = dict[str, list[int]]()
    for path in folder.iterdir():
        recording = read(path)
        assert recording.whole, recording.losses
        marked = [mark for mark in recording.marks if mark["name"] == "trial"]
        placed[path.name] = [json.loads(mark["payload"])["place"] for mark in marked]
        own = [row for row in made if row.place in placed[path.name]]
        assert len({row.condition["cooling"] for row in own}) == 1
        times = recording.ticks * recording.period
        for row in own:  # not a tick of its trials is missing
            during = recording.ticks[(times >= row.begun_s) & (times <= row.ended_s)]
            assert during.size > 100 and (np.diff(during) == 1).all()
    assert sorted(placed["P1-1.mcap"] + placed["P1-1.2.mcap"]) == [0, 1, 2, 3, 4, 5]
    assert [len(places) for places in placed.values()] == [3, 3]


def test_nobody_sees_what_is_touched(tmp_path: Path, rig: Person) -> None:
    seen: list[str] = []

    def look(face: Shown) -> None:
        if face.cue == "contact" and not seen:
            try:
                attach(next(info.name for info in sessions() if info.name.startswith("study-P1"))).close()
            except ServoError as error:
                seen.append(str(error))

    attend(begin(tmp_path), Touches(rig, look), ["low 0.1"])
    assert ["nobody may see what is touched" in text for text in seen] == [True]
    assert len(rows(tmp_path)) == 1  # the script had one answer: the session ended in order


def test_letting_the_switch_go_in_a_touch_ends_the_session_and_the_same_trial_comes_again(
    tmp_path: Path, rig: Person
) -> None:
    def let_go(face: Shown) -> None:
        if face.trial == 2 and face.cue == "contact":
            rig.set(held=False)

    with pytest.raises(DeviceFaultError, match="let go"):
        attend(begin(tmp_path), Touches(rig, let_go), ["low 0.1"] * 3)
    assert len(rows(tmp_path)) == 1
    assert [number for _, number in rig.sent("plate")[-1]["sent"]][-1] == 0.0
    rig.set(held=True)
    attend(begin(tmp_path), Touches(rig), ["low 0.1"] * 3)
    made = rows(tmp_path)
    assert [row.place for row in made] == [0, 1, 2]
    assert len({row.condition["height"] for row in made}) == 3


def test_in_a_break_the_switch_may_be_let_go_and_a_finger_that_stays_is_waited_for(tmp_path: Path, rig: Person) -> None:
    path = tmp_path / "study.xml"
    path.write_text(path.read_text().replace("<order", '<breaks every="1" duration="0.3 s"/><order'))
    waited: list[float] = []

    def rests(face: Shown) -> None:
        if face.cue == "break":
            rig.set(held=False, height=DOWN)
        elif face.cue == "hold" and face.trial > 1:
            waited.append(time.monotonic())
            if waited[-1] - waited[0] > 0.3:
                rig.set(held=True)
                waited.clear()

    touches = Touches(rig, rests)
    attend(begin(tmp_path), touches, ["low 0.1"] * 3)
    assert [row.void for row in rows(tmp_path)] == ["", "", ""]
    first = touches.cues.index("break")
    assert touches.cues[first : first + 3] == ["break", "lift", "hold"]
    (_, plate) = rig.sent("plate")
    assert [number for _, number in plate["sent"]].count(0.0) >= 4


def test_a_drive_that_cannot_be_switched_off_ends_the_session_at_once(tmp_path: Path, rig: Person) -> None:
    def breaks(face: Shown) -> None:
        if face.trial == 2 and face.cue == "contact":
            rig.set(stuck=True)

    with pytest.raises(DeviceFaultError, match="plate"):
        attend(begin(tmp_path), Touches(rig, breaks), ["low 0.1"] * 3)
    assert len(rows(tmp_path)) == 1  # nobody is asked about a touch on such a rig
    rig.set(stuck=False)  # it was repaired; who starts the command again re-arms
    attend(begin(tmp_path), Touches(rig), ["low 0.1"] * 3)
    assert [row.place for row in rows(tmp_path)] == [0, 1, 2]


def test_what_a_trial_has_used_of_a_budget_stays_used(tmp_path: Path, rig: Person) -> None:
    """A session that ends in its first touch leaves its State: doses, clocks and the trip go on with the next one."""
    study = tmp_path / "study.xml"
    study.write_text(study.read_text().replace('duration="0.1 s"', 'duration="20 s"'))
    since: list[float] = []

    def lets_go(face: Shown) -> None:
        if face.cue == "contact":
            since.append(time.monotonic())
            rig.set(held=since[-1] - since[0] < 0.5)

    with pytest.raises(DeviceFaultError, match="let go"):
        attend(begin(tmp_path), Touches(rig, lets_go), ["low 0.1"])
    assert rows(tmp_path) == []
    with Store.open(tmp_path / "data") as store:
        stood = store.standing("P1")
    assert stood is not None
    assert stood.place == -1
    file = load_study(study, Catalog())
    session = Session(file.model(stood.condition, Catalog()), catalog=Catalog())
    session.adopt(stood.state)
    assert session.ticks > 1000
    latched = session.latched()
    assert latched is not None
    assert latched.trip is Trip.RELEASED


def test_time_between_two_sessions_counts_for_how_often_one_may_re_arm(
    tmp_path: Path, rig: Person, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The servo's clock stands still between two processes: who had waited for a minute was told to wait for ever."""
    file, clock = load_study(tmp_path / "study.xml", Catalog()), [1e9]
    monkeypatch.setattr("itouch_tools.study.scene_switching.time.time", lambda: clock[0])
    switcher = SceneSwitcher(file, Catalog(), seed=1)
    switcher.prepare(file.conditions()[0])
    switcher.session.state["tick"] = 40_000
    switcher.session.state["lift.rearmed"] = [39_000, 30_000, 20_000, 10_000, 3_000]
    note_stop(switcher.session)
    stood = switcher.standing(-1)
    for seconds, left in (
        (0.0, [39_000, 30_000, 20_000, 10_000, 3_000]),
        (25.0, [14_000, 5_000, -1, -1, -1]),
        (60.0, [-1] * 5),
    ):
        clock[0] = 1e9 + seconds
        again = SceneSwitcher(file, Catalog(), seed=1)
        assert again.take_up(stood)
        assert again.session.state["lift.rearmed"].tolist() == left


def test_a_servo_process_that_is_killed_loses_no_trial_that_was_made(tmp_path: Path, rig: Person) -> None:
    handle = begin(tmp_path)

    def kill(face: Shown) -> None:
        if face.trial == 2 and face.cue == "contact" and handle.running:
            with contextlib.suppress(ProcessLookupError):
                os.kill(handle.pid, signal.SIGKILL)

    with pytest.raises(ServoError, match="SIGKILL"):
        attend(handle, Touches(rig, kill), ["low 0.1"] * 3)
    assert len(rows(tmp_path)) == 1
    attend(begin(tmp_path), Touches(rig), ["low 0.1"] * 3)
    assert [row.place for row in rows(tmp_path)] == [0, 1, 2]


@contextlib.contextmanager
def dips(rig: Person, stuck: Callable[[], bool] = lambda: False) -> Iterator[None]:
    """Nobody is shown anything: the participant touches again and again; the plate's drive is stuck once that is so."""
    over = threading.Event()

    def again() -> None:
        while not over.is_set():
            rig.set(height=DOWN, stuck=stuck())
            over.wait(0.5)
            rig.set(height=UP)
            over.wait(0.9)

    person = threading.Thread(target=again, daemon=True)
    person.start()
    try:
        yield
    finally:
        over.set()
        person.join()


def command(folder: Path) -> int:
    """Run the study by its command, with three answers."""
    (folder / "answers.txt").write_text("low 0.1\nmid 0.1\nhigh 0.1\n")
    words = ["-o", str(folder / "data"), "--participant", "P1", "--answers", str(folder / "answers.txt")]
    return main(["study", "run", str(folder / "study.xml"), *words])


def test_the_command_says_what_could_not_be_seen_to_be_safe(
    tmp_path: Path, rig: Person, capsys: pytest.CaptureFixture[str]
) -> None:
    with dips(rig, stuck=lambda: (tmp_path / "data").exists() and bool(rows(tmp_path))):
        code = command(tmp_path)
    told = capsys.readouterr().err
    assert code == 1, told
    assert "devices: not all could be seen to be safe ('plate' could not): look at them before you touch" in told
    assert told.rstrip().endswith("the same command goes on from here")


def test_the_command_runs_a_study_on_a_rig(tmp_path: Path, rig: Person, capsys: pytest.CaptureFixture[str]) -> None:
    with dips(rig):
        code = command(tmp_path)
    told = capsys.readouterr()
    assert code in (0, 3), told  # 3: a touch came before its signal, and the script had no answer left for another
    assert "P1: 0 trials are kept, 3 of the order are left" in told.out
    assert "trial 1: " in told.out


def test_what_cannot_be_done_on_hardware_is_said_before_anything_begins(tmp_path: Path, rig: Person) -> None:
    file, catalog = load_study(tmp_path / "study.xml", Catalog()), Catalog()
    assert rig_windows.hardware_of(file, catalog) == ["stick", "lift", "plate", "room", "lamp"]
    with pytest.raises(ItouchError, match="real time"):
        rig_windows.refuse(file, catalog, switch=False, fast=True)
    rig_windows.refuse(file, catalog, switch=False, fast=False)  # the stick has a switch
    text = (tmp_path / "study.xml").read_text()
    edited = text.replace("0 0 10 mm;0 0 10.3 mm;0 0 10.6 mm", "no;yes;no").replace("block.pos", "lift.twin")
    (tmp_path / "study.xml").write_text(edited)
    with pytest.raises(ItouchError, match=r"'lift' is real: a study may not change it.*height=mid"):
        begin(tmp_path)
    (tmp_path / "study.xml").write_text(text)
    rig.set(out=True)
    with pytest.raises(ItouchError, match="the cable is out"):
        attend(begin(tmp_path), Touches(rig), ["low 0.1"])
    assert rows(tmp_path) == []


def test_another_program_leads_a_rig(tmp_path: Path, rig: Person) -> None:
    file = load_study(tmp_path / "study.xml", Catalog())
    with rig_windows.launch_server(file, tmp_path / "key.json", 0) as handle:
        assert handle.others.get(timeout=600.0)["port"] > 0
        handle.enable()
        with connect(tmp_path / "key.json") as touch:
            for height in ("high", "low"):
                touch.set(height=height)
                rig.set(height=DOWN)
                assert touch.wait_contact(5.0)
                assert not touch.wait_release(0.3)
                rig.set(height=UP)
                assert touch.wait_release(5.0)
                assert touch.felt()["peak_force_N"] >= 0.0
            touch.stop()
        assert handle.wait(300.0)
    assert [entry["what"] for entry in rig.sent("lift")] == ["open", "close"]
    assert rig.touched_at(20.6, 20.0) == [20.6, 20.0]
