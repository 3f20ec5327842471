"""Deaths in short: whoever dies, the remote twins are safe and nothing is left.

How soon is measured and told by ``itouch-py bench deaths``; here nothing depends on how busy the machine is.
"""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import itouch
from itouch.servo import twin_protocol
from itouch_evidence.deaths import kills_at_start
from itouch_evidence.deaths.campaign import cases, strike_again
from itouch_evidence.deaths.observer import Observer
from itouch_tools.cli.doctor.touch_scene import scene


@pytest.mark.parametrize(
    ("victim", "manner", "wait"),
    [
        ("servo", "kill", 0.9),
        pytest.param("servo", "stop", 0.3, marks=pytest.mark.long),
        pytest.param("servo", "memory", 1.3, marks=pytest.mark.long),
        pytest.param("viewer", "kill", 0.6, marks=pytest.mark.long),
        ("viewer", "stop", 1.1),
        ("recorder", "kill", 0.2),
    ],
)
def test_the_devices_end_up_safe_and_nothing_is_left(victim: str, manner: str, wait: float) -> None:
    outcome = strike_again(victim, manner, wait)
    assert set(outcome.safe_s) == {"arm", "table", "peltier"}
    assert math.isfinite(outcome.worst), outcome
    assert outcome.worst < 10.0  # a generous bound for a busy machine; what is reached is in the documentation
    assert outcome.left == ()
    expected = {"servo": "was killed by SIGKILL" if manner != "memory" else "MemoryError", "viewer": "nobody holds"}
    assert expected.get(victim, "ended") in outcome.said


@pytest.mark.parametrize(
    ("victim", "after"),
    [
        ("launcher", 0.001),
        pytest.param("guardian", 0.3, marks=pytest.mark.long),
        pytest.param("twin", 0.05, marks=pytest.mark.long),
        pytest.param("servo", 0.001, marks=pytest.mark.long),
        pytest.param("recorder", 0.2, marks=pytest.mark.long),
        pytest.param("viewer", 1.0, marks=pytest.mark.long),
    ],
)
def test_whoever_is_killed_during_the_start_nothing_is_left(victim: str, after: float) -> None:
    outcome = kills_at_start.kill(victim, after)
    assert outcome.left == ()
    assert outcome.gone_s < 30.0  # a generous bound for a busy machine
    assert outcome.worst < 10.0


@pytest.mark.long
def test_a_viewer_that_is_there_from_the_start_holds_the_switch_until_it_is_killed() -> None:
    outcome = kills_at_start.kill("viewer", 0.3, running=True)
    assert set(outcome.safe_s) == {"arm", "table", "peltier"}
    assert math.isfinite(outcome.worst) and outcome.left == ()


def test_every_process_of_a_session_has_its_turn_from_the_first_millisecond_on() -> None:
    drawn = list(kills_at_start.cases(48, 3))
    assert {victim for victim, _, _ in drawn} == set(kills_at_start.VICTIMS)
    assert all(0.001 <= after <= 4.0 for _, after, _ in drawn)
    assert {running for _, _, running in drawn} == {False, True}


