"""A device that takes long to open is reconnected beside the loop: the session lives, and the others go on."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted_rig import ScriptedRig, status, until

import itouch
from itouch.loop import Status
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.servo import Handle
from itouch.session.outputs import Outputs
from itouch_tools.cli import main

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

Launch = Callable[..., Handle]


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ScriptedRig:
    return ScriptedRig.of(tmp_path, monkeypatch)


@pytest.fixture
def launch(rig: ScriptedRig) -> Iterator[Launch]:
    """Return what launches a session whose pad is lost, or too hot, as soon as all is enabled."""
    handles: list[Handle] = []

    def started(optional: bool, why: str = "out") -> Handle:
        scene = rig.scene(optional=optional)
        keep = Outputs(record=str(rig.folder / "r.mcap"))
        handle = itouch.launch(scene, seconds=600.0, linger=True, enable=True, realtime=False, keep=keep)
        handles.append(handle.__enter__())
        until(handle, lambda: status(handle, "pad") is Status.ENABLED)
        rig.tell(why)
        until(handle, lambda: status(handle, "pad") is Status.FAULT)
        if not optional:
            until(handle, lambda: bool(handle.faults))
        rig.undo(why)
        return handle

    yield started
    for handle in handles:
        with contextlib.suppress(itouch.DeviceFaultError):  # the one for which all was stopped
            handle.stop()
            handle.__exit__(None, None, None)


def test_others_go_on_while_an_optional_device_takes_long_to_open(rig: ScriptedRig, launch: Launch) -> None:
    """The loop waited for it: after 120 ms the guardian killed the session, while the stick was enabled."""
    handle = launch(optional=True)
    rig.tell("opening", "1.0")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.CLOSED)
    begun = int(handle.state["tick"])
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    assert int(handle.state["tick"]) - begun > 500
    assert status(handle, "stick") is Status.ENABLED
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []
    assert rig.log("pad") == ["opens", "opened", "closed", "opens", "opened"]


def test_a_recording_in_which_a_device_was_reconnected_is_replayed_bit_for_bit(
    rig: ScriptedRig, launch: Launch, capsys: pytest.CaptureFixture[str]
) -> None:
    handle = launch(optional=True)
    rig.tell("opening", "0.3")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    handle.stop()
    assert main(["replay", str(rig.folder / "r.mcap")]) == 0, capsys.readouterr()


def test_a_session_that_is_stopped_lives_while_its_device_is_opened(rig: ScriptedRig, launch: Launch) -> None:
    handle = launch(optional=False)
    rig.tell("opening", "1.0")
    rig.tell("closing", "0.3")
    handle.command("reconnect", "pad")
    until(handle, lambda: status(handle, "pad") is Status.OPEN)
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []
    assert not rig.made_safe


def test_to_re_arm_waits_shortly_for_a_device_that_is_being_reconnected(rig: ScriptedRig, launch: Launch) -> None:
    handle = launch(optional=False)
    rig.tell("opening", "0.05")
    handle.command("reconnect", "pad")
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == []


def test_what_is_asked_of_a_device_that_is_being_opened_is_answered(rig: ScriptedRig, launch: Launch) -> None:
    handle = launch(optional=False)
    rig.tell("opening", "2.0")
    rig.tell("gone")
    for what, value in (("reconnect", "pad"), ("reconnect", "pad"), ("rearm", None)):
        handle.command(what, value)
    until(handle, lambda: len(handle.refused) == 3)
    assert handle.refused == [
        "reconnect: device 'pad' is being opened: wait until that is done",
        "rearm: device 'pad' is being reconnected: re-arm when that is done, or has failed",
        "reconnect: device 'pad': there is nothing at its port",
    ]


def test_a_session_lives_while_re_arming_opens_what_a_trip_had_stopped(rig: ScriptedRig, launch: Launch) -> None:
    """Only a lost connection is released by reconnecting: after a trip, to re-arm opens a device that was not there."""
    handle = launch(optional=False, why="hot")
    rig.tell("gone")
    handle.command("reconnect", "pad")
    until(handle, lambda: bool(handle.refused))
    rig.undo("gone")
    rig.tell("opening", "1.0")
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is Status.ENABLED)
    assert handle.refused == ["reconnect: device 'pad': there is nothing at its port"]


def test_a_session_may_end_while_a_device_is_being_opened(rig: ScriptedRig, launch: Launch) -> None:
    """What is opened too late is closed again, and until then nobody else may use its wire."""
    handle = launch(optional=True)
    rig.tell("opening", "1.0")
    handle.command("reconnect", "pad")
    until(handle, lambda: rig.log("pad")[-1] == "opens")
    os.kill(handle.pid, signal.SIGTERM)
    claims, held = WireClaims(), True
    while held:
        with contextlib.suppress(WireHeldError):
            claims.take([str(rig.folder)])
            held = False
    claims.release()
    assert rig.log("pad") == ["opens", "opened", "closed", "opens", "opened", "closed"]


def test_what_the_session_needs_is_not_taken_from_it_while_it_is_enabled(launch: Launch) -> None:
    handle = launch(optional=True)
    handle.command("reconnect", "stick")
    until(handle, lambda: bool(handle.refused))
    assert handle.refused == [
        "reconnect: device 'stick' is ENABLED and needed: stop the session before it is reconnected"
    ]
    assert status(handle, "stick") is Status.ENABLED
