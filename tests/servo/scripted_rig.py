"""An arm and a plate on real drivers' path, in any process: they do what files in a folder tell, and log what happens."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from third_party_plugins import install

from itouch.loop import Status
from itouch.servo import Handle

_PLUGIN = """
import os, time
from dataclasses import dataclass
from itouch.plugin import Device, DeviceError, Opening, Role, current, deadman, pose, temperature, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

def told(what):
    try:
        with open(os.path.join(os.environ["TOLD_RIG"], what)) as stream:
            return stream.read()
    except OSError:
        return ""

class Told(Device):
    Params = Nothing
    opening = Opening(second_opener=True)
    def note(self, text):
        with open(os.path.join(os.environ["TOLD_RIG"], "log"), "a") as stream:
            stream.write(f"{type(self).plugin} {text}\\n")
    def make_safe(self, command):
        self.note("made safe by the guardian")

class Stick(Told):
    "An arm that is there at once, with a switch that is held unless it is released."
    plugin = "stick"
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    def open(self):
        self.note("opened")
    def close(self):
        self.note("closed")
    def read(self, reading):
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
        reading["deadman"] = 0.0 if told("released") else 1.0
    def write(self, command):
        if any(command["wrench"].tolist()):
            self.note("driven")

class Pad(Told):
    "A plate that takes long to open, is gone, out or hot, if it is told so, and notes whether it is driven."
    plugin = "pad"
    reads = (temperature("plate", role=Role.SKIN_CONTACT_TEMPERATURE),)
    commands = (current(limit=4.0),)
    @classmethod
    def wires(cls, params):
        return (os.environ["TOLD_RIG"],)
    def open(self):
        self.note("opens")
        end = time.monotonic() + float(told("opening") or 0.0)
        while time.monotonic() < end or told("waits"):
            time.sleep(0.01)
        if told("gone"):
            raise DeviceError("there is nothing at its port")
        self.count = 0
        self.note("opened")
    def close(self):
        self.note("closed")
        time.sleep(float(told("closing") or 0.0))
    def read(self, reading):
        if told("out"):
            raise DeviceError("its cable is out")
        self.count += 1
        reading["plate"] = (373.15 if told("hot") else 303.15) + 1e-6 * (self.count % 7)
    def write(self, command):
        if float(command["current"][0]):
            self.note("driven")

class MovingPad(Pad):
    "One that moves when it is opened: it is opened when it is needed, not before."
    opening = Opening(second_opener=True, moves_on_open=True)
"""
_SCENE = """<itouch version="1.0">
  <devices>
    <device name="stick" plugin="scripted-stick" twin="no"/>
    <device name="pad" plugin="{pad}" twin="no" optional="{optional}"/>
  </devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""
_ENTRY_POINTS = """[itouch.devices]
scripted-stick = scripted_rig_plugin:Stick
scripted-pad = scripted_rig_plugin:Pad
scripted-moving-pad = scripted_rig_plugin:MovingPad
"""


@dataclass(frozen=True, slots=True)
class ScriptedRig:
    """The folder by which the devices are told what to do."""

    folder: Path

    @classmethod
    def of(cls, folder: Path, monkeypatch: pytest.MonkeyPatch) -> ScriptedRig:
        """Put the plugin into a folder where every process finds it, during a test."""
        install(folder, "scripted_rig_plugin", _ENTRY_POINTS, code=_PLUGIN)
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", ""))))
        monkeypatch.setenv("TOLD_RIG", str(folder))
        return cls(folder)

    def scene(self, *, moves: bool = False, optional: bool = False) -> Path:
        """Write the scene; ``moves``: the pad moves when it is opened."""
        path = self.folder / "scene.xml"
        pad = "scripted-moving-pad" if moves else "scripted-pad"
        path.write_text(_SCENE.format(pad=pad, optional=str(optional).lower()), encoding="utf-8")
        return path

    def tell(self, what: str, value: str = "yes") -> None:
        """Tell the devices: how long they take (``opening``, ``closing`` [s]), or what is the case until it is undone."""
        (self.folder / what).write_text(value, encoding="utf-8")

    def undo(self, what: str) -> None:
        """Let what was told no longer be the case."""
        (self.folder / what).unlink()

    def log(self, device: str) -> list[str]:
        """Return what has happened to a device."""
        found = self.folder / "log"
        lines = found.read_text(encoding="utf-8").splitlines() if found.exists() else []
        return [line.removeprefix(f"{device} ") for line in lines if line.startswith(f"{device} ")]

    def forget(self) -> None:
        """Begin the log anew."""
        self.undo("log")

    @property
    def made_safe(self) -> bool:
        """Whether the guardian had to make a device safe."""
        return any("made safe by the guardian" in self.log(device) for device in ("stick", "pad"))


def status(handle: Handle, device: str) -> Status:
    """Return the status of a device of a session."""
    return Status(int(handle.state[f"{device}.status"]))


def until(handle: Handle, true: Callable[[], bool], seconds: float = 60.0) -> None:
    """Wait until something is true; the session may not end before that."""
    deadline = time.monotonic() + seconds
    while not true():
        assert not handle.wait(0.01), "the session has ended"
        assert time.monotonic() < deadline, "it never became true"