def test_what_is_just_being_started_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between fork and exec a process has no environment to be known by; seen at a kill of a launcher after 0.42 s."""
    clock = [0.0]  # as a machine has it that holds nobody up

    def sleep(seconds: float) -> None:
        clock[0] += seconds

    def left(mark: str) -> Iterator[str]:
        if 0.1 < clock[0] < 0.4:
            yield "servo 1"

    monkeypatch.setattr(kills_at_start, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=sleep))
    monkeypatch.setattr(kills_at_start, "_left", left)
    assert 0.37 < kills_at_start._await_nothing("mark", ()) <= 0.4
    assert not any(left("mark"))


def test_kills_in_parts_add_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    struck = []

    def kill(victim: str, after: float, *, running: bool) -> kills_at_start.Kill:
        struck.append(victim)
        return kills_at_start.Kill(victim, after, 1.0, {"arm": 0.01}, ())

    monkeypatch.setattr(kills_at_start, "kill", kill)
    for count, seed in ((3, 5), (4, 5), (2, 6)):
        kills = kills_at_start.campaign(count, seed, tell=True, keep=str(tmp_path / "kept.jsonl"))
    assert struck == [*kills_at_start.VICTIMS[:4], *kills_at_start.VICTIMS[:2]]
    assert len(kills) == 6 and all(one.good for one in kills)
    assert "6 kills: 0 safe later than 200 ms" in capsys.readouterr().out


def test_every_pair_of_victim_and_manner_has_its_turn() -> None:
    drawn = list(cases(18, 3))
    assert len({(victim, manner) for victim, manner, _ in drawn}) == 9
    assert drawn == list(cases(18, 3))
    assert all(0.0 < wait < 4.0 for _, _, wait in drawn)


@pytest.fixture
def remote(tmp_path: Path) -> Path:
    path = tmp_path / "remote.xml"
    path.write_text(scene(hold=False), encoding="utf-8")
    return path


@pytest.mark.punctual
def test_a_guardian_that_dies_ends_the_session(remote: Path) -> None:
    import os

    with itouch.launch(remote) as handle:
        observer = Observer(handle.name, ("arm", "table"))
        os.kill(handle.guardian_pid, signal.SIGKILL)
        with pytest.raises(itouch.ServoError, match="guardian process has died"):
            handle.wait(300)
        assert observer.wait(300)
        assert all(time is not None for time in observer.safe_after(0).values())


def test_without_a_guardian_nothing_begins_to_obey(tmp_path: Path) -> None:
    import os

    path = tmp_path / "held.xml"
    path.write_text(scene(hold=True), encoding="utf-8")
    with itouch.launch(path) as handle:  # it waits for somebody to hold the switch
        observer = Observer(handle.name, ("arm", "table", "peltier"))
        os.kill(handle.guardian_pid, signal.SIGKILL)
        with pytest.raises(itouch.ServoError, match="nothing is enabled without it"):
            handle.wait(300)
        assert observer.wait(300)
        assert not any(flags & twin_protocol.BEGUN for steps in observer.seen.values() for _, flags in steps)
        assert handle.link.tick == 0


def test_what_is_on_its_way_out_holds_its_socket_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that ends gives its environment back first, and its sockets when its memory is free."""
    held = [["a local socket"], ["a local socket"], []]
    monkeypatch.setattr(kills_at_start, "_left", lambda mark: tuple(held.pop(0)) if held else ())
    kills_at_start._await_nothing("nobody-1", ())
    assert held == []


@pytest.mark.punctual
def test_a_second_opener_makes_one_twin_safe_and_the_session_notices(remote: Path) -> None:
    with itouch.launch(remote) as handle:
        line = twin_protocol.connect(twin_protocol.address(handle.name, "table"), 10.0)
        line.send(twin_protocol.SAFE + b"a test")
        with pytest.raises(itouch.DeviceFaultError, match="table") as caught:
            handle.wait(300)
        assert "made itself safe" in str(caught.value)
        line.close()


def test_on_the_virtual_clock_a_remote_twin_runs_here_and_gives_the_same_state(tmp_path: Path) -> None:
    states = []
    for remote in (True, False):
        path = tmp_path / f"{remote}.xml"
        path.write_text(scene(remote=remote, hold=False), encoding="utf-8")
        engine = itouch.build(path)
        engine.run(1.5)
        states.append(engine.state.tobytes())
    assert states[0] == states[1]


def test_a_twin_may_not_be_far_away(tmp_path: Path) -> None:
    path = tmp_path / "far.xml"
    path.write_text(scene().replace('twin="remote"', 'twin="far"'), encoding="utf-8")
    with pytest.raises(itouch.SceneError, match="'far' is neither yes nor no, nor remote"):
        itouch.build(path)


def test_the_launcher_s_death_ends_the_session(remote: Path) -> None:
    import subprocess
    import sys

    code = f"""
import itouch, time
handle = itouch.launch({str(remote)!r}, name="orphan")
print(handle.pid, handle.guardian_pid, flush=True)
time.sleep(60)
"""
    launcher = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert launcher.stdout is not None
    pids = [int(word) for word in launcher.stdout.readline().split()]
    assert len(pids) == 2
    observer = Observer("orphan", ("arm", "table", "peltier"))
    launcher.kill()
    launcher.wait()
    launcher.stdout.close()
    assert observer.wait(300)
    assert all(time is not None for time in observer.safe_after(0).values())
    deadline = time.monotonic() + 300
    while any(_lives(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(_lives(pid) for pid in pids)


def _lives(pid: int) -> bool:
    """Tell whether a process runs; one that nobody has waited for is as good as gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
