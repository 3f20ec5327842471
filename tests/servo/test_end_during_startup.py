"""A session that is asked to end while it is being built: its process unwinds at once, and tells why."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from shipped import SCENES

from itouch.servo import ServoError, launching
from itouch_tools.cli import main

SLOW = """
import time
from pathlib import Path

def serve(segment, outbox, config):
    place = Path(config["place"])
    try:
        (place / "begun").touch()
        time.sleep(600.0)
    finally:
        (place / "unwound").touch()
"""


def test_a_session_that_is_asked_to_end_is_not_built_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling may take a minute: what helps it, and its folder, would outlive a process that is killed instead."""
    (tmp_path / "slow_to_build.py").write_text(SLOW, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))  # the process gets it, too
    handle = launching.begin("slow", {"serves": "slow_to_build:serve", "place": str(tmp_path)})
    until = time.monotonic() + 300.0
    while not (tmp_path / "begun").exists() and handle.running and time.monotonic() < until:
        time.sleep(0.01)
    handle.request_stop()
    with pytest.raises(ServoError, match="asked to end while it began: nothing was enabled"):
        handle.await_ready()
    assert (tmp_path / "unwound").exists()
    assert not handle.built
    handle.close()


MISSING = """
import sys

def serve(segment, outbox, config):
    if config["here"]:
        sys.modules["itouch.servo.error_transport"] = None
    raise ValueError("what went wrong")
"""


@pytest.mark.parametrize(("here", "said"), [(True, "changed while it ran; start it again"), (False, "what went wrong")])
def test_a_part_of_the_program_that_is_missing_while_it_is_upgraded_is_told(
    here: bool, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of the servo process, or of its launcher, which waited for ever."""
    (tmp_path / "broken_build.py").write_text(MISSING, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    if not here:
        monkeypatch.setitem(sys.modules, "itouch.servo.error_transport", None)
    handle = launching.begin("missing", {"serves": "broken_build:serve", "here": here})
    with pytest.raises(ServoError, match=said):
        assert handle.wait(120.0)
    handle.close()
    assert capfd.readouterr().err == ""


def test_a_process_that_does_not_know_yet_what_to_build_ends_too() -> None:
    handle = launching.begin("early", {"serves": "nothing:there"})
    handle.request_stop()
    with pytest.raises(ServoError):
        handle.await_ready()
    assert not handle.built
    handle.close()


STALLED = """
import time
from pathlib import Path

from itouch.servo import realtime
from itouch.servo.serve import serve as really

def serve(segment, outbox, config):
    def stalled():
        Path(config["place"], "begun").touch()
        time.sleep(600.0)

    realtime.be_punctual = stalled
    return really(segment, outbox, config)
"""


def test_a_signal_in_the_last_moment_of_the_start_is_told_as_one_during_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The session has been built then, but is not ready: its exit code was 1, and it replaced the saved one."""
    (tmp_path / "stalled_start.py").write_text(STALLED, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    known = launching.configured
    more = {"serves": "stalled_start:serve", "place": str(tmp_path)}
    monkeypatch.setattr(launching, "configured", lambda *words, **named: {**known(*words, **named), **more})

    def interrupt() -> None:
        until = time.monotonic() + 300.0
        while not (tmp_path / "begun").exists() and time.monotonic() < until:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    saved, told = tmp_path / "s.itouch", tmp_path / "r.json"
    saved.write_bytes(b"of an earlier run")
    threading.Thread(target=interrupt, daemon=True).start()
    words = ["run", str(SCENES / "first_touch.xml"), "--headless", "--pace", "real"]
    assert main([*words, "--save", str(saved), "--report", str(told)]) == 130
    assert capsys.readouterr().err == "stopped by SIGINT during the start; nothing was enabled\n"
    report = json.loads(told.read_text(encoding="utf-8"))
    assert (report["stopped_by"], report["simulated_s"]) == ("SIGINT", 0.0)
    assert saved.read_bytes() == b"of an earlier run"
