"""What is not kept any more is told at once, on the terminal and in the report, in sentences that are true."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import itouch
from itouch.schema.durable import GONE
from itouch.servo import sessions
from itouch.session.recorder import ROWS
from itouch_tools.report.screen import _fault
from itouch_tools.viewer.fault_messages import outcome, told, what

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm"/></devices>{record}
</itouch>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "s.xml").write_text(SCENE.format(record=""), encoding="utf-8")
    return tmp_path / "s.xml"


def _kill(session: itouch.Session) -> None:
    assert session.recorder is not None
    os.kill(session.recorder.process_id, signal.SIGKILL)
    session.recorder._process.wait()


def test_a_killed_recorder_is_told_within_a_second_of_the_session(scene: Path) -> None:
    session, heard = itouch.build(scene), list[dict[str, Any]]()
    session.loss_hooks.append(heard.append)
    session.record(scene.parent / "r.mcap")
    session.run(0.5)
    _kill(session)
    session.run(0.5)
    assert [(loss["trip"], loss["ends"]) for loss in heard] == [("recording", False)]
    assert heard[0]["time_s"] < 0.6
    session.run(0.5)
    session.close()
    assert len(heard) == 1


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
@pytest.mark.parametrize("ends", [False, True])
def test_a_recorder_that_dies_while_its_ring_is_full_is_told(scene: Path, ends: bool) -> None:
    """A simulated run fills the ring faster than it is written; with no row to copy, nothing looked at the process."""
    policy = "stop" if ends else "go-on"
    scene.write_text(SCENE.format(record=f'<record to="x.mcap" on-failure="{policy}"/>'), encoding="utf-8")
    session, heard = itouch.build(scene), list[dict[str, Any]]()
    session.loss_hooks.append(heard.append)
    recorder = session.record(scene.parent / "r.mcap")

    def kill() -> None:
        while recorder.waiting < ROWS:
            time.sleep(0.01)
        os.kill(recorder.process_id, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    os.kill(recorder.process_id, signal.SIGSTOP)
    killer.start()
    session.run(10.0)
    killer.join()
    assert [(loss["trip"], loss["ends"]) for loss in heard] == [("recording", ends)]
    assert "the writing process died" in heard[0]["cause"]
    assert ROWS <= heard[0]["tick"] <= ROWS + 1
    assert session.ticks == (heard[0]["tick"] if ends else 10000)
    session.close()
    assert len(heard) == 1


def test_a_recorder_that_has_died_since_the_loop_last_looked_is_told_at_the_end(scene: Path) -> None:
    session, heard = itouch.build(scene), list[dict[str, Any]]()
    session.loss_hooks.append(heard.append)
    session.record(scene.parent / "r.mcap")
    session.run(0.5)
    _kill(session)  # which asks for its return code
    with pytest.raises(itouch.RecordingError, match="the writing process died"):
        session.end_recording()
    assert [loss["trip"] for loss in heard] == ["recording"]
    session.close()


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
def test_in_real_time_samples_that_are_lost_are_told_while_the_process_hangs(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.session.recorder.ROWS", 64)
    session, heard = itouch.build(scene), list[dict[str, Any]]()
    session.loss_hooks.append(heard.append)
    recorder = session.record(scene.parent / "r.mcap")
    session.clock = itouch.WallClock()
    os.kill(recorder.process_id, signal.SIGSTOP)
    try:
        for _ in range(300):
            session.tick()
    finally:
        os.kill(recorder.process_id, signal.SIGCONT)
    assert [loss["tick"] <= 129 for loss in heard] == [True]
    assert "samples are lost" in heard[0]["cause"]
    session.close()


def test_who_listens_beside_a_recorder_that_fails_hears_of_every_tick(scene: Path) -> None:
    session, heard, after = itouch.build(scene), list[int](), list[int]()
    session.taps.append(heard.append)
    session.record(scene.parent / "r.mcap")
    session.taps.append(after.append)
    session.run(0.2)
    _kill(session)
    session.run(0.2)
    assert len(session.taps) == 2
    assert heard == after == list(range(400))
    session.close()


def test_a_scene_chooses_to_end_the_session(scene: Path) -> None:
    scene.write_text(SCENE.format(record='<record to="x.mcap" on-failure="stop"/>'), encoding="utf-8")
    session = itouch.build(scene)
    session.record(scene.parent / "r.mcap")
    session.run(0.2)
    _kill(session)
    session.run(5.0)
    assert session.seconds < 0.4
    assert session.failed
    assert session.report()["faults"][0]["ends"] is True
    session.close()


def test_a_save_that_fails_again_and_again_is_told_once_and_counted(scene: Path) -> None:
    session, heard = itouch.build(scene), list[dict[str, Any]]()
    session.loss_hooks.append(heard.append)
    folder = scene.parent / "gone"
    folder.mkdir()
    with session.saving(folder / "s.itouch", 0.1):
        folder.rmdir()
        folder.write_text("a file, not a folder")
        session.run(2.0)
    assert len(heard) == 1
    (fault,) = session.report()["faults"]
    assert fault["trip"] == "saving"
    assert fault["times"] > 5
    text = _fault(fault)
    assert "made safe" not in text
    assert "session: goes on; the devices are as they were" in text
    assert f"{fault['times']} times" in text


def test_sentences_say_what_happened_and_only_that() -> None:
    stopped = {"trip": "sensor-range", "device": "arm", "cause": "reads 9 m", "time_s": 1.0, "scene": None}
    assert outcome({**stopped, "safe": {"reached": True}}) == ["devices: all have been made safe"]
    assert "not all" in outcome({**stopped, "safe": {"reached": False}})[0]
    assert outcome(stopped) == []
    assert outcome({**stopped, "optional": True}) == ["devices: the session goes on without 'arm', which is optional"]
    assert outcome({"trip": None, "device": "arm", "cause": "was given a fault"}) == []
    lost = {"trip": "recording", "device": "recorder", "cause": "cannot write 'x': disk full", "time_s": 2.5}
    assert what(lost) == "cannot write 'x': disk full"
    assert told(lost).startswith("RECORDING LOST at 2.500 s: cannot write 'x': disk full\n  = help: ")
    assert "ends now" in told({**lost, "ends": True})
    assert "free the disk" in told({**lost, "trip": "saving"})
    gone = {**lost, "cause": f"cannot write 'x': {GONE}"}
    for ends, after in ((False, "nothing more is recorded"), (True, "the session ends now")):
        assert "is gone, too" in told({**gone, "ends": ends})
        assert after in told({**gone, "ends": ends})
        assert "is whole" not in told({**gone, "ends": ends})


def test_the_terminal_of_a_session_in_real_time_says_it_at_once(scene: Path) -> None:
    words = [sys.executable, "-m", "itouch_tools.cli", str(scene), "--headless", "--pace", "real", "--for", "600s",
             "--record", str(scene.parent / "r.mcap")]  # fmt: skip
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            writer = _recorder_of(process.pid)
            _grows(scene.parent / "r.mcap")
            os.kill(writer, signal.SIGKILL)
            assert process.stderr is not None
            for line in process.stderr:
                if line.startswith("RECORDING LOST"):
                    break
            assert [info.phase for info in sessions() if info.owner == process.pid] == ["running"]
            assert "= help: what was written before is whole" in process.stderr.readline()
        finally:
            process.send_signal(signal.SIGINT)
        process.stderr.read()


def _grows(path: Path) -> None:
    """Wait until the loop runs and is recorded: the file has grown again and again."""
    sizes, end = set[int](), time.monotonic() + 300.0
    while len(sizes) < 6 and time.monotonic() < end:
        if path.exists():
            sizes.add(path.stat().st_size)
        time.sleep(0.05)


def _recorder_of(launcher: int) -> int:
    """Return the process that writes for a program's session, when it has begun to write."""
    end = time.monotonic() + 300.0
    while time.monotonic() < end:
        for folder in Path("/proc").iterdir():
            try:
                line = (folder / "cmdline").read_bytes() if folder.name.isdigit() else b""
                servo = int((folder / "stat").read_text().rpartition(")")[2].split()[1]) if line else 0
                grand = int(Path(f"/proc/{servo}/stat").read_text().rpartition(")")[2].split()[1]) if servo else 0
            except OSError:
                continue
            if b"itouch.recording.writing_process" in line and grand == launcher:
                return int(folder.name)
        time.sleep(0.02)
    raise AssertionError("nothing is recorded")


def test_a_pipe_is_no_file_to_record_into(scene: Path) -> None:
    """Its recorder waited for somebody who reads, for ever, whoever else had ended."""
    os.mkfifo(scene.parent / "r.mcap")
    with itouch.build(scene) as session:
        with pytest.raises(itouch.ItouchError, match=r"cannot write '.*r\.mcap': it is a pipe, not a file"):
            session.record(scene.parent / "r.mcap")
        assert session.recorder is None
