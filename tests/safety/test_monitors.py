"""The smaller monitors, and the panel that asks them all."""

from __future__ import annotations

import dataclasses

import pytest
from parts import ARM, LIMITS, PERIOD, PLATE, TABLE, Asked, Fake, model, state

from itouch.monitors import Arm, Heat, Ordinary, Push, Readings, Surface, Trip, TripError, own_monitors
from itouch.monitors.limits import DeviceLimits
from itouch.plugin import (
    Channel,
    Role,
    measured_wrench,
    plate_temperature,
    pose_target,
    temperature,
    temperature_target,
)
from itouch.safety import Panel, Supervisor
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
    assert said(((plate_temperature(),), (temperature_target("goal"),)))["goal"] == "15 to 40 °C"
    assert said(ARM, dataclasses.replace(LIMITS, ramp=0.5))["K3 ramp-in"] == "0.5 s; 0.5 s after re-arming"
    assert not any(name.startswith(("T6", "T7", "T9")) for name in said(((plate_temperature(),), ())))
    assert "T8 what its sensors read" in said(((Channel("hum", 1, "1"),), ()))


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
    device = Supervisor(one, data, PERIOD, device=Fake())
    device.reset()
    device.open()
    for name in ("plate_temperature", "sink_temperature"):
        device.reading[name] = 314.0
    device.read(0)
    device.leave_out(500)
    device.reading["plate_temperature"] = 314.001
    device.read(1)
    assert data["it.heat.dose"].item() == pytest.approx(0.501 * 0.25 ** (316.15 - 314.0), rel=1e-2)


def test_a_panel_without_a_surface_has_none() -> None:
    one = model(((), ()), twin=True)
    data = state(one)
    panel = Supervisor(one, data, PERIOD).panel
    assert isinstance(panel, Panel)
    panel.reset()
    assert panel.closing(0.0, 0.0) == 0.0
    assert panel.follow(0.5, False) == 0.5
    panel.count_contact(1, True)
    panel.put_back()
    assert panel.sane()
    assert not panel.withdrawn
    assert panel.spent() == ""


def test_a_surface_without_a_place_or_a_force() -> None:
    blind = Asked(Surface, ((), (pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.2),)))
    blind.moment.gap, blind.moment.calibrated = -0.001, True
    assert blind.check() == 1.0
    assert blind.moment.touched
    assert blind.monitor.watches == ()
