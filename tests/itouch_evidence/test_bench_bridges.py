"""What ``bench viewer --servo --rerun`` opens beside the loop is killed, frozen and counted with all that it starts."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from itouch.schema import ItouchError
from itouch_evidence import viewer_bridges
from itouch_evidence.viewer_servo import Viewers

#: As Rerun's own command does: the program that listens and draws is a child.
PARENT = """
import subprocess, sys
subprocess.call([sys.executable, "-c", sys.argv[1], *sys.argv[2:]])
"""
CHILD = """
import os, socket, sys
open(sys.argv[1], "w").write(str(os.getpid()))
with socket.create_server(("127.0.0.1", int(sys.argv[2]))):
    while True:
        pass
"""


class Parents(viewer_bridges.Told):
    extra = "rerun"

    def told(self, port: int) -> list[str]:
        return []


@pytest.fixture(autouse=True)
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_bridges, "need", lambda *_: None)
    monkeypatch.setattr(Viewers, "open", lambda *_: None)


def state_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return ""


def becomes(pid: int, *states: str) -> bool:
    """Wait until a process is in one of these states, as its ``stat`` gives them; "": it is gone."""
    end = time.monotonic() + 300.0
    while (found := state_of(pid)) not in states and time.monotonic() < end:
        time.sleep(0.01)
    return found in states


def test_a_program_is_frozen_counted_and_killed_with_its_children(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Parents, "program", ("-c", PARENT, CHILD, str(tmp_path / "pid")))
    program = Parents()
    program.open("session")
    child = int((tmp_path / "pid").read_text())
    try:
        end = time.monotonic() + 300.0
        while program.used < 0.2 and time.monotonic() < end:
            time.sleep(0.02)
        assert program.used >= 0.2
        program.signal(signal.SIGSTOP)
        assert becomes(child, "T")
        program.signal(signal.SIGCONT)
        assert becomes(child, "R", "S")
        program.end()
        assert becomes(child, "Z", "")  # whoever has adopted it may have reaped it already
    finally:
        if state_of(child) not in ("", "Z"):
            os.kill(child, signal.SIGKILL)


def test_a_program_that_does_not_open_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Parents, "program", ("-c", "raise SystemExit('no graphics here')"))
    with pytest.raises(ItouchError, match="did not open its port: no graphics here"):
        Parents().open("session")
