"""A session that was saved after a trip, in a new process: nothing is enabled on hardware until it is re-armed."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted_rig import ScriptedRig, status, until

import itouch
from itouch.loop import Status
from itouch.servo import Handle

pytestmark = [pytest.mark.xdist_group("processes"), pytest.mark.punctual]

Restore = Callable[[], Handle]


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ScriptedRig:
    """Return a rig with a session that was saved after a trip."""
    rig, saved = ScriptedRig.of(tmp_path, monkeypatch), tmp_path / "s.itouch"
    handle = itouch.launch(rig.scene(moves=True), seconds=60.0, linger=True, enable=True, realtime=False)
    handle.__enter__()
    handle.command("pad.current", [-3.0])
    until(handle, lambda: "driven" in rig.log("pad"))
    rig.tell("hot")
    until(handle, lambda: bool(handle.faults))
    handle.command("save", str(saved))
    until(handle, saved.exists)
    ended(handle)
    rig.undo("hot")
    rig.forget()
    return rig


@pytest.fixture
def restore(rig: ScriptedRig) -> Iterator[Restore]:
    """Return what launches the saved session in a new process; it rests as soon as that has found the trip."""
    handles: list[Handle] = []

    def launched() -> Handle:
        handle = itouch.launch(rig.folder / "s.itouch", seconds=60.0, linger=True, enable=True, realtime=False)
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


def rests(handle: Handle, rig: ScriptedRig) -> None:
    """Check that nothing is enabled, and nothing has been driven, for a while."""
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        assert not handle.wait(0.01)
        assert Status.ENABLED not in (status(handle, "stick"), status(handle, "pad"))
    assert "driven" not in rig.log("pad")


@pytest.mark.parametrize("opening", [0.0, 1.0])
def test_nothing_is_enabled_until_it_is_re_armed(rig: ScriptedRig, restore: Restore, opening: float) -> None:
    """Also if a device takes long to open: the guardian does not take the session for one that hangs."""
    rig.tell("opening", str(opening))
    handle = restore()
    rests(handle, rig)
    assert handle.faults[0]["trip"] == "plate-temperature"
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is status(handle, "stick") is Status.ENABLED)
    assert handle.refused == []
    assert not rig.made_safe


@pytest.mark.parametrize(
    ("told", "words"),
    [("gone", "there is nothing at its port"), ("released", "nobody holds the dead-man's switch"), ("hot", "re-armed")],
)
def test_what_keeps_it_from_being_re_armed_is_told(rig: ScriptedRig, restore: Restore, told: str, words: str) -> None:
    """A plate that cannot be opened, or is still hot; a switch that nobody holds: when that is over, it is re-armed."""
    handle = restore()
    rig.tell(told)
    handle.command("rearm")
    until(handle, lambda: bool(handle.refused))
    assert words in handle.refused[0]
    rests(handle, rig)
    rig.undo(told)
    handle.command("rearm")
    until(handle, lambda: status(handle, "pad") is status(handle, "stick") is Status.ENABLED)


def test_to_stop_waits_for_no_device_that_re_arming_opens(rig: ScriptedRig, restore: Restore) -> None:
    handle = restore()
    rig.tell("opening", "12")
    handle.command("rearm")
    until(handle, lambda: "opens" in rig.log("pad"))
    begin = time.monotonic()
    handle.request_stop()
    with pytest.raises(itouch.DeviceFaultError, match="plate-temperature"):
        handle.wait(60.0)
    assert time.monotonic() - begin < 8.0
    assert "driven" not in rig.log("pad")
