"""The driver against an emulator with other habits: whatever the protocol leaves open must not matter."""

from __future__ import annotations

import array
import errno
import math
import random
import time
from typing import Any

import numpy as np
import pytest
import usb.core
from stranger import Arm, Habits, StrangerBus

from itouch_usb_arm import (
    Disconnected,
    Falcon,
    FalconError,
    NotFound,
    NotHomed,
    PermissionDenied,
    kinematics,
)
from itouch_usb_arm.arm import look
from itouch_usb_arm.boot import Block, build

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

IMAGE = build([Block(0x3F8002, tuple(range(100))), Block(0x8000, tuple(range(700, 800)))], entry=0x3F8002)
HABITS = [
    {"empty": empty} for empty in ("status", "zero", "timeout", "110", "60", "10060", "text", "code")
] + [
    {"chunk": 1}, {"chunk": 7, "empties_before": 2}, {"chunk": 13, "empty": "zero"}, {"empties_before": 5},
    {"echo": "byte"}, {"echo": "byte", "chunk": 1, "empty": "timeout"}, {"leading": b""}, {"leading": b"\x00\x00"},
    {"status": b"\x00\x00"}, {"status": b"<>"}, {"control_returns": array.array("B")}, {"short_writes": True},
    {"short_writes": True, "chunk": 3, "empty": "60"}, {"kernel": "active"}, {"kernel": "busy"},
    {"configured": "no"}, {"configured": "unknown"}, {"behind": 1}, {"homes_after": 40},
]  # fmt: skip


@pytest.mark.punctual  # a frame that is answered late is followed by one without force
@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize("habits", HABITS, ids=str)
def test_from_power_on_to_a_force(habits: dict[str, Any], running: bool) -> None:
    bus = StrangerBus(Habits(running=running, **habits), IMAGE)
    (arm,) = bus.arms
    with Falcon(None if running else IMAGE, bus, patience=0.2) as falcon:
        assert bytes(arm.image) == (b"" if running else IMAGE)
        with pytest.raises(NotHomed):
            falcon.write((0.0, 0.0, 1.0))
        assert np.isnan(falcon.read().position).all()
        falcon.home(5.0)
        assert all(motors == (0, 0, 0) for motors, _ in arm.commands)
        arm.encoders, arm.grip = (120, -250, 310), 0b0101
        for _ in range(3):
            reading = falcon.read()
        assert reading.encoders == (120, -250, 310)
        assert reading.homed == (True, True, True)
        assert int(reading.buttons) == 0b0101
        place = kinematics.forward(kinematics.angles_of(arm.encoders))
        assert reading.position == pytest.approx(place, abs=1e-9)
        falcon.write((0.3, -0.2, 0.4))
        falcon.read()
        motors, info = arm.commands[-1]
        assert info & 1
        torques = [-count / 2200.0 for count in motors]
        assert kinematics.push(place, torques) == pytest.approx((0.3, -0.2, 0.4), abs=0.02)
    assert arm.commands[-1][0] == (0, 0, 0)
    assert bus.attached_again == (habits.get("kernel") in ("active", "busy"))


def test_random_habits_and_random_places() -> None:
    rng = random.Random(11)
    for _ in range(15):
        habits = Habits(
            running=rng.random() < 0.5, chunk=rng.randrange(1, 63), empties_before=rng.randrange(4),
            status=rng.randbytes(2), empty=rng.choice(("status", "zero", "timeout", "110")),
            echo=rng.choice(("block", "byte")), leading=rng.choice((b"", b"\0")), short_writes=rng.random() < 0.5,
        )  # fmt: skip
        bus = StrangerBus(habits, IMAGE)
        # The bus never waits: by this process's own time the answers are as quick on a machine that is busy elsewhere.
        with Falcon(IMAGE, bus, patience=0.2, clock=time.process_time) as falcon:
            falcon.home(5.0)
            for _ in range(6):
                radius, turn = rng.uniform(0.0, 0.03), rng.uniform(0.0, math.tau)
                place = (radius * math.cos(turn), radius * math.sin(turn), rng.uniform(0.09, 0.16))
                one, two, three = (round(count) for count in kinematics.counts_of(kinematics.inverse(place)))
                bus.arms[0].encoders = (one, two, three)
                reading = falcon.read()
                assert reading.encoders == (one, two, three)
                assert reading.position == pytest.approx(place, abs=1e-4)


