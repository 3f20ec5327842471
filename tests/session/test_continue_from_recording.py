"""A session goes on from a recording: from the last whole State in it, whatever ended it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shipped import SCENES

import itouch

SCENE = SCENES / "first_touch.xml"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 10.5 s: it holds the States of 0 and of 10 s, and after a mark from outside that of its end."""
    path = tmp_path_factory.mktemp("recorded") / "touch.mcap"
    with itouch.build(SCENE, seed=4) as session:
        session.record(path)
        session.run(10.5)
    return path


def test_it_goes_on_as_the_session_would_have(recorded: Path) -> None:
    session = itouch.restore(recorded)
    assert 10_000 <= session.ticks <= 10_500
    straight = itouch.build(SCENE, seed=4)
    straight.run(session.ticks * 1e-3)
    for one in (session, straight):
        one.run(0.5)
    assert session.state.tobytes() == straight.state.tobytes()
    assert session.state["seed"] == 4


def test_a_killed_session_goes_on_from_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    words = [sys.executable, "-m", "itouch_tools.cli", "run", str(SCENE), "--for", "2000s", "--pace", "fast"]
    running = subprocess.Popen(
        [*words, "--headless", "--record", str(path)], start_new_session=True, stdout=subprocess.DEVNULL
    )
    try:
        until = time.monotonic() + 300
        while time.monotonic() < until and (not path.exists() or path.stat().st_size < 200_000):
            time.sleep(0.02)
    finally:
        os.killpg(running.pid, signal.SIGKILL)
        running.wait()
    done = subprocess.run(
        [sys.executable, "-m", "itouch_tools.cli", str(path), "--headless", "--for", "0.2s"],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "0 faults" in done.stdout


def test_a_recording_cut_to_pieces_is_refused_with_a_sentence(recorded: Path, tmp_path: Path) -> None:
    data = recorded.read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in (8, 40, 200, 1500):
        cut.write_bytes(data[:size])
        with pytest.raises(itouch.SessionError, match=r"cut\.mcap"):
            itouch.restore(cut)


def test_a_state_at_a_fault_is_not_gone_on_from(tmp_path: Path) -> None:
    path = tmp_path / "fault.mcap"
    session = itouch.build(SCENES / "faults.xml", seed=4)
    session.record(path)
    with pytest.raises(itouch.DeviceFaultError):
        session.run()
    session.close()
    reasons = [letter["reason"] for letter in itouch.read(path).states]
    assert "fault" in reasons
    again = itouch.restore(path)
    assert again.status("table").name != "FAULT"
    again.close()
