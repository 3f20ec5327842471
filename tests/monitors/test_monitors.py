"""The smaller monitors, and the panel that asks them all."""

from __future__ import annotations

import dataclasses
import math
import pickle
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest
from small_devices import ARM, LIMITS, PERIOD, PLATE, TABLE, Asked, Fake, FakeTwin, Supervised, model, state

from itouch.monitors import (
    Arm,
    DeviceFaultError,
    Heat,
    Ordinary,
    Push,
    Readings,
    Surface,
    Trip,
    TripError,
    own_monitors,
)
from itouch.monitors.default_limits import DeviceLimits
from itouch.plugin import (
    Channel,
    Moment,
    Monitor,
    Record,
    Role,
    Watched,
    measured_wrench,
    plate_temperature,
    pose_target,
    temperature,
    temperature_target,
)
from itouch.plugin.timestamps import Timestamped
from itouch.safety import DeviceMonitors, Guard
from itouch.safety.monitor_step import clocked
from itouch.world.supervision import monitors_of, watched

PAD = ((measured_wrench(),), (Channel("air", 1, "Pa", (0.0,), (5e4,), safe=(0.0,), role=Role.PRESSURE, harmless="x"),))


def test_a_pressure_is_cut_down_between_limit_and_trip() -> None:
    pad = Asked(Push, PAD)
    for force, share in ((1.9, 1.0), (2.0, 1.0), (3.5, 0.5), (5.0, 0.0)):
        pad.reading["wrench"][:3] = (0.0, force, 0.0)
        assert pad.check() == pytest.approx(share)
    pad.reading["wrench"][0] = 5.01
    with pytest.raises(TripError, match=r"presses with 7\.1 N"):
        pad.check()
    assert pad.monitor.watches == ("air",)
    assert pad.monitor.rule(int(Trip.PLATE_FORCE), pad.reading) == pad.monitor.rules()[0].number == "K4"


def test_the_watchdog_counts_the_age() -> None:
    dog = Asked(Ordinary, ARM)
    dog.moment.age = 0.02
    assert dog.check() == 1.0
    dog.moment.age = 0.0201
    with pytest.raises(TripError, match=r"was silent for 0\.020 s"):
        dog.check()
    assert dog.monitor.rule(int(Trip.SILENT), dog.reading) == "W1"


def said(channels: object, limits: DeviceLimits = LIMITS, *, twin: bool = False) -> dict[str, str]:
    device = watched("it", "fake", None, channels, limits, twin=twin)  # type: ignore[arg-type]
    return {f"{r.number} {r.quantity}".lstrip(): r.limit or r.trip for one in own_monitors(device) for r in one.rules()}


def test_rules_say_only_what_is_in_force() -> None:
    assert "K4 force of the surface on the finger, in all directions" in said(TABLE)
    without = dataclasses.replace(LIMITS, plate_force=None)
    blind = said((TABLE[0][:1], TABLE[1]), without)
    assert not any(name.startswith("K4") or "force without" in name for name in blind)
    nowhere = said(((), (Channel("pose_target", 7, "m", role=Role.SURFACE_POSE, safe=(0.0,) * 7),)), without)
    assert not any(name.startswith(("K5", "K6")) for name in nowhere)
    assert said(PLATE)["current"] == "2 A"
    assert said(PAD)["air"] == "5e+04 Pa"
    assert said(PAD)["air is not watched"] == "x"
    share = Channel("share", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.DRIVE, harmless="a lamp")
    assert said(((), (share,)))["share"] == "1"
    assert said(((plate_temperature(),), (temperature_target("goal"),)))["goal"] == "15 to 40 °C"
    assert said(ARM, dataclasses.replace(LIMITS, ramp=0.5))["K3 ramp-in"] == "0.5 s; 0.5 s after re-arming"
    assert not any(name.startswith(("T6", "T7", "T9")) for name in said(((plate_temperature(),), ())))
    assert "T8 plausibility of its readings" in said(((Channel("hum", 1, "1"),), ()))


