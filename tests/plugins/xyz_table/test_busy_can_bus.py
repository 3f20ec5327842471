"""The table on ODrive servos, on a bus that others use too, and whose servos say more and less than ours."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Iterator
from typing import Any

import can
import channel_records
import pytest
from test_odrive import Bench

from itouch.plugin import Record
from itouch_xyz_table import XyzTable, XyzTableParams, canframes, odrive
from itouch_xyz_table.servos import ServoError
from itouch_xyz_table.virtual_odrive import VirtualOdrive

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

#: What others say on the bus: a heartbeat with errors and estimates of a fourth servo, a long frame of another protocol,
#: a heartbeat that is cut off, an answer of a servo of ours to somebody else.
OTHERS = [
    can.Message(arbitration_id=number, data=data, is_extended_id=extended)
    for number, data, extended in (
        (canframes.number(9, canframes.HEARTBEAT), b"\x00\x08\x00\x00\x01\x00\x00\x00", False),
        (canframes.number(9, canframes.ESTIMATES), canframes.pack(canframes.ESTIMATES, 50.0, 9.0), False),
        (canframes.number(1, canframes.ESTIMATES) << 18, b"\xff" * 8, True),
        (canframes.number(2, canframes.HEARTBEAT), b"\x00\x00", False),
        (canframes.number(3, 0x17), b"\x00\x00\xc0\x41\x00\x00\x80\x3f", False),
    )
]


class Crowded:
    """A bus on which there is always another frame to take."""

    def __init__(self, bus: Any) -> None:
        self.bus, self.count = bus, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.bus, name)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return a frame that has come, or one of others at once."""
        self.count += 1
        found: can.Message | None = self.bus.recv(0.0)
        if found is None:
            time.sleep(1e-4)  # a full bus of 1 Mbit/s has one every 120 us
            return OTHERS[self.count % len(OTHERS)]
        return found


class Narrow:
    """A bus behind an adaptor with room for few frames, of which one leaves while another is refused, or none any more.

    It counts refusals instead of seconds: a busy machine sends so slowly that no queue of a real bus would ever fill.
    """

    def __init__(self, bus: Any, room: int) -> None:
        self.bus, self.room, self.full, self.stuck = bus, room, 0, False
        self._queued = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.bus, name)

    def send(self, message: can.Message) -> None:
        """Send, or say as Linux does that there is no room."""
        if self._queued >= self.room:
            self.full += 1
            self._queued -= not self.stuck
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        self._queued += 1
        self.bus.send(message)


@pytest.fixture
def quiet() -> Iterator[Bench]:
    made = Bench("virtual")
    yield made
    made.close()


def records() -> tuple[Record, Record]:
    return channel_records.records(XyzTable, XyzTableParams())


def test_a_bus_that_is_full_of_others_frames_holds_up_nothing(quiet: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver listened for as long as there was something to hear."""
    opened, ended = odrive._opened, threading.Event()
    monkeypatch.setattr(odrive, "_opened", lambda bus: Crowded(opened(bus)))
    device = quiet.table()
    failed, places = list[BaseException](), list[list[float]]()

    def work() -> None:
        reading, command = records()
        try:
            device.open()
            device.read(reading)
            command["pose_target"] = (*reading["pose"][:3], 1.0, 0.0, 0.0, 0.0)
            for _ in range(20):
                device.write(command)
                device.read(reading)
                places.append(reading["pose"][:3].tolist())
            device.close()
        except BaseException as error:
            failed.append(error)
        ended.set()

    threading.Thread(target=work, daemon=True).start()
    assert ended.wait(300.0), "it listens for ever"
    assert not failed
    assert places[-1] == pytest.approx(quiet.truth(), abs=1e-4)


def test_a_servo_whose_heartbeat_ends_is_named_though_it_answers(quiet: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    reading, _ = records()
    device = quiet.table()
    device.open()
    device.read(reading)
    due = VirtualOdrive.due
    monkeypatch.setattr(VirtualOdrive, "due", lambda self, now: [] if self.number == 2 else due(self, now))
    device._servos._patience = 1.0  # type: ignore[union-attr]
    with pytest.raises(ServoError, match=r"servo y \(id 2\) sends no heartbeat any more"):
        for _ in range(2000):
            device.read(reading)
            time.sleep(1e-3)


def test_an_adaptor_with_room_for_few_frames_ends_nothing(quiet: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cycle of three servos is longer than the queue of ten frames that an interface of Linux comes with."""
    opened, made = odrive._opened, list[Narrow]()
    monkeypatch.setattr(odrive, "_opened", lambda bus: made.append(Narrow(opened(bus), 4)) or made[-1])
    device = quiet.table()
    reading, command = records()
    device.open()
    device.read(reading)
    command["pose_target"] = (*reading["pose"][:3], 1.0, 0.0, 0.0, 0.0)
    device.write(command)
    device.read(reading)
    assert made[0].full > 3
    made[0].stuck = True
    device._servos._patience = 1.0  # type: ignore[union-attr]
    with pytest.raises(ServoError, match=r"No buffer space .*; no frame leaves it: check its cable, its terminators"):
        for _ in range(3):
            device.read(reading)
    made[0].stuck = False
