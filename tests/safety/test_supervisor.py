"""The supervisor: what a device may do when, and what passes between it and the loop."""

from __future__ import annotations

import dataclasses
import math
import os
import threading
from typing import Any

import numpy as np
import pytest
from small_devices import (
    ARM,
    LIMITS,
    PERIOD,
    PLATE,
    TABLE,
    Channels,
    Fake,
    FakeTwin,
    Slow,
    Supervised,
    lost,
    model,
    state,
)

from itouch.exchange import Exchanged
from itouch.plugin import HOLD, Channel, DeviceError, Record
from itouch.plugin.timestamps import Timestamped
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.safety import DeviceFaultError, Status, Trip, lifecycle
from itouch.safety.actuation import BACKWARDS, HELD


class Rig:
    """A supervised device with all that it is sent, and what it will say."""

    def __init__(self, channels: Channels = ARM, *, cls: type[Fake] = Fake, **of_model: object) -> None:
        self.device = cls()
        one = model(channels, cls=cls, **of_model)  # type: ignore[arg-type]
        self.state = state(one)
        self.it = Supervised(one, self.state, PERIOD, device=self.device)
        self.it.lifecycle.reset()
        self.place = [0.0, 0.0, 0.03]
        self.temperature = 300.0
        self.device.says = self.say
        self.it.gate.actuation.closing = 0.1

    def say(self, reading: Record) -> bool:
        if "pose" in reading:
            reading["pose"] = (*self.place, 1.0, 0.0, 0.0, 0.0)
        for name in reading:
            if name.endswith("temperature"):
                reading[name] = self.temperature
        return True

    def enabled(self) -> Rig:
        self.it.lifecycle.open()
        self.it.gate.read(0)
        self.it.lifecycle.enable()
        return self

    def last(self, name: str = "wrench") -> list[float]:
        return self.device.written[-1][name]


def test_a_device_is_opened_enabled_disabled_and_closed_once() -> None:
    rig = Rig()
    it = rig.it
    assert (it.latch.status, it.latch.enabled, it.latch.trip) == (Status.CLOSED, False, Trip.NONE)
    it.lifecycle.open()
    assert (it.latch.status, it.latch.enabled) == (Status.OPEN, False)
    with pytest.raises(DeviceError, match="has not read anything yet: nothing could watch what it does"):
        it.lifecycle.enable()
    it.gate.read(0)
    it.lifecycle.enable()
    assert (it.latch.status, it.latch.enabled) == (Status.ENABLED, True)
    it.latch.disable()
    assert it.latch.status is Status.OPEN
    it.latch.disable()
    assert it.latch.status is Status.OPEN
    it.lifecycle.close()
    assert it.latch.status is Status.CLOSED
    it.lifecycle.close()
    assert rig.device.calls == ["open", "close"]


def test_only_an_open_device_can_be_enabled() -> None:
    rig = Rig()
    with pytest.raises(DeviceError, match="device 'it' is CLOSED, it can't be enabled"):
        rig.it.lifecycle.enable()
    rig.enabled()
    with pytest.raises(DeviceError, match="ENABLED"):
        rig.it.lifecycle.enable()


def test_a_device_that_refuses_stays_closed() -> None:
    rig = Rig()
    rig.device.open_fails = DeviceError("no power")
    with pytest.raises(DeviceError, match="no power"):
        rig.it.lifecycle.open()
    assert rig.it.latch.status is Status.CLOSED


def test_closed_nothing_open_only_what_is_safe_enabled_what_is_asked() -> None:
    rig = Rig()
    rig.it.command["wrench"][0] = 0.5
    rig.it.gate.write(0)
    rig.it.gate.read(0)
    assert rig.device.written == []
    assert rig.state["it.sequence"].item() == 0
    rig.it.lifecycle.open()
    rig.it.gate.write(0)
    assert rig.last() == [0.0] * 6
    rig.it.gate.read(1)
    rig.it.lifecycle.enable()
    rig.it.gate.write(1)
    assert rig.last() == [0.0] * 6  # what was asked for before it was enabled is forgotten
    rig.it.command["wrench"][0] = 0.5
    rig.it.gate.write(2)
    assert rig.last() == [0.5, 0, 0, 0, 0, 0]
    rig.it.latch.disable()
    rig.it.gate.write(3)
    assert rig.last() == [0.0] * 6


def test_commands_are_limited_counted_and_dropped() -> None:
    rig = Rig().enabled()
    rig.it.command["wrench"][:] = (9.0, 0, 0, 1.0, 1.0, 0)
    rig.it.gate.write(0)
    assert rig.last() == [1.0, 0, 0, 0, 0, 0]
    assert rig.state["it.clamped"].item() == 1
    assert rig.state["it.dropped"].item() == 2
    rig.it.command["wrench"][:] = (0.5, 0, 0, 0, 0, 0)
    rig.it.gate.write(1)
    assert rig.state["it.clamped"].item() == 1
    assert rig.state["it.dropped"].item() == 2


