"""A session that is stopped while its devices are being opened ends at once: what was opened until then is closed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted_rig import ScriptedRig, until

import itouch
from itouch.servo import Handle

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

#: Devices may take 15 s to open; one that was given up is waited for as long as one that is closed.
SOON = 8.0


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ScriptedRig:
    """Return a rig whose pad opens when nothing makes it wait any more."""
    rig = ScriptedRig.of(tmp_path, monkeypatch)
    rig.tell("waits")
    return rig


def both_begun(rig: ScriptedRig) -> bool:
    return "opens" in rig.log("pad") and "opened" in rig.log("stick")


def wait_until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, "it never became true"
        time.sleep(0.01)


@pytest.fixture
def handle(rig: ScriptedRig) -> Iterator[Handle]:
    """A session whose pad is being opened, since it was enabled."""
    with itouch.launch(rig.scene(moves=True), seconds=60.0, realtime=False) as found:
        found.command("enable")
        until(found, lambda: both_begun(rig))
        yield found


@pytest.mark.parametrize("how", ["stop", "SIGTERM"])
def test_to_stop_waits_for_no_device_to_open(rig: ScriptedRig, handle: Handle, how: str) -> None:
    begin = time.monotonic()
    if how == "SIGTERM":
        os.kill(handle.pid, signal.SIGTERM)
    else:
        handle.request_stop()
    wait_until(lambda: "closed" in rig.log("stick"), 2.0)
    assert handle.wait(SOON)
    assert time.monotonic() - begin < SOON
    assert rig.log("pad") == ["opens"]
    assert rig.log("stick") == ["opened", "closed"]


def test_what_opens_after_the_stop_is_closed(rig: ScriptedRig, handle: Handle) -> None:
    handle.request_stop()
    wait_until(lambda: "closed" in rig.log("stick"), 2.0)
    rig.undo("waits")
    assert handle.wait(SOON)
    assert rig.log("pad") == ["opens", "opened", "closed"]


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_command_line_at_once(rig: ScriptedRig, number: int, moves: bool) -> None:
    """What opening does not move is opened before anybody is asked to hold a switch."""
    scene = rig.scene(moves=moves)
    command = [sys.executable, "-m", "itouch", str(scene), "--for", "60s", "--headless", "--no-record"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as running:
        wait_until(lambda: both_begun(rig) or running.poll() is not None)
        begin = time.monotonic()
        running.send_signal(number)
        said, _ = running.communicate(timeout=60.0)
    assert time.monotonic() - begin < SOON, said
    assert running.returncode == 128 + number, said
    assert "Traceback" not in said
    assert rig.log("stick") == ["opened", "closed"]


def test_ctrl_c_in_a_script_closes_what_was_opened(rig: ScriptedRig) -> None:
    """Without a ``with``: nobody closes the engine after that."""
    engine = itouch.build(rig.scene())

    def interrupt() -> None:
        if both_begun(rig):
            raise KeyboardInterrupt

    engine.on.waiting.append(interrupt)
    with pytest.raises(KeyboardInterrupt):
        engine.enable()
    assert rig.log("stick") == ["opened", "closed"]
    rig.undo("waits")
    wait_until(lambda: rig.log("pad")[-1] == "closed")
