"""A device that is lost while a session ends is a fault: nobody is told that it is safe."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from third_party_plugins import install

import itouch
from itouch.servo import ServoError, attach, sessions

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

PLUGIN = """
import os
from dataclasses import dataclass
from itouch.plugin import Device, DeviceError, Opening, deadman, pose, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

class Stick(Device):
    "An arm whose cable comes out when its force goes back to zero."
    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    watchdog = 0.1
    pushed = lost = False
    def open(self):
        self.pushed = self.lost = False
    def close(self):
        pass
    def read(self, reading):
        if self.lost:
            raise DeviceError("its cable is out")
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
        reading["deadman"] = 1.0
    def write(self, command):
        pushes = bool(command["wrench"].any())
        self.lost |= self.pushed and not pushes
        self.pushed |= pushes
        if self.lost:
            raise DeviceError("its cable is out")
        if pushes:
            open(os.environ["PUSHES"], "w").close()
"""
SCENE = """<itouch version="1.0">
  <devices><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick"/></interaction>
</itouch>
"""
SAID = "failed: its cable is out; as the session ended it could not be seen to be safe"


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = install(tmp_path, "leaves", "[itouch.devices]\nstick = leaves:Stick\n", code=PLUGIN)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PUSHES", str(tmp_path / "pushes"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", ""))))
    path = tmp_path / "scene.xml"
    path.write_text(SCENE, "utf-8")
    return path


def push(process: subprocess.Popen[str], pushes: Path) -> None:
    """Let the session of a process push with the stick, and return when it does, or has ended."""
    while process.poll() is None and not pushes.exists():
        for info in sessions():
            if info.name.startswith(f"scene-{process.pid}-") and info.phase == "running":
                with contextlib.suppress(ServoError), attach(info.name) as link:
                    link.command("stick.wrench", [0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        time.sleep(0.05)


def test_who_ends_a_session_is_not_told_that_a_lost_device_is_safe(scene: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    words = [sys.executable, "-m", "itouch_tools.cli", "run", str(scene), "--headless", "--report", str(report)]
    with subprocess.Popen(
        [*words, "--for", "600 s"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as run:
        push(run, tmp_path / "pushes")
        run.send_signal(signal.SIGINT)
        said = run.communicate()[0]
    assert run.returncode == 1, said
    assert f"fault[device-error]: device 'stick' {SAID}" in said
    assert "not all could be seen to be safe" in said and "the devices are safe" not in said
    (fault,) = json.loads(report.read_text())["faults"]
    assert fault["cause"] == SAID and fault["trip"] == "device-error" and not fault["safe"]["reached"]


def test_a_script_that_closes_its_session_gets_the_fault(scene: Path) -> None:
    session = itouch.build(scene)
    session.enable()
    session.run(0.01)
    session.state["stick.command.wrench"][2] = 1.0
    session.run(0.05)
    with pytest.raises(itouch.DeviceFaultError, match="as the session ended it could not be seen to be safe"):
        session.close()
    (fault,) = session.report()["faults"]
    assert fault["cause"] == SAID