def test_enabling_begins_with_what_is_safe() -> None:
    rig = Rig()
    rig.it.lifecycle.open()
    rig.it.gate.read(0)
    rig.it.sent["wrench"][0] = rig.it.command["wrench"][0] = 2.0
    rig.it.lifecycle.enable()
    assert not np.any(rig.it.sent["wrench"])
    assert not np.any(rig.it.command["wrench"])


def test_a_surface_begins_where_it_stands() -> None:
    rig = Rig(TABLE)
    rig.place = [0.01, 0.02, 0.04]
    rig.enabled()
    assert rig.it.command["pose_target"][:3].tolist() == [0.01, 0.02, 0.04]
    rig.it.gate.write(0)
    assert rig.last("pose_target")[:3] == [0.01, 0.02, 0.04]
    rig.it.command["pose_target"][2] = 0.06
    rig.it.gate.write(1)
    assert rig.last("pose_target")[2] == pytest.approx(0.0401)


def test_a_device_without_a_pose_of_its_own_holds() -> None:
    rig = Rig(((), (Channel("pose_target", 7, "m", safe=HOLD), Channel("other", 1, "N", safe=HOLD))))
    rig.it.sent["pose_target"][:] = rig.it.sent["other"][:] = 0.25
    rig.enabled()
    assert rig.it.command["pose_target"].tolist() == [0.25] * 7
    assert rig.it.command["other"].tolist() == [0.25]


def test_the_ramp_of_enabling() -> None:
    rig = Rig(limits=dataclasses.replace(LIMITS, ramp=2.0)).enabled()
    rig.it.command["wrench"][0] = 3.0
    shares = []
    for tick in range(3):
        rig.it.gate.write(tick)
        shares.append(rig.last()[0])
    assert shares == pytest.approx([0.0015, 0.003, 0.0045])
    rig.state["it.ramp"] = 0.99999
    rig.it.sent["wrench"][0] = 3.0
    rig.it.gate.write(3)
    assert rig.last()[0] == pytest.approx(3.0)
    assert rig.state["it.ramp"].item() == 1.0
    assert Rig().enabled().state["it.ramp"].item() == 1.0


def test_after_re_arming_a_second_of_ramp() -> None:
    rig = Rig().enabled()
    rig.it.gate.actuation.ramp_in()
    rig.it.command["wrench"][0] = 3.0
    rig.it.gate.write(0)
    assert rig.last()[0] == pytest.approx(0.003)


def test_fading_and_heat_cut_down_what_is_sent() -> None:
    rig = Rig().enabled()
    rig.it.gate.device_monitors.moment.speed = 1.16  # K2 leaves a tenth
    rig.it.gate.acquisition.watch_placed(0)
    rig.it.command["wrench"][0] = 3.0
    rig.it.gate.write(0)
    assert rig.last()[0] == pytest.approx(0.3)
    plate = Rig(PLATE).enabled()
    plate = Rig(PLATE)
    plate.temperature = 314.65  # T1 leaves a quarter
    plate.enabled()
    assert plate.state["it.heat.share"].item() == pytest.approx(0.25)
    plate.it.command["current"][0] = 2.0
    plate.it.gate.write(0)
    assert plate.last("current") == pytest.approx([0.5])


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_no_number_is_a_fault(bad: float) -> None:
    rig = Rig().enabled()
    rig.it.command["wrench"][2] = bad
    count = len(rig.device.written)
    with pytest.raises(DeviceFaultError, match=r"device 'it' was commanded with .* \(wrench\) at tick 7") as caught:
        rig.it.gate.write(7)
    assert (caught.value.trip, caught.value.device, caught.value.tick) == (Trip.NOT_A_NUMBER, "it", 7)
    assert len(rig.device.written) == count


def test_a_reading_that_is_no_number_is_a_fault_and_nobody_sees_it() -> None:
    rig = Rig().enabled()
    rig.place[1] = math.nan
    with pytest.raises(DeviceFaultError, match=r"reads NaN \(pose\)") as caught:
        rig.it.gate.read(3)
    assert caught.value.trip is Trip.NOT_A_NUMBER
    assert rig.it.reading["pose"][:3].tolist() == [0.0, 0.0, 0.03]


def test_a_hot_plate_is_a_fault_that_everybody_may_see() -> None:
    rig = Rig(PLATE).enabled()
    rig.temperature = 315.5
    with pytest.raises(DeviceFaultError, match="past its trip"):
        rig.it.gate.read(1)
    assert rig.it.reading["plate_temperature"].item() == 315.5


def test_heat_is_checked_every_ten_milliseconds() -> None:
    rig = Rig(PLATE).enabled()
    for tick in range(1, 31):
        rig.it.gate.read(tick)
    assert rig.state["it.heat.samples"].item() == 4  # ticks 0, 10, 20, 30
    slow = Rig(PLATE, cls=Slow).enabled()
    for tick in range(1, 31):
        slow.it.gate.read(tick)
    assert slow.state["it.sequence"].item() == 7
    assert slow.state["it.heat.samples"].item() == 7  # each of its readings


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (DeviceError("the plug is out"), "failed: the plug is out"),
        (KeyError("x"), "failed in read: KeyError: 'x' (test_supervisor.py, line "),
    ],
)
def test_a_device_that_fails_to_read_is_a_fault(error: Exception, words: str) -> None:
    rig = Rig().enabled()

    def fail(reading: Record) -> bool:
        raise error

    rig.device.says = fail
    with pytest.raises(DeviceFaultError) as caught:
        rig.it.gate.read(1)
    assert caught.value.trip is Trip.DEVICE_ERROR
    assert caught.value.cause.startswith(words)
    assert caught.value.__cause__ is not None