def test_several_arms_with_serial_numbers_that_can_or_cannot_be_read() -> None:
    refused = usb.core.USBError("Access denied", -3, errno.EACCES)
    bus = StrangerBus(Habits(running=True, serials=(refused, "B2", None)), IMAGE)
    with Falcon(None, bus, serial="B2") as falcon:
        falcon.read()
        assert [bool(arm.commands) for arm in bus.arms] == [False, True, False]
    with pytest.raises(PermissionDenied):  # it may be the one that may not be asked
        Falcon(None, bus, serial="C3").open()
    stalled = StrangerBus(Habits(running=True, serials=(usb.core.USBError("Pipe", -9, errno.EPIPE), None)), IMAGE)
    with pytest.raises(FalconError, match="no string descriptors supported"):
        Falcon(None, stalled, serial="C3").open()
    with pytest.raises(NotFound, match="with serial number 'C3'"):
        Falcon(None, StrangerBus(Habits(running=True)), serial="C3").open()
    with Falcon(None, stalled) as falcon:
        falcon.read()


def test_of_several_arms_the_first_that_is_free_is_taken_and_each_is_told() -> None:
    bus = StrangerBus(Habits(running=True, serials=(None, None), held=(True, False)), IMAGE)
    with Falcon(None, bus) as falcon:
        falcon.read()
    assert [bool(arm.commands) for arm in bus.arms] == [False, True]
    first, second = look(bus)
    assert (first.usable, second.usable) == (False, True)
    assert "another program" in first.note
    assert first.where != second.where


def test_a_kernel_driver_that_cannot_be_taken_away_is_told() -> None:
    bus = StrangerBus(Habits(running=True, kernel="mute"), IMAGE)
    with pytest.raises(FalconError, match="another program uses the arm"):
        Falcon(None, bus).open()


def test_an_arm_that_goes_without_an_error_number() -> None:
    bus = StrangerBus(Habits(running=True), IMAGE)
    falcon = Falcon(None, bus).open()
    bus.gone = True
    with pytest.raises(Disconnected):
        falcon.read()
    with pytest.raises(NotFound):
        falcon.open()
    bus.gone = False
    with falcon.open():
        falcon.home(2.0)
        assert falcon.read().valid


def test_a_backend_without_anything_is_an_error_with_a_name() -> None:
    class Bare(StrangerBus):
        def claim_interface(self, dev_handle: Any, intf: int) -> None:
            raise NotImplementedError("claim_interface")

    with pytest.raises(FalconError, match="claim_interface"):
        Falcon(None, Bare(Habits(running=True))).open()


class Bursts(StrangerBus):
    """A hub that keeps a part of the answers, which come with the next one in a packet, and gives a part twice."""

    kept, keeps, twice = b"", 0.0, 0.0

    def _answer(self, arm: Any) -> None:
        before = len(arm.line)
        super()._answer(arm)
        new = bytes(arm.line[before:])
        del arm.line[before:]
        self.kept += new * (2 if self.random.random() < self.twice else 1)
        if self.random.random() >= self.keeps:
            arm.line += self.kept
            self.kept = b""


@pytest.mark.parametrize(("keeps", "twice"), [(0.1, 0.0), (0.0, 0.5), (0.1, 0.1)])
def test_answers_that_come_in_bursts_end_nothing_and_none_is_taken_for_a_newer_one(keeps: float, twice: float) -> None:
    """What is sent again has no force: whoever does not answer may have lost more.  The next frame has it again."""
    bus = Bursts(Habits(running=True), IMAGE)
    (arm,) = bus.arms
    with Falcon(None, bus, patience=0.5) as falcon:
        falcon.home(5.0)
        falcon.read()
        bus.keeps, bus.twice = keeps, twice
        falcon.write((0.0, 0.0, 0.5))
        for count in range(300):
            arm.encoders = (count % 50, -count % 50, 2 * count % 50)
            assert falcon.read().encoders == arm.encoders
        bus.keeps = bus.twice = 0.0
        falcon.read()
        assert any(arm.commands[-1][0])


def test_an_arm_that_is_enumerated_anew_is_told_and_opened_again_without_force() -> None:
    """A loose plug: the arm is back at once, at another address, and has lost neither firmware nor homing."""
    bus = StrangerBus(Habits(running=True), IMAGE)
    with Falcon(None, bus, resume=True) as falcon:
        falcon.home(5.0)
        falcon.write((0.0, 0.0, 0.5))
        falcon.read()
        (old,) = bus.arms
        new = Arm(0, "run", homing=old.homing)
        bus.arms = [new]
        write = bus.bulk_write

        def bulk_write(dev_handle: Any, *words: Any) -> int:
            if dev_handle is old:
                raise usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
            return write(dev_handle, *words)

        bus.bulk_write = bulk_write  # type: ignore[method-assign]
        with pytest.raises(Disconnected, match="the arm is gone"):
            falcon.read()
        with pytest.raises(Disconnected):
            falcon.read()
        falcon.open()
        assert falcon.home(5.0).valid
        assert all(motors == (0, 0, 0) for motors, _ in new.commands)