def test_several_plates_of_one_device_have_a_monitor_each() -> None:
    skin = Role.SKIN_CONTACT_TEMPERATURE
    reads = (temperature("left", skin), temperature("right", skin))
    drive = Channel("i", 2, "A", (-2.0,) * 2, (2.0,) * 2, safe=(0.0,) * 2, role=Role.DRIVE)
    one, two = (Asked(Heat, (reads, (drive,)), index=index) for index in (0, 1))
    assert (one.monitor.name, two.monitor.name) == ("heat", "heat2")
    for asked in (one, two):
        asked.reading["left"], asked.reading["right"] = 300.0, 316.0
    assert one.check() == 1.0
    with pytest.raises(TripError, match="reads right 42"):
        two.check()
    together = Asked(Readings, (reads, (drive,)))
    together.reading["left"], together.reading["right"] = 300.0, 310.0
    assert together.check() == 1.0  # two plates, not two sensors of one
    same = Asked(Readings, (reads, ()))
    same.reading["left"], same.reading["right"] = 300.0, 310.0
    with pytest.raises(TripError, match="two sensors that differ by 10.0 K"):
        same.check()


def test_an_output_that_is_off_drives_nothing() -> None:
    switch = Channel("output", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.OUTPUT_SWITCH)
    plate = Asked(Heat, ((plate_temperature(),), (temperature_target("goal"), switch)))
    plate.reading["plate_temperature"] = 300.0
    plate.sent["goal"], plate.sent["output"] = 288.15, 0.0
    plate.check()
    assert plate.state["driven_for"].item() == 0.0
    plate.sent["output"] = 1.0
    plate.check()
    assert plate.state["driven_for"].item() > 0.0


def test_a_heater_that_goes_one_way_heats() -> None:
    heater = Channel("w", 1, "W", (0.0,), (10.0,), safe=(0.0,), role=Role.DRIVE)
    plate = Asked(Heat, ((plate_temperature(),), (heater,)))
    plate.moment.touched, plate.sent["w"] = False, 8.0
    for index in range(300):
        plate.reading["plate_temperature"] = 300.0 + 0.01 * index
        plate.check(0.01)
    with pytest.raises(TripError, match="against its drive"):
        for index in range(300):
            plate.reading["plate_temperature"] = 303.0 - 0.015 * index
            plate.check(0.01)


def test_a_drifted_sensor_is_on_the_wrong_side_of_its_sink() -> None:
    plate = Asked(Heat, PLATE)
    plate.moment.touched, plate.sent["current"] = False, 0.4
    plate.reading["sink_temperature"], plate.reading["heat_flux"] = 296.0, 0.0

    def wait(kelvin: float, seconds: float) -> None:
        for index in range(round(seconds / 0.01)):
            plate.reading["plate_temperature"] = kelvin + 1e-3 * (index % 3)
            plate.check(0.01)

    wait(305.9, 30.0)
    wait(306.1, 9.9)
    plate.moment.touched = True
    wait(306.1, 0.1)
    plate.moment.touched = False
    with pytest.raises(TripError, match=r"10\.1 K on the wrong side of its heat sink for 10\.0 s"):
        wait(306.1, 10.1)
    assert plate.monitor.rule(int(Trip.SENSOR_DISAGREE), plate.reading) == "T8"


def test_names_of_monitors_are_unique() -> None:
    device = watched("it", "fake", None, ARM, LIMITS, twin=True)
    with pytest.raises(ValueError, match="two monitors of device 'it' are named 'arm'"):
        monitors_of(device, [Arm])


def test_a_late_loop_leaves_out_periods_but_not_time() -> None:
    one = model(PLATE, twin=True)
    data = state(one)
    device = Supervised(one, data, PERIOD, device=Fake())
    device.lifecycle.reset()
    device.lifecycle.open()
    for name in ("plate_temperature", "sink_temperature"):
        device.reading[name] = 314.0
    device.gate.read(0)
    device.gate.device_monitors.leave_out(500)
    device.reading["plate_temperature"] = 314.001
    device.gate.read(1)
    assert data["it.heat.dose"].item() == pytest.approx(0.501 * 0.25 ** (316.15 - 314.0), rel=1e-2)


def test_a_panel_without_a_surface_has_none() -> None:
    one = model(((), ()), twin=True)
    data = state(one)
    panel = Supervised(one, data, PERIOD).gate.device_monitors
    assert isinstance(panel, DeviceMonitors)
    panel.reset()
    assert panel.closing(0.0, 0.0) == 0.0
    assert panel.follow(0.5, False) == 0.5
    panel.count_contact(1, True)
    panel.put_back()
    panel.mend()
    assert panel.usable()
    assert not panel.withdrawn
    assert panel.spent() == ""


