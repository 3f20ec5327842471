"""Monitors exactly at their limits, a hair beyond them, and in every word that they say."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np
import pytest
from small_devices import ARM, LIMITS, PERIOD, PLATE, TABLE, Asked, FakeTwin, Supervised, model, record, state

from itouch.monitors import (
    Arm,
    Heat,
    Ordinary,
    Push,
    Readings,
    Surface,
    Trip,
    TripError,
    carried_surface,
    heat_kernels,
    history_kernels,
    readings,
    runaway_kernels,
    surface_kernels,
    thresholds,
)
from itouch.monitors import default_limits as default
from itouch.monitors.default_limits import DeviceLimits
from itouch.monitors.heat import History
from itouch.monitors.runaway import Runaway, drive_of
from itouch.monitors.runaway_kernels import Look
from itouch.monitors.surface_kernels import FingerAbove, Load, SurfaceObservation, felt, pressed_by, rise
from itouch.monitors.thresholds import COLDEST_TARGET, LAG, PART, PARTS, READINGS, RUNAWAY_TIME, WINDOW
from itouch.plugin import (
    Channel,
    Field,
    Moment,
    Monitor,
    Record,
    Role,
    Rule,
    Watched,
    measured_wrench,
    temperature_target,
)
from itouch.safety import guard
from itouch.world.supervision import watched

K0 = 273.15
PAD = ((measured_wrench(),), (Channel("air", 1, "Pa", (0.0,), (5e4,), safe=(0.0,), role=Role.PRESSURE),))
SKIN = Role.SKIN_CONTACT_TEMPERATURE


def made(kind: type[Monitor], channels: Any, limits: DeviceLimits = LIMITS) -> tuple[Any, Record]:
    """Return a monitor and its State."""
    monitor = next(iter(kind.of(watched("it", "fake", None, channels, limits, twin=False))))
    memory = Record.of(monitor.fields())
    monitor.reset(memory)
    return monitor, memory


def beyond(value: float) -> float:
    """Return the next number that is larger in size."""
    return math.nextafter(value, math.copysign(math.inf, value))


# --- readings -------------------------------------------------------------------------------------------------------


def test_a_reading_that_jumps_as_far_as_it_may_is_believed() -> None:
    monitor, memory = made(Readings, PLATE)
    reading = record(PLATE[0])
    reading["plate_temperature"], reading["sink_temperature"], reading["heat_flux"] = 290.0, 300.0, 0.0
    assert monitor.check(memory, reading, reading, Moment(seconds=0.01)) == 1.0
    reading["plate_temperature"] = 310.0
    assert monitor.check(memory, reading, reading, Moment(seconds=0.01)) == 1.0
    reading["plate_temperature"], memory["figure"] = beyond(310.0) - 20.0 - 1e-9, (7.0, 7.0)
    assert monitor.check(memory, reading, reading, Moment(seconds=0.01)) == -Trip.SENSOR_JUMP
    assert memory["figure"].tolist() == [0.0, 0.0]
    assert memory["believed"].tolist() == [310.0, 300.0, 0.0]


def test_a_place_may_change_by_its_speed_and_a_step() -> None:
    monitor, memory = made(Readings, ARM)
    reading = record(ARM[0])
    reading["pose"][3] = 1.0
    assert monitor.check(memory, reading, reading, Moment(seconds=0.001)) == 1.0
    reading["pose"][1] = 5.0 * 0.001 + 0.002
    assert monitor.check(memory, reading, reading, Moment(seconds=0.001)) == 1.0
    reading["pose"][1] = 0.0
    assert monitor.check(memory, reading, reading, Moment(seconds=0.0009)) == -Trip.SENSOR_JUMP
    assert memory["figure"].tolist() == [1.0, 0.0]


def test_two_sensors_may_differ_by_three_kelvin() -> None:
    reads = (Channel("a", 2, "K", role=SKIN),)
    monitor, memory = made(Readings, (reads, ()))
    reading = record(reads)
    for apart, found in ((3.0, 1.0), (-3.0, 1.0), (3.0 + 1e-9, -float(Trip.SENSOR_DISAGREE))):
        reading["a"] = 300.0, 300.0 + apart
        assert monitor.check(memory, reading, reading, Moment(seconds=10.0)) == found
    assert memory["figure"].tolist() == [0.0, pytest.approx(3.0)]


def test_a_reading_out_of_range_says_which_number_and_is_not_remembered() -> None:
    reads = (Channel("a", 3, "1", (-1.0,) * 3, (2.0,) * 3),)
    monitor, memory = made(Readings, (reads, ()))
    reading = record(reads)
    for values, found, at in (((-1.0, 2.0, 0.0), 1.0, None), ((0.0, 0.0, beyond(2.0)), -float(Trip.SENSOR_RANGE), 2.0),
                              ((0.0, beyond(-1.0), 0.0), -float(Trip.SENSOR_RANGE), 1.0),
                              ((0.0, math.nan, 0.0), -float(Trip.NOT_A_NUMBER), 1.0)):  # fmt: skip
        memory["figure"] = 7.0, 7.0
        reading["a"] = values
        assert monitor.check(memory, reading, reading, Moment(seconds=1.0)) == found
        assert memory["figure"].tolist() == ([7.0, 7.0] if at is None else [at, 0.0])
        assert memory["believed"].tolist() == [-1.0, 2.0, 0.0]


def test_a_monitor_of_two_plates_reads_the_component_that_is_its_own() -> None:
    reads = (Channel("skin", 2, "K", role=SKIN),)
    drive = Channel("i", 2, "A", (-2.0,) * 2, (2.0,) * 2, safe=(0.0,) * 2, role=Role.DRIVE)
    device = watched("it", "fake", None, (reads, (drive,)), LIMITS, twin=False)
    reading, sent = record(reads), record((drive,))
    reading["skin"], sent["i"] = (290.0, 310.0), (0.5, -1.0)
    one, two = Heat.of(device)
    assert (one.shown(reading), two.shown(reading)) == ("at 16.9 degC", "at 36.9 degC")
    assert heat_kernels.drive(one.stands, sent.numbers, 290.0) == 0.25  # type: ignore[attr-defined]
    assert heat_kernels.drive(two.stands, sent.numbers, 310.0) == -0.5  # type: ignore[attr-defined]
    reading["skin"] = 290.0, math.nan
    assert two.shown(reading) == "not measured"


# --- heat -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("field", "most"), [("dose", 120.0), ("cold_time", 120.0)])
def test_a_budget_is_used_up_when_more_than_all_of_it_is(field: str, most: float) -> None:
    monitor, memory = made(Heat, PLATE)
    memory[field] = most
    assert monitor.exhausted_budget(memory) == ""
    memory[field] = beyond(most)
    assert monitor.exhausted_budget(memory) != ""


def test_dose_and_cold_time_begin_at_their_temperatures() -> None:
    monitor, memory = made(Heat, PLATE)
    touched, kept, held = Look(0.0, 0.0, 2.0, True), monitor.memory(memory), monitor.allowed
    for kelvin, dose, cold in ((312.15, 2.0 * 0.25**4, 0.0), (beyond(-312.15) * -1.0, 2.0 * 0.25**4, 0.0),
                               (316.15, 2.0, 0.0), (317.15, 4.0, 0.0), (315.15, 0.5, 0.0), (289.15, 0.0, 0.0),
                               (289.1, 0.0, 2.0), (312.1, 0.0, 0.0)):  # fmt: skip
        memory["dose"] = memory["cold_time"] = 0.0
        assert heat_kernels.count(held, kept, kelvin, touched) == 0.0
        assert (memory["dose"].item(), memory["cold_time"].item()) == (pytest.approx(dose), cold)
    memory["dose"], memory["cold_time"] = 119.0, 118.0
    assert heat_kernels.count(held, kept, 317.15 - 1.0, Look(0.0, 0.0, 1.0, True)) == 0.0  # exactly all of it
    assert heat_kernels.count(held, kept, 289.0, touched) == 0.0
    assert heat_kernels.count(held, kept, 316.15, touched) == -Trip.DOSE
    assert heat_kernels.count(held, kept, 289.0, touched) == -Trip.COLD
    assert heat_kernels.count(held, kept, 289.0, Look(0.0, 0.0, 2.0, False)) == 0.0


def test_the_share_that_a_temperature_a_little_ahead_leaves() -> None:
    monitor, memory = made(Heat, PLATE)
    for celsius, share in ((40.0, 1.0), (41.0, 0.5), (42.0, 0.0), (15.0, 1.0), (13.5, 0.5), (12.0, 0.0)):
        assert heat_kernels.near_temperature(monitor.allowed, monitor.memory(memory), K0 + celsius) == pytest.approx(
            share, abs=1e-9
        )
    for kelvin in (beyond(315.15), 285.15 - 1e-9):
        assert heat_kernels.near_temperature(monitor.allowed, monitor.memory(memory), kelvin) == -Trip.PLATE_TEMPERATURE
        assert memory["figure"].tolist() == [kelvin, kelvin, 0.0]


@pytest.mark.parametrize(("part", "share"), [(1.0, 1.0), (7.0 / 6.0, 0.5), (1.33, 0.01)])
def test_the_share_that_a_flux_leaves(part: float, share: float) -> None:
    monitor, memory = made(Heat, PLATE)
    for step in range(301):
        history_kernels.add(monitor.memory(memory).past, 0.005 * step, 300.0, 15e3 * part)
    assert heat_kernels.near_flux(monitor.allowed, monitor.memory(memory)) == pytest.approx(share, abs=1e-3)


def test_a_sensor_at_the_end_of_its_scale_all_the_time_trips() -> None:
    monitor, memory = made(Heat, PLATE)
    for step in range(301):
        history_kernels.add(monitor.memory(memory).past, 0.005 * step, 300.0, 20e3)
    assert heat_kernels.near_flux(monitor.allowed, monitor.memory(memory)) == -Trip.FLUX
    assert memory["figure"][0] == pytest.approx(20e3)


def test_a_sink_cuts_the_drive_down_between_50_and_55_degrees() -> None:
    monitor, memory = made(Heat, PLATE)
    reading, sent = record(PLATE[0]), record(PLATE[1])
    reading["plate_temperature"] = 300.0
    for celsius, share in ((50.0, 1.0), (51.0, 0.8), (55.0, 0.0), (60.0, 0.0)):
        reading["sink_temperature"] = K0 + celsius
        assert monitor.check(memory, reading, sent, Moment()) == pytest.approx(share, abs=1e-9)


def test_a_step_of_five_kelvin_is_let_pass() -> None:
    monitor, memory = made(Heat, PLATE)
    for top, found in ((305.0, 0.0), (305.1, -float(Trip.SENSOR_JUMP)), (294.9, -float(Trip.SENSOR_JUMP))):
        monitor.clear_history(memory)
        for step in range(41):
            history_kernels.add(monitor.memory(memory).past, 0.005 * step, 300.0 if step < 30 else top, 0.0)
        assert heat_kernels.jump(monitor.allowed, monitor.memory(memory)) == found
    assert memory["figure"][0] == pytest.approx(-5.1)


@pytest.mark.parametrize(("low", "high"), [((-2.0,), (0.0,)), ((-2.0,), (math.inf,)), ((), ())])
def test_a_drive_without_a_greatest_value_is_measured_in_its_unit(low: Any, high: Any) -> None:
    drive = Channel("w", 1, "W", low, high, safe=(0.0,), role=Role.DRIVE)
    monitor, _ = made(Heat, (PLATE[0], (drive,)))
    sent = record((drive,))
    sent["w"] = -0.4
    assert heat_kernels.drive(monitor.stands, sent.numbers, 300.0) == -0.4


def test_the_stronger_of_two_drives_counts() -> None:
    drive = Channel("i", 2, "A", (-2.0,) * 2, (2.0,) * 2, safe=(0.0,) * 2, role=Role.DRIVE)
    monitor, _ = made(Heat, (PLATE[0], (drive,)))
    sent = record((drive,))
    for both, found in (((0.5, -1.0), -0.5), ((-1.0, 0.5), -0.5), ((1.0, 1.0), 0.5), ((0.0, 0.0), 0.0)):
        sent["i"] = both
        assert heat_kernels.drive(monitor.stands, sent.numbers, 300.0) == found


def test_what_acts_is_driven_by_more_than_a_fiftieth() -> None:
    monitor, _ = made(Heat, PLATE)
    reading, sent = record(PLATE[0]), record(PLATE[1])
    for current, acts in ((0.04, False), (0.0401, True), (-0.0401, True), (0.0, False)):
        sent["current"] = current
        assert monitor.acts(reading, sent) is acts


def test_a_switch_that_is_half_on_is_on() -> None:
    switch = Channel("output", 1, "1", (0.0,), (1.0,), safe=(0.0,), role=Role.OUTPUT_SWITCH)
    monitor, _ = made(Heat, (PLATE[0], (temperature_target("goal"), switch)))
    sent = record((temperature_target("goal"), switch))
    sent["goal"] = 295.0
    for word, drive in ((0.0, 0.0), (0.499, 0.0), (0.5, 0.5), (1.0, 0.5)):
        sent["output"] = word
        assert heat_kernels.drive(monitor.stands, sent.numbers, 300.0) == drive


# --- drive and sensor -----------------------------------------------------------------------------------------------


def test_how_strongly_a_target_drives() -> None:
    goal = temperature_target("goal")
    for kelvin, drive in ((300.0, 0.0), (290.0, 1.0), (289.0, 1.0), (310.0, -1.0), (312.0, -1.0), (295.0, 0.5)):
        assert drive_of(goal, kelvin, 300.0, 1.0) == pytest.approx(drive)
    assert drive_of(goal, COLDEST_TARGET, 205.0, 1.0) == 0.5
    assert drive_of(goal, COLDEST_TARGET - 1e-9, 205.0, 1.0) == 0.0


@pytest.mark.parametrize(("low", "drive"), [((), 0.25), ((-2.0,), 0.25), ((0.0,), -0.25), ((0.5,), -0.25)])
def test_a_drive_that_goes_one_way_heats(low: Any, drive: float) -> None:
    high = (2.0,) if low else ()
    assert drive_of(Channel("w", 1, "W", low, high, role=Role.DRIVE), 0.5, 300.0, 2.0) == drive


def drifting() -> tuple[Runaway, Record]:
    runaway = Runaway(follows=True)
    memory = Record.of(runaway.fields())
    runaway.clear(memory)
    return runaway, memory


@pytest.mark.parametrize(
    ("drive", "kelvin", "touched", "counts"),
    [(0.3, 310.1, False, True), (0.3, 310.0, False, False), (0.3, 310.1, True, False), (0.1, 310.1, False, False),
     (0.5, 310.1, False, False), (0.49, 310.1, False, True), (0.11, 310.1, False, True), (-0.3, 310.1, False, False),
     (-0.3, 289.9, False, True), (-0.3, 290.0, False, False)],
)  # fmt: skip
def test_what_counts_as_the_wrong_side_of_the_sink(drive: float, kelvin: float, touched: bool, counts: bool) -> None:
    runaway, memory = drifting()
    memory["odd_for"] = 3.0
    assert (
        runaway_kernels.odd(runaway.checks, runaway.memory(memory), kelvin, 300.0, drive, Look(0.0, 0.0, 0.5, touched))
        == 0.0
    )
    assert memory["odd_for"].item() == (3.5 if counts else 0.0)


def test_ten_seconds_on_the_wrong_side_are_let_pass() -> None:
    runaway, memory = drifting()
    memory["odd_for"] = 9.5
    assert (
        runaway_kernels.odd(runaway.checks, runaway.memory(memory), 315.0, 300.0, 0.3, Look(0.0, 0.0, 0.5, False))
        == 0.0
    )
    assert (
        runaway_kernels.odd(runaway.checks, runaway.memory(memory), 315.0, 300.0, 0.3, Look(0.0, 0.0, 0.5, False))
        == -Trip.SENSOR_DISAGREE
    )
    assert memory["figure2"].tolist() == [15.0, 10.5]


def test_how_long_a_sensor_may_read_the_same() -> None:
    runaway, memory = drifting()

    def same(drives: list[float], seconds: float) -> list[float]:
        found = []
        memory["frozen"], memory["frozen_at"] = math.nan, 0.0
        for index, drive in enumerate(drives):
            found.append(
                runaway_kernels.still(
                    runaway.checks, runaway.memory(memory), 300.0, drive, Look(0.0, seconds * (index + 1), 0.0, True)
                )
            )
        return found

    frozen = -float(Trip.SENSOR_FROZEN)
    assert same([0.0, 0.5, 0.5, 0.5], 0.25)[:2] == [0.0, 0.0]  # 0.125 of full drive
    assert same([0.0, 1.0, 1.0], 0.15)[1:] == [0.0, frozen]  # exactly 0.15, then more
    assert same([1.0, 1.0, 1.0, 1.0], 0.25) == [0.0, 0.0, 0.0, frozen]  # held: exactly 0.5, then more
    assert same([0.5] * 9, 0.5) == [0.0] * 9  # not strong: more than half is
    assert same([0.0, 0.03, 0.03, 0.03, 0.03], 0.5) == [0.0, 0.0, 0.0, frozen, frozen]  # more than a second, driven
    assert same([0.0] + [0.0195] * 6, 0.5) == [0.0] * 7  # hardly driven
    assert memory["figure2"][0] == 2.0


def test_a_sensor_that_is_driven_by_just_a_fiftieth_may_be_still() -> None:
    runaway, memory = drifting()
    memory["frozen"], memory["frozen_at"], memory["frozen_for"] = 300.0, 1.0, 1.5
    memory["frozen_drive"], memory["frozen_from"] = 0.04, 0.3
    assert runaway_kernels.still(runaway.checks, runaway.memory(memory), 300.0, 0.3, Look(0.0, 1.5, 0.0, True)) == 0.0
    memory["frozen_for"], memory["frozen_drive"] = 1.5, beyond(0.04)
    assert (
        runaway_kernels.still(runaway.checks, runaway.memory(memory), 300.0, 0.3, Look(0.0, 2.0, 0.0, True))
        == -Trip.SENSOR_FROZEN
    )


@pytest.mark.parametrize(
    ("slope", "drive", "same", "stopped"),
    [(2.5, 0.3, 0.5, False), (2.5, 0.3, 0.51, True), (-2.5, -0.3, 0.51, True), (0.2, 0.3, 5.0, False),
     (0.25, 0.3, 5.0, True), (0.25, 0.3, 5.01, False), (2.0, 0.1, 0.6, False), (2.0, 0.11, 0.6, True),
     (1.0, 0.3, 1.0, False)],
)  # fmt: skip
def test_when_a_moving_plate_seems_to_have_stopped(slope: float, drive: float, same: float, stopped: bool) -> None:
    runaway, memory = drifting()
    memory["frozen_slope"] = slope
    kept = runaway.memory(memory)
    assert runaway_kernels.stopped(runaway.checks, kept, drive, same) is stopped
    assert not runaway_kernels.stopped(Runaway(follows=False).checks, kept, drive, same)


@pytest.mark.parametrize(
    ("slope", "same", "stopped"),
    [
        (5.1, 0.2, False),
        (5.1, 0.21, True),
        (-5.1, 0.21, True),
        (5.0, 0.21, False),
        (5.1, 5.0, True),
        (5.1, 5.01, False),
    ],
)
def test_a_fast_plate_does_not_stop_whatever_drives_it(slope: float, same: float, stopped: bool) -> None:
    watch, memory = drifting()
    memory["frozen_slope"] = slope
    kept = watch.memory(memory)
    assert runaway_kernels.stopped(watch.checks, kept, 0.0, same) is stopped
    holds = Runaway(follows=False).checks  # it may stop at its target, and a kelvin round it
    assert not runaway_kernels.stopped(holds, kept, 0.1, same)
    assert runaway_kernels.stopped(holds, kept, 0.11, same) is stopped
    assert runaway_kernels.stopped(holds, kept, -0.11, same) is stopped


def test_a_plate_may_go_against_its_drive_by_two_kelvin() -> None:
    runaway, memory = drifting()
    for now, kelvin, drive, found in (
        (1.0, 300.0, 0.5, 0.0), (2.0, 310.0, 0.5, 0.0), (2.5, 300.0, 0.6, 0.0), (3.0, 302.0, 0.6, 0.0),
        (3.5, 302.001, 0.6, -float(Trip.RUNAWAY)),
    ):  # fmt: skip
        memory["touched_at"] = now
        look = Look(now, 0.0, 0.5, True)
        assert runaway_kernels.against(runaway.checks, runaway.memory(memory), kelvin, drive, look) == found, now
    assert memory["figure2"].tolist() == [pytest.approx(2.001), 0.0]


@pytest.mark.parametrize(
    ("change", "alone", "trips"), [(0.1, 2.0, False), (0.09, 2.0, True), (0.09, RUNAWAY_TIME - 1e-9, True),
                                   (0.09, 1.99, False)]
)  # fmt: skip
def test_a_strong_drive_must_show_within_two_seconds(change: float, alone: float, trips: bool) -> None:
    runaway, memory = drifting()
    memory["touched_at"] = 10.0 - alone
    memory["driven_for"] = RUNAWAY_TIME - 1e-9 - 0.25
    memory["parts"][:] = -math.inf
    memory["parts"][95 % PARTS] = 9.5, 300.0, 300.0 + change
    found = runaway_kernels.against(runaway.checks, runaway.memory(memory), 300.0, 0.7, Look(10.0, 0.0, 0.25, True))
    assert found == (-float(Trip.RUNAWAY) if trips else 0.0)
    assert not trips or memory["figure2"].tolist() == [0.0, pytest.approx(2.0)]


def test_what_drove_one_way_and_turns_round_begins_anew() -> None:
    runaway, memory = drifting()
    memory["driven_for"] = 1.0
    assert (
        runaway_kernels.against(runaway.checks, runaway.memory(memory), 300.0, -0.8, Look(5.0, 0.0, 0.25, True)) == 0.0
    )
    assert memory["driven_for"].item() == 0.0
    assert (
        runaway_kernels.against(runaway.checks, runaway.memory(memory), 300.0, -0.8, Look(5.25, 0.0, 0.25, True)) == 0.0
    )
    assert memory["driven_for"].item() == -0.25
    assert (
        runaway_kernels.against(runaway.checks, runaway.memory(memory), 300.0, -0.5, Look(5.5, 0.0, 0.25, True)) == 0.0
    )
    assert memory["driven_for"].item() == 0.0


def test_temperature_extremes_are_of_the_last_two_seconds() -> None:
    watch, memory = drifting()
    for step in range(40):
        extremes = runaway_kernels.extremes(watch.memory(memory), 300.0 + step, 0.05 + 0.1 * step, 0.0)
    assert extremes == (319.0, 339.0)  # at 3.95 s: from the part on in which 1.95 s is
    assert runaway_kernels.extremes(watch.memory(memory), 200.0, 3.9, 3.95) == (200.0, 200.0)
    assert runaway_kernels.extremes(watch.memory(memory), 340.0, 4.0, 4.0)[1] == 340.0
    assert runaway_kernels.extremes(watch.memory(memory), 340.0, 4.0, 3.0)[0] >= 329.0
    assert (LAG, PART) == (0.15, 0.1)
    watch, memory = drifting()
    assert runaway_kernels.extremes(watch.memory(memory), 300.0, 1.0, 1.0) == (300.0, 300.0)
    assert runaway_kernels.extremes(watch.memory(memory), 301.0, 1.05, 1.0) == (
        300.0,
        301.0,
    )  # what was read at the begin counts


@pytest.mark.parametrize(("wrench", "force"), [
    ((0.0, 0.0, -2.0, 0.0, 0.0, 0.0), 2.0), ((0.3, 0.4, 0.0, 0.0, 0.0, 0.0), 0.5),
    ((0.0, 0.0, -2.0, -0.3, 0.4, 0.0), 5.0), ((0.0, 0.0, -2.0, -0.06, 0.08, 0.0), 2.0),
])  # fmt: skip
def test_a_torque_counts_as_the_force_that_has_it_at_its_lever(wrench: tuple[float, ...], force: float) -> None:
    load = Load(np.array(wrench), np.array([0]), np.array([[3, 4, -1]]), np.array([0.1]))
    assert felt(load) == pytest.approx(force)
    assert felt(Load(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.array([0.1]))) == 0.0


# --- history --------------------------------------------------------------------------------------------------------


def test_means_and_integrals_are_those_of_what_was_read() -> None:
    history = History((0.1, 0.2))
    memory = Record.of(history.fields())
    history.clear(memory)
    past = history.past(memory)
    assert history_kernels.newest(past) == 0.0 and not history_kernels.before(past, 0)[0]
    assert history_kernels.value_at(past, 0.0, 0) == 0.0 and history_kernels.mean_flux(past, 0) == 0.0
    for step in range(5):
        assert history_kernels.add(past, 1.0 + 0.05 * step, 300.0 + step, 100.0 * step)
        assert not history_kernels.add(past, 1.0 + 0.05 * step + 0.9e-7, 0.0, 0.0)
    assert history_kernels.newest(past) == 1.2
    assert memory["history"][4].tolist() == [1.2, 304.0, pytest.approx(0.05 * (300 + 301 + 302 + 303)),
                                             pytest.approx(0.05 * (50 + 150 + 250 + 350))]  # fmt: skip
    assert history_kernels.before(past, 0) == (True, pytest.approx(302.0)) and history_kernels.before(past, 1) == (
        True,
        300.0,
    )
    assert history_kernels.value_at(past, 1.125, 0) == pytest.approx(302.5)
    assert history_kernels.value_at(past, 0.5, 1) == 300.0
    assert history_kernels.mean_flux(past, 0) == pytest.approx(300.0)
    assert history_kernels.step(past, 0, 1) == pytest.approx(2.0)
    assert history_kernels.add(past, 1.2 + 1.1e-7, 304.0, 0.0)


def test_times_that_differ_by_a_rounding_are_one() -> None:
    history = History((10.0,))
    memory = Record.of(history.fields())
    history.clear(memory)
    past = history.past(memory)
    for time, kelvin in ((0.0, 300.0), (0.5 + 1e-7, 310.0), (1.0, 320.0)):
        history_kernels.add(past, time, kelvin, 0.0)
    assert history_kernels.value_at(past, 0.5, 0) == 310.0


def test_a_place_of_just_fifty_milliseconds_ago_is_known() -> None:
    monitor, memory = made(Surface, TABLE)
    memory["places"], memory["track"][0] = 1, (1.0 - WINDOW, *np.zeros(6))
    assert surface_kernels._before(monitor.memory(memory), np.zeros(7), (0.0,) * 3, 1.0) == 0


def test_a_full_ring_forgets_the_oldest() -> None:
    history = History((10.0, 0.01))
    memory = Record.of(history.fields())
    history.clear(memory)
    past = history.past(memory)
    for step in range(READINGS + 5):
        history_kernels.add(past, 0.01 * step, float(step), 0.0)
    assert not history_kernels.before(past, 0)[0]
    assert history_kernels.value_at(past, 0.0, 0) == 5.0
    assert history_kernels.before(past, 1) == (True, pytest.approx(READINGS + 3.0))


# --- surfaces, arms, pressure, silence ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("load", "gap", "calibrated", "touched"),
    [(0.03, 1.0, True, False), (beyond(0.03), 1.0, True, True), (0.0, 2e-4, True, False), (0.0, 1.9e-4, True, True),
     (0.0, 1.9e-4, False, False), (0.0, -0.001, False, False)],  # a place that is not calibrated says nothing
)  # fmt: skip
def test_from_where_a_surface_is_touched(load: float, gap: float, calibrated: bool, touched: bool) -> None:
    monitor, memory = made(Surface, TABLE)
    reading, moment = record(TABLE[0]), Moment(now=1.0, time=1.0, gap=gap, calibrated=calibrated)
    reading["wrench"][2] = -load
    assert monitor.check(memory, reading, record(TABLE[1]), moment) == 1.0
    assert (moment.touched, moment.force) == (touched, load)


@pytest.mark.parametrize(("load", "found"), [(5.0, 1.0), (beyond(5.0), -float(Trip.PLATE_FORCE))])
def test_a_surface_trips_above_five_newton(load: float, found: float) -> None:
    monitor, memory = made(Surface, TABLE)
    reading = record(TABLE[0])
    reading["wrench"][1] = load
    assert monitor.check(memory, reading, record(TABLE[1]), Moment(now=1.0, time=1.0, gap=0.0)) == found


def looked(
    seconds: float = 0.0, tracking_error: float = 0.0, gap: float = 0.0, calibrated: bool = False
) -> SurfaceObservation:
    """Return a look at a surface after a second."""
    return SurfaceObservation(1.0, 1.0, seconds, tracking_error, gap, calibrated)


def test_a_surface_may_be_astray_for_a_tenth_of_a_second() -> None:
    monitor, memory = made(Surface, TABLE)
    kept = monitor.memory(memory)
    assert not surface_kernels._astray(kept, looked(tracking_error=0.005, seconds=9.0))
    for _ in range(10):
        assert not surface_kernels._astray(kept, looked(tracking_error=0.0051, seconds=0.01))
    assert memory["strayed_for"].item() == pytest.approx(0.1)
    assert surface_kernels._astray(kept, looked(tracking_error=0.0051, seconds=0.0001))
    assert not surface_kernels._astray(kept, looked(tracking_error=math.nan, seconds=9.0))
    assert memory["strayed_for"].item() == 0.0


def test_a_surface_behind_a_wire_is_astray_from_where_it_was_sent_when_it_was_measured() -> None:
    """Of the commands that have left it is the newest that acted by then; while none is known, the one given."""
    one = model(TABLE, twin=True)
    data = state(one, wire=True)
    table = Supervised(one, data, PERIOD, twin=FakeTwin())
    table.reading["pose"][:3] = 0.0, 0.003, 0.020
    table.gate.acquisition._measured[...] = 100
    assert table.gate.acquisition.tracking_error(0.5) == 0.5
    for left, height in ((60, 0.030), (80, 0.024), (101, 0.010)):
        table.gate.acquisition._out["pose_target"][2] = height
        table.gate.acquisition.departures.note(left)
    assert table.gate.acquisition.tracking_error(0.5) == pytest.approx(0.005)
    table.gate.acquisition._measured[...] = 79
    assert table.gate.acquisition.tracking_error(0.5) == pytest.approx(math.hypot(0.003, 0.010))
    table.gate.acquisition._measured[...] = 59
    assert table.gate.acquisition.tracking_error(0.5) == 0.5
    for left in range(200, 300):  # what left long ago is forgotten
        table.gate.acquisition._out["pose_target"][2] = 0.020
        table.gate.acquisition.departures.note(left)
    table.gate.acquisition._measured[...] = 150
    assert table.gate.acquisition.tracking_error(0.5) == 0.5
    table.gate.acquisition._measured[...] = 400
    assert table.gate.acquisition.tracking_error(0.5) == pytest.approx(0.003)
    other = Supervised(model(TABLE, twin=True), state(model(TABLE, twin=True)), PERIOD, twin=FakeTwin())
    other.gate.acquisition.departures.note(3)
    assert other.gate.acquisition.tracking_error(0.25) == 0.25  # no wire


def test_the_clock_of_contact_at_its_limits() -> None:
    monitor, memory = made(Surface, TABLE)
    for start, touched, withdrawn, found in ((9.5, True, 0, 1.0), (9.51, True, 1, 1.0), (59.5, True, 1, 1.0),
                                             (59.51, True, 0, -float(Trip.CONTACT_TIME)), (0.3, False, 0, 1.0)):  # fmt: skip
        memory["contact_time"], memory["counted"], memory["withdrawn"] = start, 1.0, 0
        assert monitor.count(memory, 1.5, touched) == found
        assert memory["withdrawn"].item() == withdrawn
        assert memory["contact_time"].item() == pytest.approx(start + 0.5 if touched else 0.0)
    memory["counted"] = 1.0
    assert monitor.count(memory, 1.0099, True) == 1.0 and memory["counted"].item() == 1.0
    assert monitor.count(memory, 1.01, True) == 1.0 and memory["counted"].item() == 1.01
    memory["counted"] = 0.0
    assert monitor.count(memory, 0.01, True) == 1.0 and memory["counted"].item() == 0.01


def test_a_surface_comes_back_below_half_of_its_time() -> None:
    monitor, memory = made(Surface, TABLE)
    for time, lifted, height in ((5.0, True, 0.0), (4.99, False, 0.0), (4.99, True, 0.04)):
        memory["withdrawn"], memory["contact_time"] = 1, time
        assert monitor.follow(memory, 0.04, lifted) == height
        assert memory["withdrawn"].item() == (0 if height else 1)
    assert monitor.follow(memory, 0.03, False) == 0.03


def test_a_surface_leaves_the_finger_slowly_for_half_a_second_and_then_at_once() -> None:
    monitor, memory = made(Surface, TABLE)
    memory["withdrawn"] = 1
    for time, leaves, height in ((10.2, 0.02, 0.02), (10.2, -0.01, 0.0), (10.5, 0.02, 0.02), (10.51, 0.02, 0.0)):
        memory["contact_time"] = time
        assert monitor.follow(memory, 0.04, False, leaves) == height


@pytest.mark.parametrize(
    ("way", "gap", "near", "touched", "slid", "found", "kind"),
    [((0.0, 0.0, 0.015), 0.05, 0.0, False, 0.0, 0.0, 0), ((0.0151, 0.0, 0.0), 0.05, 0.0, False, 0.0, -21.0, 0),
     ((0.0, 0.0, 0.0074), 0.019, 0.9, False, 0.0, 0.0, 0), ((0.0, 0.0, 0.0076), 0.019, 0.9, False, 0.0, -21.0, 1),
     ((0.0, 0.0, 0.0076), 0.020, 0.9, False, 0.0, 0.0, 0), ((0.0, 0.0, 0.0076), 0.019, 0.96, False, 0.0, 0.0, 0),
     ((0.0076, 0.0, 0.0), 0.019, 0.9, True, 0.0, -21.0, 2), ((0.0, 0.0076, 0.0), 0.019, 0.9, True, 0.0, -21.0, 2), ((0.0076, 0.0, 0.0), 0.019, 0.9, True, 0.001, 0.0, 0),
     ((0.0074, 0.0, 0.0), 0.019, 0.9, True, 0.0, 0.0, 0), ((0.0076, 0.0, 0.0), 0.019, 0.9, False, 0.0, 0.0, 0)],
)  # fmt: skip
def test_speeds_that_no_command_can_have_asked_for(
    way: tuple[float, ...], gap: float, near: float, touched: bool, slid: float, found: float, kind: int
) -> None:
    monitor, memory = made(Surface, TABLE)
    reading = record(TABLE[0])
    memory["near_since"], memory["figure"] = near, (0.0, 0.0)
    memory["places"], memory["track"][0] = 1, (0.95, *np.zeros(6))
    reading["pose"][:3] = way
    kept, finger = monitor.memory(memory), (slid, 0.0, 0.0)
    assert surface_kernels.moves(monitor.allowed, kept, reading["pose"], finger, looked(gap=gap), touched) == found
    assert memory["figure"][1] == kind
    assert (memory["near_since"].item() == near) is (gap < 0.02)


@pytest.mark.parametrize(("load", "gap", "calibrated", "doubts"), [
    (0.5, 0.5, True, False), (0.51, 0.004, True, False), (0.51, 0.0041, True, True), (0.51, 0.015, False, False),
    (0.51, 0.0151, False, True),
])  # fmt: skip
def test_when_a_force_without_a_finger_is_doubted(load: float, gap: float, calibrated: bool, doubts: bool) -> None:
    monitor, memory = made(Surface, TABLE)
    seen, kept = looked(gap=gap, calibrated=calibrated), monitor.memory(memory)
    memory["doubted"] = 0.05
    assert surface_kernels.doubt(monitor.allowed, kept, load, 0.05, seen) == 0.0
    assert memory["doubted"].item() == (pytest.approx(0.1) if doubts else 0.0)
    memory["doubted"] = 0.1
    assert surface_kernels.doubt(monitor.allowed, kept, load, 0.01, seen) == (
        -float(Trip.SENSOR_DISAGREE) if doubts else 0.0
    )


def test_an_arm_at_its_limits() -> None:
    monitor, memory = made(Arm, ARM)
    sent = record(ARM[1])
    for force, speed, found in ((3.0, 0.8, 1.0), (0.0, 1.0, 0.5), (0.0, 1.2, 0.0), (0.0, beyond(1.2), -float(Trip.SPEED)),
                                (3.001, 0.0, -float(Trip.FINGER_FORCE)), (0.0, math.nan, -float(Trip.SPEED))):  # fmt: skip
        for axis in range(3):
            sent["wrench"][:] = 0.0
            sent["wrench"][axis] = force
            assert monitor.check(memory, sent, sent, Moment(speed=speed)) == pytest.approx(found)


@pytest.mark.parametrize("torque", [0.06, None])
def test_a_torque_past_the_guard_stops_the_arm(torque: float | None) -> None:
    arm = Asked(Arm, ARM, dataclasses.replace(LIMITS, torque=torque))
    arm.sent["wrench"][3:] = (0.0, 0.06, 0.0)
    assert arm.check() == 1.0
    arm.sent["wrench"][3:] = (0.05, 0.04, 0.0)
    if torque is None:
        assert arm.check() == 1.0  # locked: the guard has none to let through
        return
    with pytest.raises(TripError, match=r"was sent 0\.064 N m") as caught:
        arm.check()
    assert caught.value.trip is Trip.FINGER_TORQUE
    assert arm.monitor.rule(int(Trip.FINGER_TORQUE), arm.reading) == "K1"


def test_a_pressure_at_its_limits() -> None:
    monitor, memory = made(Push, PAD)
    reading = record(PAD[0])
    for force, found in ((2.0, 1.0), (3.5, 0.5), (5.0, 0.0), (beyond(5.0), -float(Trip.PLATE_FORCE))):
        reading["wrench"][2] = -force
        assert monitor.check(memory, reading, reading, Moment()) == pytest.approx(found)
    assert memory["figure"].item() == beyond(5.0)


class Times(Monitor):
    """Notes how long ago it looked last."""

    name: ClassVar[str] = "times"
    trips: ClassVar[dict[int, str]] = {}
    seen: ClassVar[list[tuple[float, float]]] = []

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        return (cls(device),)

    def fields(self) -> tuple[Field, ...]:
        return ()

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.seen.append((moment.now, moment.seconds))
        return 1.0

    def rules(self) -> tuple[Rule, ...]:
        return ()


def test_a_monitor_is_told_how_long_ago_it_looked_last() -> None:
    one = model(PLATE, twin=True, offered=(Times,))
    device = Supervised(one, state(one), 0.001, twin=FakeTwin())
    device.lifecycle.reset()
    device.lifecycle.open()
    for name, view in device.reading.items():
        view[...] = 0.0 if name == "heat_flux" else 300.0
    Times.seen.clear()
    for tick in range(25):
        device.gate.read(tick)
    assert Times.seen == [(0.0, 0.0), (0.01, 0.01), (0.02, 0.01)]
    device.gate.device_monitors.leave_out(7)
    for tick in range(25, 30):
        device.gate.read(tick)
    assert Times.seen[3:] == [(0.032, 0.012)]


class Moments(Times):
    """Notes what it is told of the moment."""

    name: ClassVar[str] = "moments"
    told: ClassVar[list[tuple[float, bool, float]]] = []
    needs_finger_position: ClassVar[bool] = False

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.told.append((moment.now, moment.fresh, moment.age))
        return 1.0


class Placed(Moments):
    """Looks where the finger is."""

    name: ClassVar[str] = "placed"
    needs_finger_position: ClassVar[bool] = True


def listened(kind: type[Monitor]) -> tuple[Supervised, FakeTwin]:
    """Return an open display whose monitors are asked what they are told, with readings that can be believed."""
    twin, one = FakeTwin(), model(PLATE, twin=True, offered=(kind,))
    device = Supervised(one, state(one), 0.001, twin=twin)
    device.lifecycle.reset()
    device.lifecycle.open()
    for name, view in device.reading.items():
        view[...] = 0.0 if name == "heat_flux" else 300.0
    Moments.told.clear()
    return device, twin


def test_a_monitor_is_told_how_old_the_reading_is() -> None:
    device, twin = listened(Moments)
    device.gate.read(0)
    twin.says = lambda reading: False
    for tick in range(1, 11):
        device.gate.read(tick)
    assert Moments.told == [(0.0, True, 0.0), (0.01, False, pytest.approx(0.01))]


class Gaps(Moments):
    """Notes how long ago it looked last."""

    name: ClassVar[str] = "gaps"
    needs_finger_position: ClassVar[bool] = True
    times: ClassVar[list[float]] = []

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.times.append(moment.seconds)
        return 1.0


def test_what_is_enabled_anew_was_not_looked_at_before() -> None:
    device, _ = listened(Gaps)
    Gaps.times.clear()
    device.gate.read(0)
    device.gate.device_monitors.look_placed(100)
    device.gate.device_monitors.look_placed(103)
    device.gate.device_monitors.begin()
    device.gate.device_monitors.look_placed(500)
    assert Gaps.times[-3:] == [0.0, pytest.approx(0.003), 0.0]


class Measured(Moments):
    """Notes when what it is shown was measured."""

    name: ClassVar[str] = "measured"
    needs_finger_position: ClassVar[bool] = True
    times: ClassVar[list[float]] = []

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.times.append(moment.time)
        return 1.0


def test_a_monitor_is_told_when_a_reading_was_measured_that_came_late() -> None:
    device, _ = listened(Measured)
    Measured.times.clear()
    device.gate.read(0)
    device.gate.device_monitors.begin()
    for measured in (5, 3):
        device.gate.acquisition._measured[...] = measured
        device.gate.device_monitors.look_placed(5)
    device.gate.device_monitors.leave_out(7)
    device.gate.acquisition._measured[...] = 5
    device.gate.device_monitors.look_placed(5)
    assert Measured.times == [pytest.approx(0.005), pytest.approx(0.003), pytest.approx(0.012)]
    assert device.gate.device_monitors.moment.now == pytest.approx(0.012)


def test_silence_is_looked_at_in_the_time_that_has_truly_passed() -> None:
    device, _ = listened(Moments)
    device.gate.read(0)
    device.gate.device_monitors.leave_out(7)
    device.gate.device_monitors.wait(3, 0.01)
    assert device.gate.device_monitors.moment.now == pytest.approx(0.010)


def test_what_acts_elsewhere_on_the_finger_counts_from_its_first_word() -> None:
    device, _ = listened(Moments)
    device.gate.device_monitors.limit_share("tip", 0.0)
    assert device.gate.device_monitors.share == 0.0
    device.gate.device_monitors.limit_share("thumb", 0.5)
    assert device.gate.device_monitors.share == 0.0
    device.gate.device_monitors.limit_share("tip", 1.0)
    assert device.gate.device_monitors.share == 0.5


def test_nothing_is_fresh_before_the_first_reading_and_after_all_was_forgotten() -> None:
    device, _ = listened(Placed)
    device.gate.device_monitors.begin()
    device.gate.device_monitors.look_placed(1)
    assert [fresh for _, fresh, _ in Moments.told] == [False]
    device.gate.read(2)
    device.gate.device_monitors.look_placed(2)
    device.gate.device_monitors.look_placed(3)
    assert [fresh for _, fresh, _ in Moments.told] == [False, True, False]


def test_the_first_reading_is_looked_at_when_it_comes() -> None:
    device, _ = listened(Moments)
    device.gate.device_monitors.due[0] = -1
    device.gate.read(3)
    assert device.gate.device_monitors.due[0] == 3  # whatever the clock says


def test_a_reading_is_believed_once() -> None:
    device, _ = listened(Moments)
    device.gate.read(0)
    assert device.gate.acquisition._sequence.item() == 1
    device.gate.acquisition.watch(0)
    assert device.gate.acquisition._sequence.item() == 1


@pytest.mark.parametrize(("high", "said"), [(1e300, False), (9e299, True)])
def test_a_range_of_all_numbers_is_none(high: float, said: bool) -> None:
    monitor, _ = made(Readings, ((Channel("hum", 1, "1", (-math.inf,), (high,)),), ()))
    assert ("outside its range" in monitor.rules()[0].trip) is said


def test_silence_trips_just_beyond_its_limit() -> None:
    monitor, memory = made(Ordinary, ARM)
    reading = record(ARM[0])
    assert monitor.check(memory, reading, reading, Moment(age=0.02 + 1e-9)) == 1.0
    assert monitor.check(memory, reading, reading, Moment(age=0.02 + 2e-9)) == -Trip.SILENT


@pytest.mark.parametrize(("limits", "heat", "press", "contact"), [
    (DeviceLimits(), (285.15, 315.15), 5.0, 60.0),
    (DeviceLimits(temperature=(290.15, 311.15), plate_force=1.0, contact_time=5.0), (287.15, 313.15), 2.5, 30.0),
    (DeviceLimits(temperature=(280.15, 330.15), contact_time=60.0), (285.15, 315.15), 5.0, 60.0),
])  # fmt: skip
def test_trips_follow_their_limits(limits: DeviceLimits, heat: Any, press: float, contact: float) -> None:
    assert limits.temperature_trip == pytest.approx(heat)
    assert (limits.plate_force_trip, limits.contact_time_trip) == (press, contact)
    assert default.COLD_TIME == default.DOSE == 120.0


# --- what a surface may press with next ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gap", "velocity", "rising", "pressed", "found"),
    [(1e-3, 0.0, 0.0, 0.0, 0.0), (4e-4, 0.0, 0.0, 0.0, 0.06), (4e-4, -0.1, 0.0, 0.0, 0.06 + 0.2 + 0.2),
     (4e-4, 0.0, 0.1, 0.0, 0.46), (4e-4, 0.1, 0.1, 0.0, 0.06), (6e-4, -0.1, 0.0, 0.0, 0.46),
     (8e-4, -0.1, 0.0, 0.0, 0.95 * 0.46), (17e-4, -0.1, 0.0, 0.0, 0.5 * 0.46), (28e-4, -0.1, 0.0, 0.0, 0.0),
     (7e-4, 0.0, 0.0, 0.0, 0.03),
     (0.0, -0.1, 0.0, 0.04, 0.26), (1e-2, 0.0, 0.0, 0.04, 0.06), (0.0, -0.1, 0.0, 0.03, 0.46), (0.0, 0.5, 0.0, 0.5, 0.06)],
)  # fmt: skip
def test_what_a_surface_may_rise_by(gap: float, velocity: float, rising: float, pressed: float, found: float) -> None:
    nearing = FingerAbove(
        np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, velocity]), np.array([0.1 - 0.008 - gap]), np.array([rising]),
        np.array([0.008, 1000.0, 2.0, 0.001]),
    )  # fmt: skip
    assert rise(nearing, pressed) == pytest.approx(found)


@pytest.mark.parametrize(
    ("pressed", "said", "found"),
    [(0.5, -1.0, 0.06 + 0.2), (0.5, 0.4, 0.12 + 0.2), (0.5, 0.8, 0.3 + 0.12 + 0.2), (0.0, 0.2, 0.2 + 0.12 + 0.2),
     (0.0, 0.0, 0.06 + 0.2 + 0.2), (0.5, math.nan, 0.06 + 0.2)],
)  # fmt: skip
def test_what_a_surface_may_rise_by_where_readings_are_late(pressed: float, said: float, found: float) -> None:
    """What is said of it since then may only tighten: it adds to what is read, and never takes from that."""
    nearing = FingerAbove(
        np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, -0.1]), np.array([0.1 - 0.008 - 4e-4]), np.zeros(1),
        np.array([0.008, 1000.0, 2.0, 0.001]), np.array([said]),
    )  # fmt: skip
    assert rise(nearing, pressed) == pytest.approx(found)


@pytest.mark.parametrize("gap", [-1e-4, 3e-4])
@pytest.mark.parametrize("stepped", [-0.008, 0.0, 0.004, 0.008])
def test_a_step_in_which_an_arm_reads_is_no_faster_finger(gap: float, stepped: float) -> None:
    """Each made an arm at its limit give up to 0.1 N less, or more, in that tick."""

    def may(velocity: float, sink: float) -> float:
        nearing = FingerAbove(
            np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, velocity]), np.array([0.1 - 0.008 - gap]), np.zeros(1),
            np.array([0.008, 1800.0, 3.5, 0.001]), sink=np.array([sink]),
        )  # fmt: skip
        return rise(nearing, 0.0)

    assert may(-0.03 - stepped, -0.03) == pytest.approx(may(-0.03, -0.03))
    assert may(-0.08, -0.03) == may(-0.08, math.nan) > may(-0.03, -0.03)  # a finger that dives is as fast as it is
    assert may(-0.03, -0.03) >= may(-0.03, math.nan)  # never looser


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_force_that_is_not_a_number_hides_no_torque(axis: int) -> None:
    reading = np.array([0.0, 0.0, 0.0, 0.07, 0.0, 0.0])
    reading[axis] = math.nan
    assert felt(Load(reading, np.array([0]), np.array([[3, 4, 5]]), np.array([0.1]))) == pytest.approx(0.7)


def _loud(*reading: float) -> Load:
    """Return the reading of one sensor: forces [N], and torques [N m], of which the first two count."""
    return Load(np.array([*reading]), np.array([0]), np.array([[3, 4, -1]]), np.array([0.1]))


@pytest.mark.parametrize(
    ("reading", "estimated", "found"),
    [((0.3, 0.0, -0.4, 0, 0, 0), (0.0, 0.0, 0.0), 0.5), ((0.0, 0.0, 0.05, 0, 0, 0), (0.02, 0.0, 0.02), 0.0),
     ((0.3, 0.0, -0.1, 0, 0, 0), (0.02, 0.4, 0.02), 0.5), ((0.0, 0.0, -0.1, 0.07, 0, 0.2), (0.02, 0.0, 0.02), 0.7)],
)  # fmt: skip
def test_an_arm_makes_room_for_a_force_without_its_noise(
    reading: tuple[float, ...], estimated: tuple[float, ...], found: float
) -> None:
    nearing = FingerAbove(
        np.array([0.0, 0.0, 0.1]), np.zeros(3), np.array([0.05]), np.zeros(1), np.array([0.008, 1000.0, 2.0, 0.001]),
        estimated=np.array(estimated),
    )  # fmt: skip
    assert pressed_by(_loud(*reading), nearing) == pytest.approx(found)


@pytest.mark.parametrize(
    ("gap", "pressed", "found"),
    [(4e-2, 0.06, 0.0), (4e-2, 0.08, 0.06 + 0.04), (0.0, 0.5, 0.06 + 0.04), (0.0, 0.0, 0.06 + 0.04)],
)
def test_it_makes_room_for_what_the_estimate_may_be_wrong_by(gap: float, pressed: float, found: float) -> None:
    nearing = FingerAbove(
        np.array([0.0, 0.0, 0.1]), np.zeros(3), np.array([0.1 - 0.008 - gap]), np.zeros(1),
        np.array([0.008, 1000.0, 2.0, 0.001]), estimated=np.array([0.04, pressed, 0.04]),
    )  # fmt: skip
    assert rise(nearing, pressed) == pytest.approx(found)


# --- words ----------------------------------------------------------------------------------------------------------

WORDS = (
    (Heat, PLATE, Trip.PLATE_TEMPERATURE, "figure", (320.25, 321.35, 0.0),
     "reads plate_temperature 47.1 degC, on its way to 48.2 degC, past its trip", "T1"),
    (Heat, PLATE, Trip.PLATE_RATE, "figure", (21.26, 0.0, 0.0), "changes its plate by 21.3 K/s under the finger", "T5"),
    (Heat, PLATE, Trip.FLUX, "figure", (160e3, 0.0, 0.0), "had a mean flux of 160.0 kW/m^2 for a second", "T6"),
    (Heat, PLATE, Trip.DOSE, "dose", 606.0, "has given a thermal dose of 10.10 CEM43, the most for a session", "T3"),
    (Heat, PLATE, Trip.COLD, "cold_time", 120.34, "was touched while cold for 120.3 s, the most for a session", "T4c"),
    (Heat, PLATE, Trip.SENSOR_JUMP, "figure", (-6.06, 0.0, 0.0), "reads a step of the plate of -6.1 K, not believable",
     "T8"),
    (Heat, PLATE, Trip.SENSOR_FROZEN, "figure2", (1.234, 0.0), "reads the same plate_temperature for 1.23 s while driven",
     "T8"),
    (Heat, PLATE, Trip.SENSOR_DISAGREE, "figure2", (12.34, 10.56),
     "reads plate_temperature 12.3 K on the wrong side of its heat sink for 10.6 s: a sensor must be wrong", "T8"),
    (Heat, PLATE, Trip.RUNAWAY, "figure2", (2.34, 0.0), "went 2.3 K against its drive: drive or sensor must be wrong",
     "T9"),
    (Heat, PLATE, Trip.RUNAWAY, "figure2", (0.0, 2.06),
     "did not follow its drive for 2.1 s: drive or sensor must be wrong", "T9"),
    (Surface, TABLE, Trip.PLATE_FORCE, "figure", (5.26, 0.0), "presses with 5.3 N", "K4"),
    (Surface, TABLE, Trip.TRACKING, "figure", (1.2345, 0.0), "is 1234.5 mm from its command", "K6"),
    (Surface, TABLE, Trip.CONTACT_TIME, "figure", (60.04, 0.0), "has been touched for 60.0 s", "T4"),
    (Surface, TABLE, Trip.SURFACE_SPEED, "figure", (0.316, 0.0), "moves at 0.32 m/s", "K5"),
    (Surface, TABLE, Trip.SURFACE_SPEED, "figure", (0.164, 1.0), "closes in on the finger at 0.16 m/s", "K5"),
    (Surface, TABLE, Trip.SURFACE_SPEED, "figure", (0.164, 2.0), "slides past the finger at 0.16 m/s", "K5"),
    (Surface, TABLE, Trip.SENSOR_DISAGREE, "figure", (0.66, 1.2345),
     "feels 0.7 N with the finger 1234 mm away: one of the sensors must be wrong", "T8"),
    (Arm, ARM, Trip.FINGER_FORCE, "figure", 3.16, "was sent 3.2 N", "K1"),
    (Arm, ARM, Trip.SPEED, "figure", 1.256, "moves at 1.26 m/s", "K2"),
    (Push, PAD, Trip.PLATE_FORCE, "figure", 5.16, "presses with 5.2 N", "K4"),
    (Ordinary, ARM, Trip.SILENT, "figure", 0.0216, "was silent for 0.022 s", "W1"),
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "channels", "trip", "field", "figure", "words", "rule"), WORDS, ids=[case[5][:24] for case in WORDS]
)
def test_the_sentence_and_the_rule_of_every_trip(
    kind: type[Monitor], channels: Any, trip: Trip, field: str, figure: Any, words: str, rule: str
) -> None:
    monitor, memory = made(kind, channels)
    memory[field] = figure
    reading = record(channels[0])
    if "plate_temperature" in reading:
        reading["plate_temperature"] = 320.0
    assert monitor.sentence(int(trip), memory, reading, Moment()) == words
    assert monitor.rule(int(trip), reading) == rule
    assert monitor.trips[int(trip)] == trip.label


def test_a_cold_plate_trips_by_the_rule_for_cold() -> None:
    monitor, _ = made(Heat, PLATE)
    reading = record(PLATE[0])
    for kelvin, rule in ((300.65, "T2"), (beyond(300.65), "T1"), (280.0, "T2")):
        reading["plate_temperature"] = kelvin
        assert monitor.rule(int(Trip.PLATE_TEMPERATURE), reading) == rule
    for kelvin, outside in ((281.15, False), (281.1, True), (318.15, False), (318.2, True)):
        reading["plate_temperature"] = kelvin
        assert monitor.beyond(reading) is outside


# --- what is stored and promised -------------------------------------------------------------------------------------


def test_the_numbers_of_trips_stay_for_sessions_that_have_stored_them() -> None:
    assert " ".join(f"{trip.value} {trip.label}" for trip in Trip) == (
        "0 none 1 not-a-number 2 sensor-range 3 plate-temperature 4 sink-temperature 5 plate-force 6 tracking 7 speed "
        "8 silent 9 device-error 10 calibration 11 overrun 12 dose 13 contact-time 14 plate-rate 15 flux 16 sensor-jump "
        "17 sensor-frozen 18 sensor-disagree 19 runaway 20 released 21 surface-speed 22 modality-error 23 monitor "
        "24 monitor-error 25 cold 26 finger-force 27 finger-torque"
    )


#: What the tables of docs/reference/safety-limits.md and docs/explanation/finger-safety.md say, in SI.
PROMISED: dict[Any, dict[str, Any]] = {
    default: {
        "PLATE_TEMPERATURE": (288.15, 313.15), "PLATE_TRIP": (285.15, 315.15), "PLATE_ABSOLUTE": (281.15, 318.15),
        "DOSE_WARNING": 60.0, "DOSE": 120.0, "CONTACT_TIME": 10.0, "CONTACT_TIME_LONGEST": 60.0,
        "CONTACT_TIME_TRIP": 60.0, "COLD_FROM": 289.15, "COLD_TIME": 120.0, "COLD_ABSOLUTE": 288.15, "PLATE_RATE": 10.0, "FLUX": 15e3,
        "SINK": 323.15, "SINK_TRIP": 328.15, "SINK_ABSOLUTE": 333.15, "FORCE": 3.0, "ARM_SPEED": 0.8,
        "ARM_SPEED_TRIP": 1.2, "FORCE_SLEW": 1000.0, "RAMP": 1.0, "PLATE_FORCE": 2.0, "PLATE_FORCE_TRIP": 5.0,
        "PLATE_FORCE_ABSOLUTE": 10.0, "NEAR": 0.020, "SPEED_NEAR": 0.10, "SPEED": 0.25, "SPEED_NEAR_TRIP": 0.15,
        "SPEED_TRIP": 0.30, "TRACKING": 0.003, "TRACKING_TRIP": 0.005, "TRACKING_TIME": 0.1, "WATCHDOG_OTHER": 0.5,
        "REARMS": 5, "HOLD": 0.080,
    },
    thresholds: {"AHEAD": 0.1, "RATE_TIME": 0.05, "CONTACT_RATE_TIME": 0.5, "FLUX_TIME": 1.0, "DOSE_FROM": 312.15,
           "DOSE_UNIT": 316.15, "STEP": 5.0, "TOUCH_FORCE": 0.03, "TOUCH_GAP": 2e-4, "DOUBT_FORCE": 0.5, "DOUBT_GAP": 0.004,
              "DOUBT_GAP_UNCALIBRATED": 0.015, "DOUBT_TIME": 0.1, "SLOW": 0.01, "SPEED_TIME": 0.05,
              "PLACES": 16, "READINGS": 256, "FROZEN": 1.0, "DRIVEN": 0.02, "FROZEN_DRIVE": 0.15, "FROZEN_HELD": 0.5,
              "RUNAWAY_DRIVE": 0.5,
              "RUNAWAY_TIME": 2.0, "RUNAWAY_STILL": 0.1, "RUNAWAY_WRONG": 2.0, "LAG": 0.15, "DRIFT_DRIVE": 0.1,
              "DRIFT_TIME": 10.0, "DRIFT": 10.0, "FULL_STRENGTH": 10.0, "COLDEST_TARGET": 200.0},
    carried_surface: {"LEVER": 0.1},
    readings: {"TEMPERATURE_JUMP": 20.0, "TEMPERATURE_RANGE": (263.15, 353.15), "FINGER_SPEED": 5.0, "STEPS": 0.002,
               "WORKSPACE": 2.0, "SURFACE_MARGIN": 3.0, "DISAGREEMENT": 3.0, "SATURATED": 1.01},
}  # fmt: skip


@pytest.mark.parametrize("module", PROMISED, ids=[module.__name__.rpartition(".")[2] for module in PROMISED])
def test_the_figures_are_those_that_are_promised(module: Any) -> None:
    assert {name: getattr(module, name) for name in PROMISED[module]} == PROMISED[module]


def test_watchdogs_are_those_that_are_promised() -> None:
    assert default.WATCHDOG == {Role.FORCE_ON_OPERATOR: 0.020, Role.SURFACE_POSE: 0.100}


#: Of each monitor what it keeps in State, with its shape, and its least and greatest value where it has one.
KEPT = {
    (Readings, "plate"): "believed(3) known[0..1] figure(2)",
    (Arm, "arm"): "figure",
    (Push, "pad"): "figure",
    (Ordinary, "arm"): "figure",
    (Surface, "table"): "contact_time[0..inf] withdrawn counted strayed_for[0..inf] doubted[0..inf] near_since looked "
    "places[0..inf] track(16, 7) figure(2)",
    (Heat, "plate"): "samples[0..inf] history(256, 4) flux tails(4)[0..inf] dose[0..inf] cold_time[0..inf] since frozen "
    "frozen_at frozen_for[0..inf] frozen_drive[0..inf] frozen_held[0..inf] frozen_slope frozen_from driven_for "
    "parts(24, 3) touched_at odd_for[0..inf] figure2(2) figure(3)",
}  # fmt: skip


@pytest.mark.parametrize(("kind", "what"), KEPT, ids=[kind.__name__ for kind, _ in KEPT])
def test_the_fields_that_each_monitor_keeps(kind: type[Monitor], what: str) -> None:
    monitor, _ = made(kind, {"plate": PLATE, "arm": ARM, "table": TABLE, "pad": PAD}[what])
    told = []
    for field in monitor.fields():
        shape = field.size if isinstance(field.size, tuple) else f"({field.size})" if field.size else ""
        span = f"[{field.low:g}..{field.high:g}]" if math.isfinite(field.low) or math.isfinite(field.high) else ""
        told.append(f"{field.name}{shape}{span}")
    assert " ".join(told) == KEPT[kind, what]


@pytest.mark.parametrize(("value", "found"), [
    (1.0, 1.0), (-1.0, 1.0), (beyond(1.0), -float(Trip.SENSOR_RANGE)), (-beyond(1.0), -float(Trip.SENSOR_RANGE))
])  # fmt: skip
def test_what_is_at_the_end_of_its_range_is_in_it(value: float, found: float) -> None:
    reads = (Channel("load", 1, "N", (-1.0,), (1.0,)),)
    monitor, memory = made(Readings, (reads, ()))
    reading = record(reads)
    reading["load"] = value
    assert monitor.check(memory, reading, reading, Moment(seconds=0.01)) == found


@pytest.mark.parametrize(("role", "unit", "most"), [
    (Role.DRIVE, "A", 2.0), (Role.DRIVE, "V", 12.0), (Role.ELECTRODE, "A", 12.0)
])  # fmt: skip
def test_the_limit_of_current_is_of_drives_in_ampere(role: Role, unit: str, most: float) -> None:
    channel = Channel("x", 1, unit, (-12.0,), (12.0,), safe=(0.0,), role=role)
    assert guard._ceilings(channel, LIMITS).tolist() == [[most], [most]]


def test_a_surface_leaves_all_between_two_looks() -> None:
    monitor, memory = made(Surface, TABLE)
    reading, sent = record(TABLE[0]), record(TABLE[1])
    looks = [monitor.check(memory, reading, sent, Moment(now=now, time=now, gap=0.05)) for now in (1.0, 1.001, 1.009)]
    assert looks == [1.0, 1.0, 1.0]
    assert memory["looked"].item() == 1.0


def test_a_drive_that_changes_forgets_how_fast_the_plate_went() -> None:
    watch = Runaway(follows=True, part=1.0)
    memory = Record.of(watch.fields())
    watch.clear(memory)
    for step, drive in enumerate((0.8, 0.8, 0.8, 0.8, 0.2)):
        look = Look(0.1 * step, 0.1 * step, 0.1, True)
        runaway_kernels.check(watch.checks, watch.memory(memory), 300.0 + 0.1 * step, 300.0, drive, look, True)
        assert (memory["frozen_slope"].item() > 0.0) is (1 < step < 4 or step == 1)


def test_of_a_slow_loop_every_reading_is_looked_at_at_once() -> None:
    one = model(PLATE)
    slow = Supervised(one, state(one), 0.005, device=None)
    assert (slow.gate.device_monitors.apart, slow.gate.device_monitors.clock) == (1, 2)


@pytest.mark.parametrize(("ramp", "share"), [(0.5, 0.0), (1e-3, 0.0), (0.0, 1.0)])
def test_a_device_begins_with_nothing_where_it_ramps_in(ramp: float, share: float) -> None:
    one = model(ARM, limits=dataclasses.replace(LIMITS, ramp=ramp), twin=True)
    arm = Supervised(one, state(one), PERIOD, twin=FakeTwin())
    arm.lifecycle.reset()
    arm.lifecycle.open()
    arm.gate.read(0)
    arm.lifecycle.enable()
    assert arm.gate.actuation._ramp.item() == share


def test_of_two_sensors_that_disagree_the_first_is_named() -> None:
    """Not the first number of the device, nor the one that was doubted before."""
    reads = (Channel("load", 1, "N"), Channel("a", 2, "K", role=SKIN))
    monitor, memory = made(Readings, (reads, ()))
    reading = record(reads)
    memory["figure"] = 7.0, 7.0
    reading["a"] = 300.0, 304.0
    assert monitor.check(memory, reading, reading, Moment(seconds=10.0)) == -Trip.SENSOR_DISAGREE
    assert memory["figure"].tolist() == [1.0, pytest.approx(4.0)]


def test_the_flux_at_which_it_trips_is_printed_as_a_third_more_than_the_limit() -> None:
    for limit, trip in ((15e3, "20 kW/m²"), (749.25, "0.999 kW/m²")):
        device = watched("it", "fake", None, PLATE, dataclasses.replace(LIMITS, flux=limit), twin=False)
        (monitor,) = Heat.of(device)
        assert [rule.trip for rule in monitor.rules() if rule.number == "T6"] == [trip]


@pytest.mark.parametrize("beyond", [-5.0, -0.5, -1e-9, 0.0])
def test_within_a_limit_all_of_the_drive_is_left(beyond: float) -> None:
    assert heat_kernels.left(beyond, 2.0) == 1.0
