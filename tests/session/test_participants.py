"""A participant's budgets outlast sessions, processes, crashes and older files; edits are told, the larger use counts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from test_hardware import Params, catalog

import itouch
from itouch.plugin import Device, Record, current, deadman, plate_temperature
from itouch.session import SessionError, participants
from itouch.session.participants import LASTS, BudgetUse, read, write

SCENE = """<itouch version="1.0">
  <devices><device name="NAME" plugin="thermal"/></devices>
  <safety participant="P01" dose="20 s"/>
</itouch>
"""


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "itouch-py" / "participants"


def scene(folder: Path, name: str = "pad") -> Path:
    path = folder / f"{name}.xml"
    path.write_text(SCENE.replace("NAME", name), encoding="utf-8")
    return path


def used(session: itouch.Session) -> tuple[float, float]:
    (runner,) = session.runners
    (post,) = runner.gate.heats
    return post.state["dose"].item(), post.state["cold_time"].item()


def use(session: itouch.Session, dose: float, cold: float = 0.0) -> None:
    (post,) = session.runners[0].gate.heats
    post.state["dose"][...], post.state["cold_time"][...] = dose, cold


def test_what_was_used_goes_into_the_next_session_whatever_its_devices_are_called(tmp_path: Path, home: Path) -> None:
    first = itouch.build(scene(tmp_path))
    first.run(0.1)
    use(first, 7.5, 12.0)
    first.run(0.05)
    first.close()
    assert sorted(path.name for path in home.iterdir()) == [".P01.copy.json", "P01.json"]
    second = itouch.build(scene(tmp_path, "renamed"))
    assert used(second) == (0.0, 0.0)
    second.run(0.002)
    assert used(second) == (pytest.approx(7.5), pytest.approx(12.0))
    second.close()


def test_a_used_up_dose_acts_in_no_later_session(tmp_path: Path) -> None:
    write("P01", BudgetUse(20.1, 0.0, participants.time.time()))
    session = itouch.build(scene(tmp_path))
    with pytest.raises(itouch.ItouchError, match="thermal dose"):
        session.run(1.0)


def test_an_older_session_file_does_not_give_a_budget_back(tmp_path: Path) -> None:
    session = itouch.build(scene(tmp_path))
    session.run(0.01)
    session.save(tmp_path / "old.itouch")
    use(session, 9.0)
    session.close()
    restored = itouch.restore(tmp_path / "old.itouch")
    assert used(restored)[0] == 0.0
    restored.run(0.002)
    assert used(restored)[0] == pytest.approx(9.0)
    restored.close()
    fresh = itouch.build(scene(tmp_path))
    use(fresh, 11.0)  # what a session brings with it may be more
    fresh.run(0.002)
    assert used(fresh)[0] == pytest.approx(11.0)
    fresh.close()
    assert read("P01")[0].dose == pytest.approx(11.0)


def test_a_process_that_is_killed_has_noted_what_was_used(tmp_path: Path) -> None:
    code = f"""
import itouch, os, signal, time
from itouch.session.participants import read
session = itouch.build({str(scene(tmp_path))!r})
session.run(0.01)
(post,) = session.runners[0].gate.heats
post.state["dose"][...] = 5.0
session.run(3.0)
until = time.monotonic() + 300.0  # it is written beside the loop, which runs ahead of real time here
while read("P01")[0].dose < 5.0 and time.monotonic() < until:
    time.sleep(0.01)
os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", code], check=False, timeout=600)
    assert read("P01")[0].dose == pytest.approx(5.0)


def test_an_edit_is_told_and_the_larger_use_counts(tmp_path: Path, home: Path) -> None:
    now = participants.time.time()
    write("P01", BudgetUse(8.0, 3.0, now))
    path = home / "P01.json"
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, "dose_s": 0.0}))
    assert read("P01")[0].dose == 8.0
    session = itouch.build(scene(tmp_path))
    session.run(0.002)
    assert used(session)[0] == 8.0
    assert any("was edited by somebody" in notice for notice in session.notices)
    session.close()
    path.unlink()
    assert read("P01")[0].dose == 8.0