def test_a_twins_compiled_reading_that_fails_is_a_fault() -> None:
    rig, error = Rig().enabled(), KeyError("x")
    with pytest.raises(DeviceFaultError) as caught:
        rig.it.gate.acquisition.not_taken(error, 0, 7)
    assert (caught.value.trip, caught.value.tick) == (Trip.DEVICE_ERROR, 7)
    assert caught.value.cause == "failed in read: KeyError: 'x'"
    assert caught.value.__cause__ is not None and caught.value.__cause__.__cause__ is error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (DeviceError("the plug is out"), "failed: the plug is out"),
        (OSError("gone"), "failed in write: OSError: gone (small_devices.py, line "),
    ],
)
def test_a_device_that_fails_to_write_is_a_fault(error: Exception, words: str) -> None:
    for enabled in (True, False):
        rig = Rig().enabled()
        if not enabled:
            rig.it.latch.disable()
        rig.device.write_fails = error
        with pytest.raises(DeviceFaultError) as caught:
            rig.it.gate.write(4)
        assert (caught.value.trip, caught.value.tick) == (Trip.DEVICE_ERROR, 4)
        assert caught.value.cause.startswith(words)


def test_silence_is_a_fault_after_the_watchdogs_time() -> None:
    rig = Rig().enabled()
    rig.device.says = lambda reading: False
    for tick in range(1, 21):
        rig.it.gate.read(tick)
    assert rig.state["it.age"].item() == 20
    with pytest.raises(DeviceFaultError, match="was silent for 0.021 s") as caught:
        rig.it.gate.read(21)
    assert caught.value.trip is Trip.SILENT


def test_an_answer_ends_the_silence() -> None:
    rig = Rig().enabled()
    for tick in range(1, 200):
        rig.device.says = rig.say if tick % 15 == 0 else lambda reading: False
        rig.it.gate.read(tick)
    assert rig.state["it.age"].item() == 4
    assert rig.state["it.sequence"].item() == 14


def test_a_device_that_is_only_open_may_be_silent() -> None:
    rig = Rig()
    rig.it.lifecycle.open()
    rig.device.says = lambda reading: False
    for tick in range(100):
        rig.it.gate.read(tick)
    assert rig.state["it.age"].item() == 100


def test_a_slow_device_is_read_in_its_own_time() -> None:
    rig = Rig(cls=Slow).enabled()
    for tick in range(1, 12):
        rig.it.gate.read(tick)
    assert rig.state["it.sequence"].item() == 3  # ticks 0, 5, 10
    rig.device.says = lambda reading: False
    rig.it.gate.read(15)
    assert rig.state["it.age"].item() == 5


def test_after_a_silence_a_reading_may_be_further_away() -> None:
    rig = Rig().enabled()
    rig.device.says = lambda reading: False
    for tick in range(1, 11):
        rig.it.gate.read(tick)
    rig.device.says = rig.say
    rig.place[0] = 0.050
    rig.it.gate.read(11)
    rig.place[0] = 0.0
    with pytest.raises(DeviceFaultError, match="not believable"):
        rig.it.gate.read(12)


def test_a_fault_latches_and_sends_what_is_safe() -> None:
    rig = Rig().enabled()
    rig.it.command["wrench"][0] = 1.0
    rig.it.gate.write(0)
    rig.it.gate.fault(Trip.SPEED, 5)
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.FAULT, Trip.SPEED)
    assert rig.state["it.tripped"].item() == 5
    assert rig.state["it.ramp"].item() == 0.0
    assert rig.last() == [0.0] * 6
    rig.it.gate.write(6)
    rig.it.latch.disable()
    assert rig.it.latch.status is Status.FAULT
    assert rig.last() == [0.0] * 6
    with pytest.raises(DeviceError, match="FAULT"):
        rig.it.lifecycle.enable()


def test_in_a_fault_nothing_raises_any_more() -> None:
    rig = Rig().enabled()
    rig.device.write_fails = OSError("gone")
    rig.it.gate.fault(Trip.DEVICE_ERROR, 5)
    rig.device.says = lost
    rig.it.gate.read(6)
    rig.it.gate.write(6)
    rig.device.says = rig.say
    rig.place[2] = math.nan
    rig.it.gate.read(7)
    assert rig.it.reading["pose"][2] == 0.03
    rig.place[2] = 1.5
    rig.it.gate.read(8)
    assert rig.it.reading["pose"][2] == 1.5


