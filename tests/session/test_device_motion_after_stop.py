"""What a device does when a stop is over and no tick writes any more: a surface is not moved on by its own thread."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import pytest
from test_rearming import goes_on, rearm, rig, stopped

import itouch
from itouch.exchange import ThreadedDevice
from itouch.plugin import DeviceError, Record
from itouch.safety.actuation import BACKWARDS, HELD

pytestmark = pytest.mark.punctual  # tables in threads of their own

#: How far [m] a surface may still come nearer because an exchange was under way when the stop ended.
UNDER_WAY = 1e-4


def wired_backwards(table: Any) -> None:
    """Let the drive go the other way from now on: up by as much as it is sent down."""
    turned = table.shown

    def write(self: object, command: Record) -> None:
        sent = float(command["pose_target"][2])
        table.sent.append(sent)
        table.shown = 2.0 * turned - sent

    table.write = write


def touching(session: itouch.Session, stick: Any) -> None:
    """Lower the finger into the block, so that the table brings its surface to it."""

    def lower() -> None:
        session.hold()
        stick.shown = max(0.024, stick.shown - 1e-4)

    table = driver_thread(session)
    patience, table._patience = table._patience, 10.0  # the first touch of a process takes long
    session.run(1.0, each=lower)
    table._patience = patience
    assert session.state["finger.normal_force"].item() > 0.1


def driver_thread(session: itouch.Session) -> ThreadedDevice:
    """Return what exchanges with the table."""
    (found,) = (one.gate.device for one in session.runners if one.model.name == "table")
    assert isinstance(found, ThreadedDevice)
    return found


def test_a_surface_that_goes_the_wrong_way_stays_where_the_stop_has_left_it(tmp_path: Path) -> None:
    """Its thread sent it to the end of its travel a moment after each stop: this one up, into the finger."""
    session, stick, table, _ = rig(tmp_path, blocking="Table")
    with session:
        touching(session, stick)
        wired_backwards(table)
        stopped(session, stick)
        assert session.state["table.stopped"].item() == HELD
        height, sent = table.shown, session.state["table.sent.pose_target"][2].item()
        before = driver_thread(session).exchanges
        time.sleep(0.5)
        assert driver_thread(session).exchanges > before
        assert table.shown <= height + UNDER_WAY
        assert table.sent[-1] == sent
    assert table.sent[-1] == sent  # nor is it moved by being closed


def test_a_surface_is_not_moved_on_by_its_thread_when_a_stop_is_over(tmp_path: Path) -> None:
    """What ended above the end of its travel is left there: nobody watches any more which way it goes."""
    session, stick, table, pad = rig(tmp_path, blocking="Table")

    def cool(tick: int) -> None:
        if session.state["stopping"].item():
            pad.shown = 303.15

    with session:
        touching(session, stick)

        def further(self: object, command: Record) -> None:
            table.sent.append(float(command["pose_target"][2]))
            table.shown = max(0.0, 0.02 - 1.15 * (0.02 - table.sent[-1]))

        table.write = further
        session.taps.append(cool)
        pad.shown = 333.15
        with pytest.raises(itouch.DeviceFaultError, match="pad"):
            goes_on(session, 1.0)
        sent = session.state["table.sent.pose_target"][2].item()
        assert sent > 2e-3
        time.sleep(0.3)
        assert table.sent[-1] == sent


@pytest.mark.parametrize("way", [HELD, BACKWARDS])
def test_a_loop_that_hangs_in_a_stop_leaves_a_surface_that_goes_the_wrong_way(tmp_path: Path, way: int) -> None:
    session, stick, table, _ = rig(tmp_path, blocking="Table")
    seen: list[list[float]] = []

    def hang(tick: int) -> None:
        if session.state["stopping"].item() and session.state["table.stopped"].item() == way and not seen:
            time.sleep(0.02)  # what was asked last is sent
            asked = len(table.sent) - 1
            time.sleep(0.4)
            seen.append(table.sent[asked:])

    with session:
        touching(session, stick)
        wired_backwards(table)
        turned, step = table.shown, table.write

        def write(self: object, command: Record) -> None:
            step(self, command)
            if table.shown > turned + 1e-3 and way == BACKWARDS:
                table.shown += 3e-3  # it comes so near that it is not only held

        table.write = write
        session.taps.append(hang)
        stopped(session, stick)
        session.taps.remove(hang)
        assert seen and len(set(seen[0])) == 1


def test_a_loop_that_hangs_without_a_stop_still_has_the_surface_retract(tmp_path: Path) -> None:
    session, stick, table, _ = rig(tmp_path, blocking="Table")
    with session:
        touching(session, stick)
        time.sleep(0.4)
        assert table.sent[-1] == 0.0
        with pytest.raises(itouch.DeviceFaultError):
            goes_on(session, 1.0)


def test_a_device_that_hangs_is_reconnected_when_its_driver_has_returned(tmp_path: Path) -> None:
    """Its old thread closed what a new one had opened, and both called one driver."""
    session, _, _, pad = rig(tmp_path, blocking="Pad")
    reads, go_on, calls = pad.read, threading.Event(), []
    opens = pad.open

    def hang(self: object, reading: Record) -> object:
        go_on.wait(300)
        return reads(self, reading)

    def opened(self: object) -> None:
        calls.append("open")
        opens(self)

    pad.open, pad.close = opened, lambda self: calls.append("close")
    with session:
        pad.read = hang
        with pytest.raises(itouch.DeviceFaultError, match="'pad' was silent"):
            goes_on(session, 2.0)
        for _ in range(2):
            with pytest.raises(DeviceError, match=r"^device 'pad':? has not returned from its driver's `read` yet"):
                session.reconnect("pad")
        assert calls == []
        pad.read = reads
        go_on.set()
        deadline = time.monotonic() + 300
        while "close" not in calls and time.monotonic() < deadline:
            time.sleep(0.01)
        session.reconnect("pad")
        rearm(session)
        goes_on(session, 0.2)
        assert calls == ["close", "open"]
    assert calls == ["close", "open", "close"]
