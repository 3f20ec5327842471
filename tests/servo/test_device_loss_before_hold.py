"""Hardware that is lost while a session waits for somebody to hold the switch: nobody is asked to hold it for that."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from third_party_plugins import install

PLUGIN = """
import os, time
from dataclasses import dataclass
from itouch.plugin import Device, DeviceError, Opening, pose, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

class Stick(Device):
    "An arm without a switch of its own."
    Params = Nothing
    reads = (pose(),)
    commands = (wrench(force=3.0),)
    opening = Opening(second_opener=True, moves_on_open={moves})
    begun = 0.0
    @classmethod
    def unavailable_reason(cls, bound):
        cls.begun = cls.begun or time.monotonic()
        return "there is nothing at its port" if time.monotonic() > cls.begun + 1.0 else ""
    def open(self):
        self.begun = time.monotonic()
    def close(self):
        pass
    def read(self, reading):
        if time.monotonic() > self.begun + 1.0:
            raise DeviceError("its cable is out")
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
    def write(self, command):
        pass
    def make_safe(self, command):
        pass
"""
SCENE = """<itouch version="1.0">
  <devices><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""


@pytest.mark.parametrize(
    ("moves", "said"), [(False, "failed: its cable is out"), (True, "there is nothing at its port")]
)
def test_a_device_lost_before_the_hold_ends_the_wait_and_is_told(tmp_path: Path, moves: bool, said: str) -> None:
    install(tmp_path, "waits", "[itouch.devices]\nstick = waits:Stick\n", code=PLUGIN.format(moves=moves))
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    path = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    words = ["run", str(tmp_path / "scene.xml"), "--headless", "--for", "1 s"]
    done = subprocess.run(
        [sys.executable, "-m", "itouch_tools.cli", *words], capture_output=True, text=True, timeout=600, check=False,
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "nobody holds a dead-man's switch" in done.stderr  # it had waited
    assert f"device 'stick': {said}" in done.stderr and "Traceback" not in done.stderr