def test_a_panel_without_monitors_lets_a_device_be_silent() -> None:
    one = dataclasses.replace(model(((), ()), twin=True), monitors=())
    panel = Supervised(one, state(one), PERIOD).gate.device_monitors
    panel.reset()
    panel.wait(1, 1e9)
    assert panel.usable()


@pytest.mark.parametrize("rate", [500.0, 1000.0, 1024.0, 3000.0, 4000.0, 7777.0])
def test_times_are_rounded_to_a_nanosecond(rate: float) -> None:
    """As decimal numbers: what was measured 50 ms ago was that, whatever the sum of periods is."""
    for ticks in [*range(2000), *range(999_000, 1_000_000), 86_400_000, 600_000_001]:
        assert clocked(ticks, 1.0 / rate) == round(ticks * (1.0 / rate), 9)


def test_a_surface_without_a_place_or_a_force() -> None:
    blind = Asked(Surface, ((), (pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.2),)))
    blind.moment.gap, blind.moment.calibrated = -0.001, True
    assert blind.check() == 1.0
    assert blind.moment.touched
    assert blind.monitor.watches == ()


class Toy(Monitor):
    """A monitor that does what a test says."""

    name = "toy"
    trips: ClassVar[dict[int, str]] = {1: "one", 2: "two"}
    says: ClassVar[Any] = 1.0
    needs_finger_position: ClassVar[bool] = False

    @classmethod
    def of(cls, device: Watched) -> Iterator[Monitor]:
        yield cls(device)

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        if isinstance(self.says, BaseException):
            raise self.says
        reading.numbers[:], sent.numbers[:], moment.touched = 0.0, 9.0, False  # what it is shown is its own
        return self.says  # type: ignore[no-any-return]

    def rule(self, code: int, reading: Record) -> str:
        if code == 2:
            raise RuntimeError
        return ""


class PlacedToy(Toy):
    name = "placed"
    needs_finger_position: ClassVar[bool] = True


def toyed(says: Any, kind: type[Toy] = Toy, twin: Any = None) -> Supervised:
    one = model(PLATE, offered=[type("Toy", (kind,), {"says": says})], twin=twin is not None)
    device = Supervised(one, state(one), PERIOD, device=None if twin else Fake(), twin=twin)
    device.lifecycle.reset()
    device.lifecycle.open()
    for name in ("plate_temperature", "sink_temperature"):
        device.reading[name] = 300.0
    return device


@pytest.mark.parametrize(
    ("says", "trip", "words"),
    [
        (-1.0, Trip.MONITOR, "was stopped by one"), (-2.0, Trip.MONITOR, r"stopped by two \(RuntimeError while it was reported"),
        (-3.0, Trip.MONITOR_ERROR, "returned -3.0: neither a share nor a trip"),
        (math.nan, Trip.MONITOR_ERROR, "returned nan"), (2.0, Trip.MONITOR_ERROR, "returned 2.0"),
        (-math.inf, Trip.MONITOR_ERROR, "returned -inf"), (ValueError("no"), Trip.MONITOR_ERROR, "failed: ValueError: no"),
        (SystemExit(3), Trip.MONITOR_ERROR, "failed: SystemExit: 3"), ("0.5", Trip.MONITOR_ERROR, "'0.5' is not a number"),
        (b"1", Trip.MONITOR_ERROR, "b'1' is not a number"), (None, Trip.MONITOR_ERROR, "failed: TypeError"),
    ],
)  # fmt: skip
def test_what_a_monitor_may_return(says: Any, trip: Trip, words: str) -> None:
    with pytest.raises(DeviceFaultError, match=words) as caught:
        toyed(says).gate.read(0)
    assert caught.value.trip is trip


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_monitor_may_leave_nothing_or_all(share: float) -> None:
    device = toyed(share)
    device.gate.read(0)
    assert device.gate.device_monitors.share == share


def test_what_a_monitor_of_a_plugin_writes_is_seen_by_nobody() -> None:
    device = toyed(0.5)
    device.gate.read(0)
    assert device.gate.device_monitors.seen["plate_temperature"].item() == 300.0
    assert device.sent["current"].item() == 0.0
    assert device.gate.device_monitors.moment.touched