def test_re_arming_needs_a_reading_that_is_believed() -> None:
    rig = Rig().enabled()
    rig.it.lifecycle.rearm(0)
    assert rig.it.latch.status is Status.ENABLED  # nothing to re-arm
    rig.it.gate.fault(Trip.NOT_A_NUMBER, 5)
    rig.place[0] = math.nan
    with pytest.raises(DeviceError, match=r"device 'it' can't be re-armed: it reads NaN \(pose\)"):
        rig.it.lifecycle.rearm(0)
    assert rig.it.latch.status is Status.FAULT
    assert rig.it.reading["pose"][0] == 0.0
    rig.device.says = lost
    with pytest.raises(DeviceError, match="it failed: the plug is out"):
        rig.it.lifecycle.rearm(0)
    rig.device.says = rig.say
    rig.place[0] = 0.5
    rig.it.lifecycle.rearm(0)
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.OPEN, Trip.NONE)
    assert rig.state["it.sequence"].item() == 1
    rig.it.command["wrench"][0] = 9.0
    rig.it.lifecycle.enable()
    assert rig.it.command["wrench"].tolist() == [0.0] * 6
    rig.it.gate.read(9)


def test_a_used_up_dose_is_not_given_back() -> None:
    rig = Rig(PLATE).enabled()
    rig.it.gate.fault(Trip.DOSE, 5)
    rig.state["it.heat.dose"] = 120.1
    for act in (lambda: rig.it.lifecycle.rearm(6), rig.it.lifecycle.reconnect):
        with pytest.raises(DeviceError, match="has given the whole thermal dose of a session"):
            act()
    assert rig.it.latch.status is Status.FAULT
    rig.state["it.trip"] = 0
    rig.it.latch.become(int(Status.OPEN))  # as whatever way back to enabling may leave it
    with pytest.raises(DeviceError, match="has given the whole thermal dose of a session"):
        rig.it.lifecycle.enable()


def test_a_latched_trip_refuses_to_be_enabled() -> None:
    rig = Rig(PLATE).enabled()
    rig.it.gate.fault(Trip.FLUX, 5)
    rig.it.latch.become(int(Status.OPEN))
    with pytest.raises(DeviceError, match="was stopped by flux: it must be re-armed first"):
        rig.it.lifecycle.enable()


def test_re_arming_is_bounded() -> None:
    rig = Rig(PLATE).enabled()
    for tick in range(5):
        rig.it.gate.fault(Trip.FLUX, tick)
        rig.it.lifecycle.rearm(tick)
    rig.it.gate.fault(Trip.FLUX, 6)
    with pytest.raises(
        DeviceError, match=r"was re-armed 5 times within a minute: find out why it stops, and wait 60 s"
    ):
        rig.it.lifecycle.rearm(6)
    rig.it.lifecycle.rearm(60_000)


def test_reconnecting_begins_anew_and_sends_nothing_old() -> None:
    rig = Rig().enabled()
    rig.it.command["wrench"][0] = rig.it.sent["wrench"][0] = 1.0
    rig.it.gate.fault(Trip.DEVICE_ERROR, 5)
    rig.it.command["wrench"][0] = 1.0
    rig.device.close_fails = OSError("gone")
    rig.state["it.age"] = 7
    rig.it.lifecycle.reconnect()
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.OPEN, Trip.NONE)
    assert rig.device.calls == ["open", "close", "open"]
    assert not np.any(rig.it.command["wrench"])
    assert not np.any(rig.it.sent["wrench"])
    assert rig.state["it.age"].item() == rig.state["it.sequence"].item() == 0
    rig.place = [1.5, 0.0, 0.0]
    rig.it.gate.read(6)  # wherever it is now


def test_a_surface_that_is_reconnected_keeps_its_target_until_it_is_enabled() -> None:
    rig = Rig(TABLE).enabled()
    rig.it.sent["pose_target"][2] = 0.02
    rig.it.lifecycle.reconnect()
    assert rig.it.sent["pose_target"][2] == pytest.approx(0.02 - 0.00025)  # closing had it retract


def test_reconnecting_what_is_missing_leaves_it_closed() -> None:
    rig = Rig().enabled()
    rig.device.open_fails = DeviceError("not there")
    with pytest.raises(DeviceError, match="not there"):
        rig.it.lifecycle.reconnect()
    assert rig.it.latch.status is Status.CLOSED


def test_closing_sends_what_is_safe_and_releases_even_if_that_fails() -> None:
    rig = Rig().enabled()
    rig.it.sent["wrench"][0] = 1.0
    rig.it.lifecycle.close()
    assert rig.last() == [0.0] * 6
    failing = Rig().enabled()
    failing.device.write_fails = OSError("gone")
    failing.it.lifecycle.abandon()
    assert failing.it.latch.status is Status.CLOSED
    assert failing.device.calls == ["open", "close"]


def test_a_device_that_does_not_return_from_closing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifecycle, "CLOSE_TIME", 0.02)
    rig, held = Rig().enabled(), threading.Event()
    rig.device.close = held.wait  # type: ignore[assignment,method-assign]
    with pytest.raises(DeviceError, match="did not return from closing within 0.02 s"):
        rig.it.lifecycle.close()
    held.set()
    assert rig.it.latch.status is Status.CLOSED
    assert rig.last() == [0.0] * 6


