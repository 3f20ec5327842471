"""A device that takes long to open is reconnected beside the loop: the session lives, and the others go on."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from strangers import install

import itouch
from itouch.loop import Status
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.servo import Handle
from itouch.session.outputs import Outputs
from itouch_tools.cli import main

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
        with open(os.path.join(os.environ["RECONNECTING"], name)) as stream:
            return stream.read()
    except OSError:
        return ""

def note(text):
    with open(os.path.join(os.environ["RECONNECTING"], "log"), "a") as stream:
        stream.write(text + "\\n")

class Stick(Device):
    "An arm that is always there."
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
        reading["deadman"] = 1.0
    def write(self, command):
        pass
    def make_safe(self, command):
        note("the guardian acted")

class Pad(Device):
    "A plate that takes as long to open as it is told, and whose cable is out when it is told that."
    Params = Nothing
    reads = (temperature("plate", role=Role.SKIN_CONTACT_TEMPERATURE),)
    commands = (current(limit=4.0),)
    opening = Opening(second_opener=True)
    @classmethod
    def wires(cls, params):
        return (os.environ["RECONNECTING"],)
    def open(self):
        note("open")
        time.sleep(float(said("opening") or 0.0))
        if said("gone"):
            raise DeviceError("there is nothing at its port")
        note("opened")
    def close(self):
        note("close")
        time.sleep(float(said("closing") or 0.0))
    def read(self, reading):
        if said("out"):
            raise DeviceError("its cable is out")
        reading["plate"] = 373.15 if said("hot") else 303.15
    def write(self, command):
        pass
    def make_safe(self, command):
        note("the guardian acted")
"""
SCENE = """<itouch version="1.0">
  <devices>
    <device name="stick" plugin="stick" twin="no"/><device name="pad" plugin="pad" twin="no" optional="{}"/>
  </devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""
Launch = Callable[..., Handle]


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder in which the pad is told what to do."""
    points = "[itouch.devices]\nstick = slow_to_open:Stick\npad = slow_to_open:Pad\n"
    folder = install(tmp_path, "slow_to_open", points, code=PLUGIN)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", ""))))
    monkeypatch.setenv("RECONNECTING", str(tmp_path))
    return tmp_path


@pytest.fixture
def launch(rig: Path) -> Iterator[Launch]:
    """Return what launches a session whose pad is lost, or too hot, as soon as all is enabled."""
    handles: list[Handle] = []

    def started(optional: str, why: str = "out") -> Handle:
        scene = rig / "scene.xml"
        scene.write_text(SCENE.format(optional), encoding="utf-8")
        keep = Outputs(record=str(rig / "r.mcap"))
        handle = itouch.launch(scene, seconds=600.0, linger=True, enable=True, realtime=False, keep=keep)
        handles.append(handle.__enter__())
        until(handle, lambda: status(handle, "pad") is Status.ENABLED)
        (rig / why).write_text("yes")
        until(handle, lambda: status(handle, "pad") is Status.FAULT)
        if optional == "false":
            until(handle, lambda: bool(handle.faults))
        (rig / why).unlink()
        return handle

    yield started
    for handle in handles:
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
    return (rig / "log").read_text().splitlines()


def test_others_go_on_while_an_optional_device_takes_long_to_open(rig: Path, launch: Launch) -> None:
    """The loop waited for it: after 120 ms the guardian killed the session, while the stick was enabled."""
    handle = launch("true")
    (rig / "opening").write_text("1.0")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.CLOSED)
    begun = int(handle.state["tick"])
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    assert int(handle.state["tick"]) - begun > 500
    assert status(handle, "stick") is Status.ENABLED
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []
    assert log(rig) == ["open", "opened", "close", "open", "opened"]


def test_a_recording_in_which_a_device_was_reconnected_is_replayed_bit_for_bit(
    rig: Path, launch: Launch, capsys: pytest.CaptureFixture[str]
) -> None:
    handle = launch("true")
    (rig / "opening").write_text("0.3")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    handle.stop()
    assert main(["replay", str(rig / "r.mcap")]) == 0, capsys.readouterr()


def test_a_session_that_is_stopped_lives_while_its_device_is_opened(rig: Path, launch: Launch) -> None:
    handle = launch("false")
    (rig / "opening").write_text("1.0")
    (rig / "closing").write_text("0.3")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []
    assert "the guardian acted" not in log(rig)


def test_to_re_arm_waits_shortly_for_a_device_that_is_being_reconnected(rig: Path, launch: Launch) -> None:
    handle = launch("false")
    (rig / "opening").write_text("0.05")
    handle.command("reconnect", "pad")
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []


def test_what_is_asked_of_a_device_that_is_being_opened_is_answered(rig: Path, launch: Launch) -> None:
    handle = launch("false")
    (rig / "opening").write_text("2.0")
    (rig / "gone").write_text("yes")
    for what, value in (("reconnect", "pad"), ("reconnect", "pad"), ("rearm", None)):
        handle.command(what, value)
    until(handle, lambda: len(handle.refused) == 3)
    assert handle.refused == [
        "reconnect: device 'pad' is being opened: wait until that is done",
        "rearm: device 'pad' is being reconnected: re-arm when that is done, or has failed",
        "reconnect: device 'pad': there is nothing at its port",
    ]


def test_a_session_lives_while_re_arming_opens_what_a_trip_had_stopped(rig: Path, launch: Launch) -> None:
    """Only a lost connection is released by reconnecting: after a trip, to re-arm opens a device that was not there."""
    handle = launch("false", why="hot")
    (rig / "gone").write_text("yes")
    handle.command("reconnect", "pad")
    until(handle, lambda: bool(handle.refused))
    (rig / "gone").unlink()
    (rig / "opening").write_text("1.0")
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == ["reconnect: device 'pad': there is nothing at its port"]


def test_a_session_may_end_while_a_device_is_being_opened(rig: Path, launch: Launch) -> None:
    """What is opened too late is closed again, and until then nobody else may use its wire."""
    handle = launch("true")
    (rig / "opening").write_text("1.0")
    handle.command("reconnect", "pad")
    until(handle, lambda: log(rig)[-1] == "open")
    os.kill(handle.pid, signal.SIGTERM)
    claims, held = WireClaims(), True
    while held:
        with contextlib.suppress(WireHeldError):
            claims.take([str(rig)])
            held = False
    claims.release()
    assert log(rig) == ["open", "opened", "close", "open", "opened", "close"]


def test_what_the_session_needs_is_not_taken_from_it_while_it_is_enabled(launch: Launch) -> None:
    handle = launch("true")
    handle.command("reconnect", "stick")
    until(handle, lambda: bool(handle.refused))
    assert handle.refused == [
        "reconnect: device 'stick' is ENABLED and needed: stop the session before it is reconnected"
    ]
    assert status(handle, "stick") is Status.ENABLED