@pytest.mark.parametrize("text", [
    "", "{", "[]", "null", "7", '"P01"', "[" * 50_000, '{"format": "other"}', '{"dose_s": "NaN"}',
    '{"format": "itouch-py participant 1", "participant": "P01", "dose_s": 1' + 400 * "0" + ', "cold_s": 0, "at": 0}',
])  # fmt: skip
def test_what_nobody_can_read_is_refused(tmp_path: Path, home: Path, text: str) -> None:
    home.mkdir(parents=True)
    for name in ("P01.json", ".P01.copy.json"):
        (home / name).write_text(text)
    with pytest.raises(itouch.SessionError, match="what participant 'P01' has used can't be read"):
        itouch.build(scene(tmp_path)).run(0.01)
    (home / "P01.json").unlink()
    (home / ".P01.copy.json").unlink()
    write("P01", BudgetUse(4.0, 0.0, participants.time.time()))
    (home / "P01.json").write_text(text)
    found, told = read("P01")
    assert found.dose == 4.0 and "the other copy counts" in told[0]


def test_budgets_begin_anew_a_day_after_the_last_use_and_never_shrink_before() -> None:
    write("P01", BudgetUse(4.0, 2.0, 1000.0))
    write("P01", BudgetUse(1.0, 5.0, 900.0))
    assert read("P01", now=1000.0 + LASTS)[0].values == (4.0, 5.0, 1000.0)
    assert read("P01", now=1001.0 + LASTS)[0] == BudgetUse()


@pytest.mark.parametrize("code", ["../P01", "a b", ".hidden", "x" * 65, "é"])
def test_a_code_that_is_no_name_of_a_file_is_refused_at_its_place(tmp_path: Path, code: str) -> None:
    path = scene(tmp_path)
    path.write_text(path.read_text().replace("P01", code), encoding="utf-8")
    with pytest.raises(itouch.SceneError, match=r"is not a code[\s\S]*pad\.xml:3:\d+") as caught:
        itouch.build(path)
    assert caught.value.problems[0].code == "bad-value"


@pytest.mark.parametrize("text", ["null", "[" * 50_000])
def test_files_that_are_spoilt_meanwhile_are_told_and_hold_up_nobody(tmp_path: Path, home: Path, text: str) -> None:
    session = itouch.build(scene(tmp_path))
    views = session.runners[0].gate.heats[0].state

    def each() -> None:
        views["dose"][...] += 1e-3
        for name in ("P01.json", ".P01.copy.json"):
            (home / name).write_text(text)

    home.mkdir(parents=True, exist_ok=True)
    session.run(0.01)
    session.run(6.0, each=each, every=50)
    assert any(fault["trip"] == "saving" and "P01" in fault["cause"] for fault in session.statistics.faults)
    with pytest.raises(itouch.SessionError, match="what participant 'P01' has used can't be read"):
        session.close()
    for name in ("P01.json", ".P01.copy.json"):
        (home / name).unlink()


TWO = """<itouch version="1.0">
  <devices><device name="one" plugin="thermal"/>MORE</devices>
  <safety participant="P01" dose="20 s"/>
</itouch>
"""


def test_what_several_plates_gave_one_finger_counts_together_in_the_next_session(tmp_path: Path) -> None:
    """Displays that no probe names are taken to be on every finger."""
    path = tmp_path / "two.xml"
    for given, begins in (((6.0, 5.0), 0.0), ((1.0, 2.0), 11.0)):
        path.write_text(TWO.replace("MORE", '<device name="other" plugin="thermal"/>'), encoding="utf-8")
        session = itouch.build(path)
        session.run(0.002)
        views = [runner.gate.heats[0].state["dose"] for runner in session.runners]
        assert sum(view.item() for view in views) == pytest.approx(begins)
        for view, more in zip(views, given, strict=True):
            view[...] += more
        session.close()
    path.write_text(TWO.replace("MORE", ""), encoding="utf-8")
    session = itouch.build(path)
    session.run(0.002)
    assert used(session)[0] == pytest.approx(14.0)
    session.close()