def test_a_device_that_has_not_returned_from_closing_is_not_opened_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """What came back late closed what had been opened meanwhile."""
    monkeypatch.setattr(lifecycle, "CLOSE_TIME", 0.02)
    wires = {"wires": classmethod(lambda cls, params: (f"a wire of {os.getpid()}",))}
    rig, go_on = Rig(cls=type("Wired", (Fake,), wires)).enabled(), threading.Event()

    def slow() -> None:
        go_on.wait(300)
        rig.device.calls.append("close")

    rig.device.close = slow  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match=r"has not returned from its driver's `close` yet, .*: open it again when"):
        rig.it.lifecycle.reconnect()
    assert rig.it.latch.status is Status.CLOSED
    with pytest.raises(DeviceError, match="has not returned from its driver's `close` yet"):
        rig.it.lifecycle.reconnect()
    rig.it.lifecycle.close()
    with pytest.raises(WireHeldError):  # the driver may still use it
        WireClaims().take([f"a wire of {os.getpid()}"])
    assert rig.device.calls == ["open"]
    closing = [one for one in threading.enumerate() if one.name == "close it"]
    go_on.set()
    for one in closing:
        one.join(300)
    rig.it.lifecycle.reconnect()
    assert rig.device.calls == ["open", "close", "open"]
    rig.it.lifecycle.close()
    WireClaims().take([f"a wire of {os.getpid()}"])


def test_a_surface_that_was_opened_retracts_from_where_it_stands_and_until_that_is_read_is_told_nothing() -> None:
    rig = Rig(TABLE)
    rig.it.sent["pose_target"] = (0.0, 0.0, 0.055, 1.0, 0.0, 0.0, 0.0)  # of an earlier session: it may stand elsewhere
    rig.it.lifecycle.open()
    rig.it.gate.write(0)
    assert rig.device.written == []
    assert rig.it.sent["pose_target"][2] == 0.055
    rig.it.gate.read(1)
    rig.it.gate.write(1)
    assert rig.last("pose_target")[:3] == pytest.approx((0.0, 0.0, 0.03 - LIMITS.speed * PERIOD), abs=1e-12)


def test_what_a_device_could_not_be_given_is_known() -> None:
    rig = Rig().enabled()
    rig.it.gate.write(1)
    assert not rig.it.gate.actuation.unsent
    rig.device.write_fails = OSError("gone")
    with pytest.raises(DeviceFaultError):
        rig.it.gate.write(2)
    rig.it.gate.fault(Trip.DEVICE_ERROR, 2)
    assert rig.it.gate.actuation.unsent
    rig.device.write_fails = None
    rig.it.gate.write(3)
    assert not rig.it.gate.actuation.unsent


def test_what_is_written_over_a_status_lets_nothing_through_and_is_put_right() -> None:
    rig = Rig().enabled()
    assert rig.it.latch.forged() == ""
    rig.it.gate.write(1)
    rig.it.gate.fault(Trip.SPEED, 2)
    rig.state["it.status"], rig.it.sent["wrench"][0] = Status.ENABLED, 1.0  # as compiled code would leave it then
    rig.it.gate.actuation.send(3)
    assert rig.last() == [0.0] * 6
    assert rig.state["it.status"] == Status.FAULT
    rig.state["it.status"] = 99
    assert rig.it.latch.forged() == "something has written 99 over its status"


def test_the_loss_of_an_optional_device_is_told_not_raised() -> None:
    rig = Rig().enabled()
    told: list[DeviceFaultError] = []
    rig.it.gate.on_loss = told.append
    rig.device.says = lost
    rig.it.gate.read(3)
    assert [(fault.device, fault.tick, fault.trip) for fault in told] == [("it", 3, Trip.DEVICE_ERROR)]
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.FAULT, Trip.DEVICE_ERROR)
    rig.it.gate.read(4)
    assert len(told) == 1


def test_a_limit_of_an_optional_device_stops_all() -> None:
    rig = Rig().enabled()
    rig.it.gate.on_loss = lambda fault: None
    rig.place[0] = math.nan
    with pytest.raises(DeviceFaultError):
        rig.it.gate.read(3)


def test_a_glance_judges_but_does_not_raise() -> None:
    rig = Rig().enabled()
    assert rig.it.gate.verify(1) is True
    rig.device.says = lambda reading: False
    assert rig.it.gate.verify(2) is False
    rig.device.says = lost
    rig.it.latch.disable()
    assert rig.it.gate.verify(3) is False
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.FAULT, Trip.DEVICE_ERROR)
    assert rig.state["it.tripped"].item() == 3
    assert rig.it.gate.verify(4) is False
    assert rig.state["it.tripped"].item() == 3
    rig.device.says = rig.say
    rig.place[0] = math.nan
    assert rig.it.gate.verify(5) is True
    assert rig.it.reading["pose"][0] == 0.0
    rig.it.lifecycle.abandon()
    assert rig.it.gate.verify(6) is False


def test_a_glance_at_a_jump_is_a_fault() -> None:
    rig = Rig().enabled()
    rig.place[0] = 0.0069
    assert rig.it.gate.verify(1) is True
    assert rig.it.latch.status is Status.ENABLED
    rig.place[0] = 0.0141
    assert rig.it.gate.verify(2) is True
    assert (rig.it.latch.status, rig.it.latch.trip) == (Status.FAULT, Trip.SENSOR_JUMP)
    slow = Rig(cls=Slow).enabled()
    slow.place[0] = 0.0269
    assert slow.it.gate.verify(5) is True
    assert slow.it.latch.status is Status.ENABLED