def test_ctrl_c_in_a_plugin_is_ctrl_c() -> None:
    class Interrupted(Toy):
        def rule(self, code: int, reading: Record) -> str:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        toyed(KeyboardInterrupt()).gate.read(0)
    with pytest.raises(KeyboardInterrupt):
        toyed(-1.0, Interrupted).gate.read(0)
    device = toyed(1.0)
    assert isinstance(device.gate.device, Fake)

    def stop(reading: Record) -> bool:
        raise KeyboardInterrupt

    device.gate.read(0)
    device.gate.device.write_fails = KeyboardInterrupt()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        device.gate.write(1)
    device.gate.device.says = stop
    with pytest.raises(KeyboardInterrupt):
        device.gate.read(2)


def test_the_words_of_a_monitor_that_says_nothing() -> None:
    toy = Asked(Toy, PLATE)
    assert Monitor.sentence(toy.monitor, 7, toy.state, toy.reading, toy.moment) == "was stopped by code 7"
    assert Monitor.rule(toy.monitor, 1, toy.reading) == ""
    assert (toy.monitor.watches, toy.monitor.fields(), toy.monitor.rules()) == ((), (), ())


def test_a_monitor_that_is_told_where_the_finger_is() -> None:
    device = toyed(0.5, PlacedToy)
    device.gate.read(0)
    device.lifecycle.enable()
    device.gate.acquisition.watch_placed(0)
    assert device.gate.device_monitors.share == 0.5
    device.gate.device_monitors.restore()
    assert device.gate.device_monitors.share == 0.5
    broken = toyed(-1.0, PlacedToy)
    with pytest.raises(DeviceFaultError, match="was stopped by one"):
        broken.gate.acquisition.watch_placed(0)
    assert broken.latch.tripped == -1


def test_a_surface_says_what_is_touched_and_how_fast_it_may_close_in() -> None:
    one = model(TABLE)
    device = Supervised(one, state(one), PERIOD, device=Fake())
    device.lifecycle.reset()
    device.lifecycle.open()
    device.reading["wrench"][2] = -1.0
    device.gate.read(0)
    device.gate.device_monitors.moment.gap, device.gate.device_monitors.moment.tracking_error = -0.001, 0.0
    device.gate.acquisition.watch_placed(0)
    assert device.gate.device_monitors.touched
    assert device.gate.device_monitors.force == 1.0
    device.gate.acquisition.watch_placed(1)  # not its turn
    assert device.gate.device_monitors.closing(0.05, 0.0) == 0.25
    count = device.gate.device_monitors._clamped.item()
    assert device.gate.device_monitors.closing(0.05, 0.004) == 0.0
    assert device.gate.device_monitors._clamped.item() == count + 1
    assert device.gate.device_monitors.follow(0.03, False) == 0.03
    assert device.gate.device_monitors._clamped.item() == count + 1
    surface = device.gate.device_monitors.surface
    assert surface is not None
    surface.state["withdrawn"][...] = 1
    assert device.gate.device_monitors.withdrawn
    assert device.gate.device_monitors.follow(0.03, False) == 0.0
    assert device.gate.device_monitors._clamped.item() == count + 2


class TimestampedTwin(FakeTwin, Timestamped):
    """A twin that knows when it measured, and what has left."""

    left: int | None = 3

    def measured(self, state: Record, tick: int, ticks: Any) -> None:
        ticks[...] = tick - 2

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        return self.left


def test_a_reading_may_be_older_than_it_comes() -> None:
    twin = TimestampedTwin()
    device = toyed(1.0, twin=twin)
    device.gate.read(0)
    assert set(device.gate.acquisition._measured.tolist()) == {-2}
    device.gate.acquisition._left = np.zeros((), np.int64)
    device.gate.read(1)
    assert device.gate.acquisition._left.item() == 3
    twin.left, twin.says = None, lambda reading: False
    device.gate.read(2)
    assert (device.gate.acquisition._left.item(), set(device.gate.acquisition._measured.tolist())) == (3, {-1})