class Pad(Device):
    """A plate that is driven, as hardware."""

    Params, watchdog = Params, 0.5
    reads, commands = (plate_temperature(), deadman()), (current(limit=4.0),)

    def open(self) -> None:
        self.count = 0

    def close(self) -> None: ...

    def read(self, reading: Record) -> None:
        self.count += 1
        reading["plate_temperature"], reading["deadman"] = 303.15 + 1e-3 * (self.count % 7), 1.0


def real(folder: Path, code: str = "P01") -> itouch.Session:
    path = folder / f"{code}.xml"
    path.write_text(
        f'<itouch version="1.0"><devices><device name="pad" plugin="stick" twin="no"/></devices><safety participant="{code}"/>'
        "</itouch>", "utf-8",
    )  # fmt: skip
    return itouch.build(path, catalog=catalog(Pad))


def test_what_a_script_uses_that_ticks_by_itself_is_noted(tmp_path: Path) -> None:
    session = real(tmp_path)
    session.enable()
    session.tick()
    use(session, 6.0, 2.0)
    session.tick()
    session.close()
    assert read("P01")[0].values[:2] == (6.0, 2.0)


def test_a_participant_is_in_one_session_on_hardware_at_a_time(tmp_path: Path) -> None:
    one, other = real(tmp_path), real(tmp_path)
    one.enable()
    use(one, 6.0)
    for act in (other.enable, other.rearm):
        with pytest.raises(SessionError, match="participant 'P01' is in another running session: end that one first"):
            act()
        assert not other.runners[0].latch.enabled
    other.close()
    twin = itouch.build(scene(tmp_path))  # a simulated finger is nobody's
    twin.run(0.01)
    twin.close()
    another = real(tmp_path, "P02")
    another.enable()
    another.close()
    one.tick()
    one.close()
    then = real(tmp_path)
    then.enable()
    assert used(then)[0] == 6.0
    then.close()


def test_a_killed_session_keeps_no_participant(tmp_path: Path) -> None:
    folder = str(participants.folder())
    code = (
        "import os, sys; from itouch.platforms import claim\n"
        f"os.makedirs({folder!r}, exist_ok=True)\n"
        f"claim(os.open({folder!r} + '/.P01.lock', os.O_RDWR | os.O_CREAT, 0o600)); print(1, flush=True); sys.stdin.read()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as held:
        assert held.stdout is not None
        held.stdout.readline()
        session = real(tmp_path)
        with pytest.raises(SessionError, match="another running session"):
            session.enable()
        held.kill()
        held.wait()
        session.enable()
        assert session.runners[0].latch.enabled
        session.close()


def test_two_copies_that_say_the_same_are_no_news_and_two_that_do_not_are(home: Path) -> None:
    write("P01", BudgetUse(3.0, 5.0, participants.time.time()))
    whole, told = read("P01")
    assert (whole.values[:2], told) == ((3.0, 5.0), ())
    copy = (home / ".P01.copy.json").read_bytes()
    write("P01", BudgetUse(7.0, 5.0, participants.time.time()))
    (home / ".P01.copy.json").write_bytes(copy)
    whole, told = read("P01")
    assert whole.values[:2] == (7.0, 5.0)
    assert told == ("participant 'P01': the two copies of what was used differ; the larger use counts",)


@pytest.mark.parametrize("state", ["", " ", "state", "~/state"])
def test_what_was_used_does_not_depend_on_the_working_folder(monkeypatch: pytest.MonkeyPatch, state: str) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", state)
    assert participants.folder() == Path.home() / ".local" / "state" / "itouch-py" / "participants"