def test_a_surface_retracts_is_kept_held_or_driven_back() -> None:
    rig = Rig(TABLE).enabled()
    rig.it.latch.disable()
    heights = []
    rig.it.gate.write(0)
    heights.append(rig.last("pose_target")[2])
    rig.it.gate.actuation.keeping = True
    rig.it.gate.write(1)
    heights.append(rig.last("pose_target")[2])
    rig.it.gate.actuation.keeping = False
    for mode in (1, 2, 0):
        rig.state["it.stopped"] = mode
        rig.it.gate.write(2)
        heights.append(rig.last("pose_target")[2])
    assert np.diff(heights).tolist() == pytest.approx([0.0, 0.0, 0.00025, -0.00025])
    rig.state["it.stopped"] = 1
    rig.it.gate.fault(Trip.TRACKING, 3)
    rig.it.lifecycle.rearm(0)
    assert rig.state["it.stopped"].item() == 0


def test_without_a_device_nothing_is_written_and_nothing_is_new() -> None:
    one = model(ARM)
    it = Supervised(one, state(one), PERIOD)
    it.lifecycle.open()
    it.gate.read(0)
    assert it.gate.acquisition._age.item() == 1
    it.gate.write(0)
    it.lifecycle.close()


def test_a_twin_is_read_in_place_of_the_device() -> None:
    one = model(ARM, twin=True)
    data, twin = state(one), FakeTwin()

    def say(reading: Record) -> bool:
        reading["pose"][:4] = (0.1, 0.2, 0.3, 1.0)
        return True

    twin.says = say
    it = Supervised(one, data, PERIOD, twin=twin)
    it.lifecycle.open()
    it.gate.read(0)
    assert it.reading["pose"][:3].tolist() == [0.1, 0.2, 0.3]


def test_a_restored_session_compares_with_the_reading_in_state() -> None:
    rig = Rig().enabled()
    rig.it.gate.read(1)
    other = Rig()
    other.state.raw[:] = rig.state.raw
    other.it.gate.restore()
    other.place = [0.5, 0.0, 0.03]
    with pytest.raises(DeviceFaultError, match="not believable"):
        other.it.gate.read(2)
    fresh = Rig()
    fresh.it.lifecycle.open()
    fresh.it.gate.restore()
    fresh.place = [0.5, 0.0, 0.03]
    fresh.it.gate.read(0)


def test_starting_anew_forgets_the_last_trip() -> None:
    rig = Rig(PLATE).enabled()
    rig.it.gate.fault(Trip.FLUX, 5)
    rig.state["it.heat.share"] = 0.0
    rig.state["it.rearmed"] = 3
    rig.it.lifecycle.reset()
    assert set(rig.state["it.rearmed"].tolist()) == {-1}
    assert rig.state["it.tripped"].item() == -1
    assert rig.state["it.heat.share"].item() == 1.0
    assert rig.state["it.readings.known"].item() == 0


def test_what_acts_on_a_finger_of_which_nothing_tells_is_not_enabled() -> None:
    one = model(ARM)
    it = Supervised(one, state(one), PERIOD, device=Fake())
    it.lifecycle.reset()
    it.lifecycle.open()
    it.gate.read(0)
    it.lifecycle.blind = "no probe"
    with pytest.raises(DeviceError, match="device 'it' can't be enabled: no probe"):
        it.lifecycle.enable()
    it.lifecycle.blind = ""
    it.lifecycle.enable()
    assert it.latch.enabled


def test_the_trip_has_a_name_in_reports() -> None:
    assert Trip.NOT_A_NUMBER.label == "not-a-number"
    assert len({trip.label for trip in Trip}) == len(Trip) == 28
    assert [int(trip) for trip in Trip] == list(range(28))


def test_at_first_nothing_may_approach_and_the_whole_force_is_let_through() -> None:
    one = model(TABLE)
    it = Supervised(one, state(one), PERIOD)
    assert (it.gate.actuation.closing, it.gate.device_monitors.share, it.gate.actuation.keeping, it.gate.on_loss) == (
        0.0,
        1.0,
        False,
        None,
    )


def test_hardware_is_handed_from_one_session_to_the_next() -> None:
    old, new = Rig().enabled(), Rig()
    with pytest.raises(DeviceError, match="must be made safe before another scene takes it over"):
        new.it.lifecycle.take_over(old.it.lifecycle)
    assert old.it.gate.device is old.device
    old.it.latch.disable()
    new.it.lifecycle.take_over(old.it.lifecycle)
    assert (old.it.latch.status, old.it.gate.device) == (Status.CLOSED, None)
    assert (new.it.latch.status, new.it.gate.device) == (Status.OPEN, old.device)
    old.it.gate.write(1)
    assert old.device.written == []  # whoever gave it up can send nothing
    new.it.gate.read(1)
    new.it.lifecycle.enable()
    new.it.command["wrench"][2] = 1.0
    new.it.gate.write(1)
    assert len(old.device.written) == 1
    new.it.lifecycle.close()
    old.it.lifecycle.close()
    assert old.device.calls == ["open", "close"]


