"""A session in its servo process: the same bytes, a handle that tells, safe ends, errors with their cause."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.servo import attach, launching, sessions
from itouch.session.outputs import Outputs

Write = Callable[[str, str], Path]
FIRST = SCENES / "first_touch.xml"


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """Check that no test leaves a session, a process or shared memory behind."""
    before = _shared()
    yield
    deadline = time.monotonic() + 300
    while (_own() or _children() or _shared() - before) and time.monotonic() < deadline:
        time.sleep(0.02)  # what tests beside this one have there goes by itself, too
    assert not _own()
    assert not _children()
    assert not _shared() - before


def _shared() -> set[str]:
    """Return what this program has there by name; what others have comes and goes as they like."""
    return {name for name in os.listdir("/dev/shm") if "itouch" in name}


def _own() -> list[str]:
    return [info.name for info in sessions() if info.owner == os.getpid()]


def _children() -> list[str]:
    """Return the command lines of servo processes that this test run has started."""
    own, found = os.getpid(), []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit():
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                words = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                if parent == own and "itouch.servo" in words:
                    found.append(words)
        except OSError:
            continue
    return found


def _short(write: Write) -> Path:
    text = FIRST.read_text()
    for slow, quick in (('in="0.8 s"', 'in="0.1 s"'), ('in="0.5 s"', 'in="0.1 s"'), ('hold="0.5 s"', "")):
        text = text.replace(slow, quick)
    return write("short.xml", text)


@pytest.mark.punctual  # a period that a late loop leaves out is counted in State
def test_the_state_is_that_of_a_run_in_this_process(write: Write) -> None:
    path = _short(write)
    here = itouch.build(path, seed=5)
    here.run()
    with itouch.launch(path, seed=5) as handle:
        assert handle.wait(300)
        assert handle.state.dtype == here.state.dtype
        assert handle.state.tobytes() == here.state.tobytes()
        report = handle.report()
    assert report["contacts"] == here.report()["contacts"]
    assert handle.contacts == report["contacts"]
    assert report["pace"] == "real"
    servo = report["servo"]
    assert servo["ticks"] == here.ticks
    assert servo["overruns"] == sum(servo["culprits"].values())
    assert sum(count for *_, count in servo["histograms_us"]["tick"]) == here.ticks
    assert tuple(servo["parts_us"]) == here.plan.names
    assert all(part["p50"] is not None for part in servo["parts_us"].values())


def test_it_runs_while_the_handle_tells_and_stops_when_asked() -> None:
    with itouch.launch(FIRST, seconds=60, name="told") as handle:
        first = handle.seconds
        with attach("told") as link:
            assert _own() == ["told"]
            follower = link.follow()
            deadline = time.monotonic() + 300
            ticks: list[int] = []
            while len(ticks) < 250 and time.monotonic() < deadline:
                ticks += [entry.tick for entry in follower.take()]
                time.sleep(0.01)
            assert handle.seconds > first
            assert ticks == list(range(ticks[0], ticks[0] + len(ticks)))
            assert len(ticks) >= 250
            assert follower.dropped == 0
            assert link.objects == ("block",)
            assert link.alive
            live = handle.report()
            assert live["servo"]["ticks"] > 0
            assert handle.timing.ticks > 0
            handle.stop()
            assert not link.alive
            with pytest.raises(itouch.ServoError, match="has ended"):
                link.command("pause")
        assert not handle.running
        assert handle.report()["servo"]["ticks"] >= live["servo"]["ticks"]


def test_commands_take_effect_between_ticks() -> None:
    with itouch.launch(FIRST, seconds=60) as handle:
        handle.command("pause")
        _until(lambda: handle.seconds == _later(handle))
        paused = handle.seconds
        handle.command("resume")
        _until(lambda: handle.seconds > paused)
        handle.command("steer", {"probe": "finger", "step": [0.0, 0.0, 0.001]})
        handle.command("arm.wrench", [0, 0, 1, 0, 0, 0])
        handle.command("dance")
        _until(lambda: len(handle.refused) == 2)
        handle.stop()
        assert "written by the scene" in handle.refused[0]
        assert "no command 'dance'" in handle.refused[1]
        assert [entry["what"] for entry in handle.report()["commands"]] == ["pause", "resume", "steer"]


def _later(handle: itouch.Handle) -> float:
    time.sleep(0.05)
    return handle.seconds


def _until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 300
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_scene_that_is_wrong_is_told_as_here(write: Write) -> None:
    path = write("wrong.xml", FIRST.read_text().replace('stiffness="1.2 N/mm"', 'stifness="1.2 N/mm"'))
    with pytest.raises(itouch.SceneError) as here:
        itouch.build(path)
    with pytest.raises(itouch.SceneError) as there:
        itouch.launch(path)
    assert there.value.problems == here.value.problems
    assert "Traceback" in str(there.value.__cause__)
    with pytest.raises(ValueError, match="seconds"):
        itouch.launch(FIRST, seconds=float("nan"))
    with pytest.raises(ValueError, match="seed"):
        itouch.launch(FIRST, seed=-1)


def test_a_fault_is_raised_with_its_cause_and_the_report_stays() -> None:
    text = FIRST.read_text().replace("</itouch>", '<fault device="arm" kind="nan" at="0.2 s"/></itouch>')
    scene = _scene(text)
    with itouch.launch(scene) as handle:
        with pytest.raises(itouch.DeviceFaultError, match="arm") as caught:
            handle.wait(300)
        assert "Traceback" in str(caught.value.__cause__)
        (fault,) = [fault for fault in handle.report()["faults"] if fault["trip"] is not None]
        assert fault["device"] == "arm"
        assert np.all(handle.state["arm.sent.wrench"] == 0.0)


def test_a_report_that_is_wanted_while_the_session_ends_is_that_of_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the end of the servo process and the reading of its last message, it was 'session ... has ended'."""
    with itouch.launch(FIRST, seconds=0.2) as handle:
        wait, read = handle._guarded.wait, threading.Event()
        monkeypatch.setattr(handle._guarded, "wait", lambda: (read.wait(300), wait()))
        _until(lambda: not handle.link.alive)
        threading.Timer(0.1, read.set).start()
        assert handle.report()["servo"]["ticks"] == 200


