"""A session whose processes are suspended in the middle of a touch, the guardian too, and go on later."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
from test_harmful_plugin_code import PLUGIN, SCENE
from third_party_plugins import install

import itouch
from itouch.servo.launcher_pipe import Outbox, messages
from itouch.session.outputs import Outputs
from itouch_tools.cli.doctor.touch_scene import scene

#: For how long [s] nobody runs.
PAUSE = 0.6


def suspend(pids: list[int], pause: float) -> float:
    """Suspend these processes for so long [s], and let them go on in this order; return when they did [s]."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(pause)
    awake = time.monotonic()
    for pid in pids:
        os.kill(pid, signal.SIGCONT)
        time.sleep(0.002)
    return awake


@pytest.mark.punctual
@pytest.mark.parametrize("first", ["servo", "guardian"])
def test_hardware_is_let_go_when_a_session_and_its_guardian_go_on(
    first: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The force stood, and went on as if nothing had been; or the guardian killed what was about to end in order."""
    log, recorded = tmp_path / "log", tmp_path / "r.mcap"
    listed = "[itouch.modalities]\nevil.it = evil:Evil\n[itouch.devices]\nstick = evil:Stick\n"
    code = PLUGIN.format(act="        pass", file=str(log)).replace('(handle, f"', '(handle, f"{time.monotonic()} ')
    install(tmp_path, "evil", listed, code=code)
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    with itouch.launch(tmp_path / "scene.xml", seconds=60.0, enable=True, keep=Outputs(record=str(recorded))) as handle:
        while handle.running and handle.seconds < 1.2:  # it is ramped in
            time.sleep(0.01)
        pids = [handle.pid, handle.guardian_pid]
        awake = suspend(pids if first == "servo" else pids[::-1], PAUSE)
        with pytest.raises(itouch.ItouchError, match="'stick' was stopped: the loop stood still for 0.6 s"):
            handle.wait(300)
        (fault,) = handle.report()["faults"]
    assert (fault["trip"], fault["safe"]["reached"]) == ("overrun", True)
    lines = [line.split() for line in log.read_text(encoding="utf-8").splitlines()]
    sent = [float(what) for at, _, what in lines if float(at) >= awake and what not in ("open", "close")]
    assert sent[0] < 0.31 and sent[-1] == 0.0 and sum(force > 0.0 for force in sent) <= 1
    assert not any(Path(f"/proc/{pid}").exists() for pid in (handle.pid, handle.guardian_pid))
    outcome = itouch.replay(recorded)
    assert outcome.mismatches == 0 and outcome.ticks >= 1200


@pytest.mark.punctual
def test_of_a_suspended_session_of_twins_it_is_said_that_it_was_suspended(tmp_path: Path) -> None:
    """It was said to have hung."""
    (tmp_path / "scene.xml").write_text(scene(remote=False, hold=False), encoding="utf-8")
    with itouch.launch(tmp_path / "scene.xml", keep=Outputs(record=str(tmp_path / "r.mcap"))) as handle:
        while handle.running and handle.seconds < 0.3:
            time.sleep(0.01)
        os.kill(handle.pid, signal.SIGSTOP)
        with pytest.raises(
            itouch.ServoError, match=r"the servo process was suspended \(no beat for \d+ ms\) and was ended"
        ):
            handle.wait(300)
    assert itouch.replay(tmp_path / "r.mcap").mismatches == 0


@pytest.mark.punctual
def test_the_report_of_a_long_session_reaches_a_launcher_that_was_suspended_at_its_end() -> None:
    """What no longer fits into the pipe was lost after 5 s: a whole session ended as if its servo process had died."""
    near, far = socket.socketpair()
    report = {"contacts": ["a touch"] * 100_000}
    last = threading.Thread(target=Outbox(far).finish, args=({"report": report, "error": None},))
    with near, far:
        last.start()
        time.sleep(6.0)
        (told,) = messages(near)
        last.join()
    assert told == {"kind": "end", "report": report, "error": None}