def test_a_latched_trip_is_handed_over_and_what_is_closed_is_not() -> None:
    old, new = Rig().enabled(), Rig()
    old.it.gate.fault(Trip.NOT_A_NUMBER, 3)
    new.state.raw[:] = old.state.raw
    new.it.lifecycle.take_over(old.it.lifecycle)
    assert (new.it.latch.status, new.it.latch.trip) == (Status.FAULT, Trip.NOT_A_NUMBER)
    closed, other = Rig(), Rig()
    other.it.lifecycle.take_over(closed.it.lifecycle)
    assert (other.it.latch.status, other.it.gate.device) == (Status.CLOSED, other.device)


def held_for(seconds: float, away: list[float], monkeypatch: pytest.MonkeyPatch, *, timed: bool = True) -> list[bool]:
    """Tell which readings of an arm trip that goes so far [m] in each tick; the first was held for so long [s]."""
    rig, clock = Rig().enabled(), [100.0]
    monkeypatch.setattr("itouch.safety.acquisition.time.monotonic", lambda: clock[0])
    rig.it.gate.acquisition.timed = timed
    rig.it.gate.read(1)
    found = []
    for tick, way in enumerate(away, 2):
        clock[0] += PERIOD + (seconds if tick == 2 else 0.0)
        rig.place[2] += way
        try:
            rig.it.gate.read(tick)
        except DeviceFaultError as error:
            assert error.trip is Trip.SENSOR_JUMP
            found.append(True)
            break
        found.append(False)
    return found