@pytest.mark.parametrize("channels", [PLATE, ARM, TABLE], ids=["plate", "arm", "table"])
@pytest.mark.parametrize(("behind", "silent"), [(20, False), (21, True)])
def test_a_reading_is_as_old_as_what_was_measured_first(channels: Any, behind: int, silent: bool) -> None:
    """The watchdog of 20 ms counts from when it was measured, of what may be hurt by or press; only while enabled."""

    class Old(TimestampedTwin):
        def measured(self, state: Record, tick: int, ticks: Any) -> None:
            ticks[...] = tick
            ticks[0] = tick - behind

    one = model(channels, twin=True)
    device = Supervised(one, state(one), PERIOD, twin=Old())
    device.lifecycle.reset()
    device.lifecycle.open()
    for name, view in device.reading.items():
        view[...] = 300.0 if name.endswith("temperature") else 0.0
    device.gate.read(0)
    device.lifecycle.enable()
    if not silent:
        device.gate.read(1)
        return
    with pytest.raises(DeviceFaultError, match=r"was silent for 0\.021 s") as caught:
        device.gate.read(1)
    assert caught.value.trip is Trip.SILENT


def test_a_heat_sink_may_be_asked_now_and_then() -> None:
    class Sink(TimestampedTwin):
        def measured(self, state: Record, tick: int, ticks: Any) -> None:
            ticks[...] = tick, tick - 500, tick

    one = model(PLATE, twin=True)
    device = Supervised(one, state(one), PERIOD, twin=Sink())
    device.lifecycle.reset()
    device.lifecycle.open()
    device.reading["plate_temperature"] = device.reading["sink_temperature"] = 300.0
    device.gate.read(0)
    device.lifecycle.enable()
    device.gate.read(1)


def test_a_target_goes_to_the_middle_as_less_is_left() -> None:
    guard = Guard(temperature_target("goal", low=250.0, high=400.0), LIMITS)
    for share, most in ((1.0, 313.15), (0.5, 306.9), (0.0, 300.65)):
        sent = np.array([300.0])
        guard.limit(np.array([400.0]), sent, share, 1.0, 0.0)
        assert sent[0] == pytest.approx(most)


def test_details_of_rules_and_windows() -> None:
    heat = Asked(Heat, PLATE)
    assert heat.monitor.watches == ("current",)
    heat.reading["plate_temperature"] = 315.5
    assert heat.monitor.rule(int(Trip.PLATE_TEMPERATURE), heat.reading) == "T1"
    heat.reading["plate_temperature"] = 280.0
    assert heat.monitor.rule(int(Trip.PLATE_TEMPERATURE), heat.reading) == "T2"
    heat.reading["plate_temperature"] = 300.0
    heat.check(0.01)
    heat.moment.fresh = True
    heat.monitor.check(heat.state, heat.reading, heat.sent, heat.moment)  # the same reading again
    assert heat.state["samples"].item() == 1
    arm = Asked(Arm, ARM)
    assert arm.monitor.watches == ("wrench",)
    assert [arm.monitor.rule(int(trip), arm.reading) for trip in (Trip.FINGER_FORCE, Trip.SPEED)] == ["K1", "K2"]
    skin = Role.SKIN_CONTACT_TEMPERATURE
    two = watched("it", "f", None, ((temperature("a", skin), temperature("b", skin)), ()), LIMITS, twin=False)
    assert "two sensors of one plate 3 K apart" in Readings(two).rules()[0].trip
    table = Asked(Surface, TABLE)
    table.moment.tracking_error = table.moment.gap = 0.0
    table.check(0.01)
    table.moment.now += 0.01  # it looks again, but nothing was measured since
    assert table.monitor.check(table.state, table.reading, table.sent, table.moment) == 1.0
    assert table.state["places"].item() == 1


def test_what_has_tripped_goes_to_another_process_whole() -> None:
    trip = pickle.loads(pickle.dumps(TripError(Trip.SPEED, "is too fast")))
    assert (trip.trip, str(trip)) == (Trip.SPEED, "is too fast")
    fault = pickle.loads(pickle.dumps(DeviceFaultError("arm", 7, Trip.SPEED, "was too fast")))
    assert (fault.device, fault.tick, fault.trip, fault.cause) == ("arm", 7, Trip.SPEED, "was too fast")
    assert str(fault) == "device 'arm' was too fast at tick 7"