def _scene(text: str) -> itouch.Scene:
    from itouch.plugin.discovery import Catalog
    from itouch.scene import loads

    return loads(text.encode(), Catalog(), shown="made.xml")


@pytest.mark.punctual  # a period that a late loop leaves out is counted in State
def test_a_session_is_saved_and_goes_on(tmp_path: Path) -> None:
    target = tmp_path / "s.itouch"
    with itouch.launch(FIRST, seconds=0.4, seed=3, save=target) as handle:
        handle.wait(300)
    with itouch.launch(target, seconds=0.3) as again:
        again.wait(300)
        end = again.state.tobytes()
    straight = itouch.build(FIRST, seed=3)
    straight.run(0.7)
    assert end == straight.state.tobytes()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_servo_process_that_is_ended_from_outside(number: signal.Signals) -> None:
    with itouch.launch(FIRST, seconds=60) as handle:
        os.kill(handle.pid, number)
        if number is signal.SIGTERM:  # safe first, then a whole report
            assert handle.wait(300)
            assert handle.report()["servo"]["ticks"] >= 0
            return
        with pytest.raises(itouch.ServoError, match="killed by SIGKILL"):
            handle.wait(300)
        with pytest.raises(itouch.ServoError, match="killed by SIGKILL"):
            handle.report()
        assert handle.state["tick"] >= 0  # the last State stays readable


def test_a_session_that_is_safe_and_finishes_its_files_slowly_is_not_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine that takes its time; the recording and the report were lost with the process."""
    monkeypatch.setattr("itouch.servo.handle.END_TIME", 0.3)
    with itouch.launch(FIRST, seconds=600, keep=Outputs(record=str(tmp_path / "r.mcap"))) as handle:
        _until(lambda: handle.link.tick > 50)
        (writer,) = Path(f"/proc/{handle.pid}/task/{handle.pid}/children").read_text(encoding="ascii").split()
        os.kill(int(writer), signal.SIGSTOP)
        handle.request_stop()
        _until(lambda: handle.link.phase == "ending")
        slow = threading.Timer(2.0, os.kill, (int(writer), signal.SIGCONT))
        slow.start()
        handle.stop()
        slow.join()
        assert handle.report()["servo"]["ticks"] > 50
    assert itouch.read(tmp_path / "r.mcap").whole


def test_a_session_that_can_not_be_saved_at_its_end_still_tells_why_it_ended(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(
        '<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/></devices>'
        '<fault device="arm" kind="nan" at="20 ms"/></itouch>', encoding="utf-8"
    )  # fmt: skip
    target = tmp_path / "s.itouch"
    target.mkdir()  # nothing can take its place
    with itouch.launch(tmp_path / "scene.xml", seconds=5.0, save=target) as handle:
        with pytest.raises(itouch.DeviceFaultError, match="NaN"):
            handle.wait(300)
        assert "not-a-number" in [fault["trip"] for fault in handle.report()["faults"]]


def test_sessions_without_a_name_that_begin_after_one_another_have_names_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of one process, of one scene, within a second: names are those of its shared memory and its socket."""
    for step in (1_000, 1_000_000, 123_457_000):
        nows = iter(range(0, 8 * step, step))
        monkeypatch.setattr(launching.time, "monotonic_ns", nows.__next__)
        names = [launching.named("a/touch.xml") for _ in range(8)]
        assert len(set(names)) == 8 and all(name.startswith(f"touch-{os.getpid()}-") for name in names)