@pytest.mark.parametrize(
    ("seconds", "away", "trips"),
    [(0.0, 0.006, False), (0.0, 0.008, True), (0.02, 0.1, False), (0.02, 0.12, True), (0.3, 1.4, False), (-0.01, 0.008, True)],
)  # fmt: skip
def test_hardware_may_have_gone_on_as_long_as_a_tick_was_held(
    seconds: float, away: float, trips: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A finger does 5 m/s at most, and 2 mm at once; nothing is let through that its time does not allow."""
    assert held_for(seconds, [away], monkeypatch) == [trips]
    assert held_for(seconds, [away], monkeypatch, timed=False) == [away > 0.007]
    assert held_for(seconds, [0.0, 0.008], monkeypatch) == [False, True]  # once, and no more


def test_time_that_was_left_out_counts_for_what_is_read_after_it() -> None:
    rig = Rig().enabled()
    rig.it.gate.read(1)
    rig.it.gate.device_monitors.leave_out(30)
    rig.place[2] += 0.15
    rig.it.gate.read(2)
    rig.place[2] += 0.15
    with pytest.raises(DeviceFaultError, match="not believable"):
        rig.it.gate.read(3)


@pytest.mark.parametrize(("seconds", "away", "trips"), [(0.0, 0.008, True), (0.02, 0.1, False), (0.02, 0.12, True)])
def test_a_glance_knows_for_how_long_its_tick_was_held(
    seconds: float, away: float, trips: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, clock = Rig().enabled(), [100.0]
    monkeypatch.setattr("itouch.safety.acquisition.time.monotonic", lambda: clock[0])
    rig.it.gate.acquisition.timed = True
    rig.it.gate.read(1)
    for _ in range(300):
        clock[0] += PERIOD
        assert rig.it.gate.verify(1)
    clock[0] += PERIOD + seconds
    rig.place[2] += away
    rig.it.gate.verify(2)
    assert (rig.it.latch.trip is Trip.SENSOR_JUMP) is trips
    if not trips:  # and what was glanced at is no time that a later reading has not been looked at
        clock[0] += PERIOD
        rig.place[2] += 0.008
        with pytest.raises(DeviceFaultError, match="not believable"):
            rig.it.gate.read(3)


@pytest.mark.parametrize("number", [0, 1, 3, 99])
def test_what_is_written_over_a_status_changes_nothing_of_what_a_device_may_do(number: int) -> None:
    rig = Rig().enabled()
    rig.state["it.status"] = number
    with pytest.raises(DeviceFaultError, match=f"something has written {number} over its status"):
        rig.it.gate.actuation.send(1)
    assert rig.it.latch.status is Status.ENABLED  # it is for the safe sequence to change that
    rig.it.gate.fault(Trip.MODALITY_ERROR, 1)
    rig.state["it.status"] = number
    rig.it.gate.actuation.send(2)  # what is stopped is sent what is safe, whatever State says
    assert rig.it.latch.status is Status.FAULT


class TimestampedFake(Fake, Timestamped):
    """A device that knows when it measured: ``late`` ticks ago."""

    late = 0

    def measured(self, state: Record, tick: int, ticks: Any) -> None:
        ticks[...] = tick - self.late


@pytest.mark.parametrize(("answers_after", "refused"), [(0.0, False), (0.04, False), (0.06, True)])
def test_re_arming_waits_for_hardware_that_has_nothing_new_and_refuses_it_then(
    answers_after: float, refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, clock = Rig().enabled(), [100.0]
    monkeypatch.setattr("itouch.safety.acquisition.time.monotonic", lambda: clock[0])
    monkeypatch.setattr(
        "itouch.safety.acquisition.time.sleep", lambda seconds: clock.__setitem__(0, clock[0] + seconds)
    )
    rig.it.gate.acquisition.timed = True
    rig.it.gate.read(1)
    rig.it.gate.fault(Trip.SPEED, 2)
    clock[0] += 3.0  # nobody reads while all is stopped
    begun = clock[0]
    rig.device.says = lambda reading: rig.say(reading) and clock[0] >= begun + answers_after
    if refused:
        with pytest.raises(DeviceError, match="can't be re-armed: it was silent"):
            rig.it.lifecycle.may_rearm(2, clock[0] + 0.05)
        assert rig.it.latch.trip is Trip.SPEED
    else:
        rig.it.lifecycle.may_rearm(2, clock[0] + 0.05)
        rig.it.lifecycle.release(2)
        assert rig.it.latch.status is Status.OPEN


@pytest.mark.parametrize(("late", "refused"), [(5, False), (40, True)])
@pytest.mark.parametrize("channels", [ARM, PLATE], ids=["arm", "plate"])
def test_a_reading_that_was_measured_long_ago_is_no_answer(channels: Channels, late: int, refused: bool) -> None:
    rig = Rig(channels, cls=TimestampedFake).enabled()
    rig.it.gate.fault(Trip.DEVICE_ERROR, 100)
    TimestampedFake.late = late
    try:
        if refused:
            with pytest.raises(DeviceError, match="can't be re-armed: it was silent"):
                rig.it.lifecycle.rearm(200)
        else:
            rig.it.lifecycle.rearm(200)
    finally:
        TimestampedFake.late = 0


def test_a_twin_is_re_armed_with_the_reading_that_it_has() -> None:
    one = model(ARM)
    twin = FakeTwin()
    it = Supervised(one, state(one), PERIOD, twin=twin)
    it.lifecycle.reset()
    it.lifecycle.open()
    it.gate.read(0)
    it.lifecycle.enable()
    it.gate.fault(Trip.SPEED, 1)
    twin.says = lambda reading: False
    it.lifecycle.rearm(2)
    assert it.latch.status is Status.OPEN


class Deputy(Exchanged):
    """Stands for a device, and notes with each command how far a surface may retract by itself."""

    def __init__(self, device: Fake) -> None:
        super().__init__(device)
        self.noted: list[float] = []

    def open(self) -> None:
        self.device.open()

    def close(self) -> None:
        self.device.close()

    def read(self, reading: Record) -> bool | None:
        return self.device.read(reading)

    def write(self, command: Record) -> None:
        self.noted.append(self.lowest)


@pytest.mark.parametrize(
    ("stopped", "leg", "lowest"),
    [(0, math.nan, math.nan), (HELD, math.nan, math.inf), (BACKWARDS, math.nan, math.inf), (0, 0.02, 0.02)],
)
def test_who_stands_for_a_surface_is_told_how_far_it_may_retract_by_itself(
    stopped: int, leg: float, lowest: float
) -> None:
    """Behind an exchange what nobody renews becomes the safe command, which may lead such a surface to the finger."""
    rig = Rig(TABLE)
    deputy = Deputy(rig.device)
    rig.it.gate.device = deputy
    rig.enabled().it.gate.write(1)
    rig.it.gate.fault(Trip.TRACKING, 2)
    rig.state["it.stopped"], rig.state["it.way"][1] = stopped, leg
    rig.it.gate.write(3)
    assert math.isnan(deputy.noted[0]) and np.array_equal(deputy.noted[-1], lowest, equal_nan=True)
    rig.it.gate.actuation.settle()  # the sequence is over
    assert deputy.lowest == math.inf
    rig.it.gate.actuation.settle(over=False)
    assert np.array_equal(deputy.lowest, lowest, equal_nan=True)
    rig.it.lifecycle.rearm(4)
    rig.it.lifecycle.enable()
    rig.it.gate.write(5)
    assert math.isnan(deputy.noted[-1])


def test_an_arm_behind_an_exchange_knows_no_lowest_height() -> None:
    rig = Rig(ARM)
    deputy = Deputy(rig.device)
    rig.it.gate.device = deputy
    rig.enabled().it.gate.write(1)
    rig.it.gate.fault(Trip.SPEED, 2)
    assert all(math.isnan(one) for one in deputy.noted)


@pytest.mark.parametrize("optional", [False, True])
def test_a_device_that_could_not_be_reconnected_is_not_passed_over(optional: bool) -> None:
    rig = Rig(optional=optional).enabled()
    rig.it.gate.fault(Trip.DEVICE_ERROR, 2)
    rig.device.open_fails = DeviceError("is gone")
    with pytest.raises(DeviceError, match="is gone"):
        rig.it.lifecycle.reconnect()
    if optional:  # the session goes on without it
        rig.it.lifecycle.rearm(3)
    else:
        with pytest.raises(DeviceError, match="could not be reconnected: reconnect it first"):
            rig.it.lifecycle.rearm(3)
    rig.device.open_fails = None
    rig.it.lifecycle.reconnect()
    rig.it.lifecycle.rearm(3)
    assert rig.it.latch.status is Status.OPEN
