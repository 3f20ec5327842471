"""A session that was saved after a trip, in a new process: nothing is enabled on hardware until it is re-armed."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from strangers import install

import itouch
from itouch.loop import Status
from itouch.servo import Handle

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

PLUGIN = """
import os, time
from dataclasses import dataclass
from itouch.plugin import Device, DeviceError, Opening, Role, current, deadman, pose, temperature, wrench

@dataclass(frozen=True, slots=True)
class Nothing:
    "Nothing to set."

def said(name):
    try:
        with open(os.path.join(os.environ["RESTORED"], name)) as stream:
            return stream.read()
    except OSError:
        return ""

def note(text):
    with open(os.path.join(os.environ["RESTORED"], "log"), "a") as stream:
        stream.write(text + "\\n")

class Stick(Device):
    "An arm with a switch that is held unless the test says otherwise."
    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    opening = Opening(second_opener=True)
    def open(self):
        pass
    def close(self):
        pass
    def read(self, reading):
        reading["pose"] = (0, 0, 0.1, 1, 0, 0, 0)
        reading["deadman"] = 0.0 if said("released") else 1.0
    def write(self, command):
        pass
    def make_safe(self, command):
        note("the guardian acted")

class Pad(Device):
    "A plate that takes as long to open as it is told, and notes whether it is driven."
    Params = Nothing
    reads = (temperature("plate", role=Role.SKIN_CONTACT_TEMPERATURE),)
    commands = (current(limit=4.0),)
    opening = Opening(second_opener=True, moves_on_open=True)  # so it is opened when it is needed, not before
    def open(self):
        note("open")
        time.sleep(float(said("opening") or 0.0))
        if said("gone"):
            raise DeviceError("there is nothing at its port")
        self.count = 0
    def close(self):
        note("close")
    def read(self, reading):
        self.count += 1
        reading["plate"] = (373.15 if said("hot") else 303.15) + 1e-6 * (self.count % 7)
    def write(self, command):
        if float(command["current"][0]):
            note("driven")
    def make_safe(self, command):
        note("the guardian acted")
"""
SCENE = """<itouch version="1.0">
  <devices><device name="stick" plugin="stick" twin="no"/><device name="pad" plugin="pad" twin="no"/></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""
Restore = Callable[[], Handle]


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder in which the devices are told what to do; in it, a session that was saved after a trip."""
    points = "[itouch.devices]\nstick = restored_rig:Stick\npad = restored_rig:Pad\n"
    folder = install(tmp_path, "restored_rig", points, code=PLUGIN)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", ""))))
    monkeypatch.setenv("RESTORED", str(tmp_path))
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    saved = tmp_path / "s.itouch"
    handle = itouch.launch(tmp_path / "scene.xml", seconds=60.0, linger=True, enable=True, realtime=False)
    handle.__enter__()
    handle.command("pad.current", [-3.0])
    until(handle, lambda: "driven" in log(tmp_path))
    (tmp_path / "hot").write_text("yes")
    until(handle, lambda: bool(handle.faults))
    handle.command("save", str(saved))
    until(handle, saved.exists)
    ended(handle)
    (tmp_path / "hot").unlink()
    (tmp_path / "log").unlink()
    return tmp_path


@pytest.fixture
def restore(rig: Path) -> Iterator[Restore]:
    """Return what launches the saved session in a new process; it rests as soon as that has found the trip."""
    handles: list[Handle] = []

    def launched() -> Handle:
        handle = itouch.launch(rig / "s.itouch", seconds=60.0, linger=True, enable=True, realtime=False)
        handles.append(handle.__enter__())
        until(handle, lambda: bool(handle.faults))
        return handle

    yield launched
    for handle in handles:
        ended(handle)


def ended(handle: Handle) -> None:
    with contextlib.suppress(itouch.DeviceFaultError):  # the one for which all was stopped
        handle.stop()
        handle.__exit__(None, None, None)


def status(handle: Handle, device: str) -> Status:
    return Status(int(handle.state[f"{device}.status"]))


def until(handle: Handle, true: Callable[[], bool], seconds: float = 60.0) -> None:
    """Wait until something is true; the session may not end before that."""
    deadline = time.monotonic() + seconds
    while not true():
        assert not handle.wait(0.01), "the session has ended"
        assert time.monotonic() < deadline, "it never became true"


def log(rig: Path) -> list[str]:
    found = rig / "log"
    return found.read_text().splitlines() if found.exists() else []


def rests(handle: Handle, rig: Path) -> None:
    """Check that nothing is enabled, and nothing has been driven, for a while."""
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        assert not handle.wait(0.01)
        assert Status.ENABLED not in (status(handle, "stick"), status(handle, "pad"))
    assert "driven" not in log(rig)


@pytest.mark.parametrize("opening", [0.0, 1.0])
def test_nothing_is_enabled_until_it_is_re_armed(rig: Path, restore: Restore, opening: float) -> None:
    """Also if a device takes long to open: the guardian does not take the session for one that hangs."""
    (rig / "opening").write_text(str(opening))
    handle = restore()
    rests(handle, rig)
    assert handle.faults[0]["trip"] == "plate-temperature"
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is status(handle, "stick") is Status.ENABLED)
    assert handle.refused == []
    assert "the guardian acted" not in log(rig)


@pytest.mark.parametrize(
    ("told", "words"),
    [("gone", "there is nothing at its port"), ("released", "nobody holds the dead-man's switch"), ("hot", "re-armed")],
)
def test_what_keeps_it_from_being_re_armed_is_told(rig: Path, restore: Restore, told: str, words: str) -> None:
    """A plate that cannot be opened, or is still hot; a switch that nobody holds: when that is over, it is re-armed."""
    handle = restore()
    (rig / told).write_text("yes")
    handle.command("rearm")
    until(handle, lambda: bool(handle.refused))
    assert words in handle.refused[0]
    rests(handle, rig)
    (rig / told).unlink()
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is status(handle, "stick") is Status.ENABLED)


def test_to_stop_waits_for_no_device_that_re_arming_opens(rig: Path, restore: Restore) -> None:
    handle = restore()
    (rig / "opening").write_text("12")
    handle.command("rearm")
    until(handle, lambda: "open" in log(rig))
    begin = time.monotonic()
    handle.request_stop()
    with pytest.raises(itouch.DeviceFaultError, match="plate-temperature"):
        handle.wait(60.0)
    assert time.monotonic() - begin < 8.0
    assert "driven" not in log(rig)
