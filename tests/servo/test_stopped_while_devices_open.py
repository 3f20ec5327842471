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
from strangers import install

import itouch
from itouch.servo import Handle

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

PLUGIN = """
import os, time
from dataclasses import dataclass
from itouch.plugin import Device, Opening, Role, current, deadman, pose, temperature, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

def note(text):
    with open(os.environ["OPENING"] + "/log", "a") as stream:
        stream.write(text + "\\n")

def may_go_on(name):
    while not os.path.exists(os.environ["OPENING"] + "/" + name):
        time.sleep(0.01)

class Pad(Device):
    "A plate that opens when it is told."
    Params = Nothing
    reads = (temperature("plate", role=Role.SKIN_CONTACT_TEMPERATURE),)
    commands = (current(limit=4.0),)
    opening = Opening(second_opener=True, moves_on_open="MOVES" in os.environ)
    def open(self):
        note("pad opens")
        may_go_on("lets")
        note("pad is open")
    def close(self):
        note("pad is closed")
    def read(self, reading):
        reading["plate"] = 303.15
    def write(self, command):
        note("pad was commanded")
    def make_safe(self, command):
        note("the guardian acted")

class Stick(Device):
    "An arm that is there at once."
    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    opening = Opening(second_opener=True)
    def open(self):
        note("stick is open")
    def close(self):
        note("stick is closed")
    def read(self, reading):
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
        reading["deadman"] = 1.0
    def write(self, command):
        assert not any(command["wrench"].tolist())
    def make_safe(self, command):
        note("the guardian acted")
"""
SCENE = """<itouch version="1.0">
  <devices><device name="pad" plugin="pad" twin="no"/><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""
#: Devices may take 15 s to open; one that was given up is waited for as long as one that is closed.
SOON = 8.0


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a scene whose pad opens when there is a file ``lets`` beside it."""
    points = "[itouch.devices]\nstick = opens_slowly:Stick\npad = opens_slowly:Pad\n"
    folder = install(tmp_path, "opens_slowly", points, code=PLUGIN)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", ""))))
    monkeypatch.setenv("OPENING", str(tmp_path))
    path = tmp_path / "scene.xml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def log(scene: Path) -> list[str]:
    found = scene.parent / "log"
    return found.read_text().splitlines() if found.exists() else []


def until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, "it never became true"
        time.sleep(0.01)


def both_begun(scene: Path) -> bool:
    return {"pad opens", "stick is open"} <= set(log(scene))


@pytest.fixture
def handle(scene: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Handle]:
    """A session whose pad is being opened, since it was enabled."""
    monkeypatch.setenv("MOVES", "yes")
    with itouch.launch(scene, seconds=60.0, realtime=False) as found:
        found.command("enable")
        until(lambda: both_begun(scene))
        yield found


@pytest.mark.parametrize("how", ["stop", "SIGTERM"])
def test_to_stop_waits_for_no_device_to_open(scene: Path, handle: Handle, how: str) -> None:
    begin = time.monotonic()
    if how == "SIGTERM":
        os.kill(handle.pid, signal.SIGTERM)
    else:
        handle.request_stop()
    until(lambda: "stick is closed" in log(scene), 2.0)
    assert handle.wait(SOON)
    assert time.monotonic() - begin < SOON
    assert set(log(scene)) == {"pad opens", "stick is open", "stick is closed"}


def test_what_opens_after_the_stop_is_closed(scene: Path, handle: Handle) -> None:
    handle.request_stop()
    until(lambda: "stick is closed" in log(scene), 2.0)
    (scene.parent / "lets").touch()
    assert handle.wait(SOON)
    assert log(scene)[-2:] == ["pad is open", "pad is closed"]
    assert "pad was commanded" not in log(scene)
    assert "the guardian acted" not in log(scene)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_command_line_at_once(
    scene: Path, monkeypatch: pytest.MonkeyPatch, number: int, moves: bool
) -> None:
    """What opening does not move is opened before anybody is asked to hold a switch."""
    if moves:
        monkeypatch.setenv("MOVES", "yes")
    command = [sys.executable, "-m", "itouch", str(scene), "--for", "60s", "--headless", "--no-record"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as running:
        until(lambda: both_begun(scene) or running.poll() is not None)
        begin = time.monotonic()
        running.send_signal(number)
        said, _ = running.communicate(timeout=60.0)
    assert time.monotonic() - begin < SOON, said
    assert running.returncode == 128 + number, said
    assert "Traceback" not in said
    assert "stick is closed" in log(scene)


def test_ctrl_c_in_a_script_closes_what_was_opened(scene: Path) -> None:
    """Without a ``with``: nobody closes the engine after that."""
    engine = itouch.build(scene)

    def interrupt() -> None:
        if both_begun(scene):
            raise KeyboardInterrupt

    engine.on.waiting.append(interrupt)
    with pytest.raises(KeyboardInterrupt):
        engine.enable()
    assert "stick is closed" in log(scene)
    (scene.parent / "lets").touch()
    until(lambda: log(scene)[-1] == "pad is closed")
