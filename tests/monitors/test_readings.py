"""The watch: which readings are believed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from small_devices import ARM, PLATE, TABLE, Asked

from itouch.monitors import Readings, Trip, TripError
from itouch.plugin import (
    Channel,
    Role,
    heat_flux,
    measured_wrench,
    plate_temperature,
    pose,
    pose_target,
    sink_temperature,
    skin_temperature,
    temperature,
)
from itouch.world.limits import DeviceLimits

ROLES = {
    "plate_temperature": Role.SKIN_CONTACT_TEMPERATURE,
    "sink_temperature": Role.HEAT_SINK_TEMPERATURE,
    "skin_temperature": Role.SKIN_TEMPERATURE,
}
K0 = 273.15
TIGHT = DeviceLimits(temperature=(291.15, 308.15))


def watched(reads: Sequence[Channel], commands: Sequence[Channel] = (), limits: DeviceLimits | None = None) -> Asked:
    asked = Asked(Readings, (tuple(reads), tuple(commands)), limits or DeviceLimits())
    for channel in reads:
        asked.reading[channel.name] = 300.0 if channel.unit == "K" else 0.0
    return asked


def readings_of(watch: Asked) -> Readings:
    assert isinstance(watch.monitor, Readings)
    return watch.monitor


def trip_of(watch: Asked, seconds: float = 1e-3) -> tuple[Trip, str] | None:
    try:
        watch.check(seconds)
    except TripError as error:
        return error.trip, str(error)
    return None


@pytest.mark.parametrize(
    ("channel", "value", "trip", "words"),
    [
        (pose(), math.nan, Trip.NOT_A_NUMBER, "reads NaN (pose)"),
        (pose(), math.inf, Trip.NOT_A_NUMBER, "reads an infinite number (pose)"),
        (pose(), 1.01, Trip.SENSOR_RANGE, "reads pose 1.01 m, which is not believable"),
        (pose(), -1.01, Trip.SENSOR_RANGE, "reads pose -1.01 m, which is not believable"),
        (
            plate_temperature(),
            K0 + 42.1,
            Trip.PLATE_TEMPERATURE,
            "reads plate_temperature 42.1 degC, past",
        ),
        (plate_temperature(), K0 + 11.9, Trip.PLATE_TEMPERATURE, "11.9 degC, past its trip"),
        (sink_temperature(), K0 + 55.1, Trip.SINK_TEMPERATURE, "reads sink_temperature 55.1 degC, past"),
        (sink_temperature(), K0 - 10.1, Trip.SINK_TEMPERATURE, "-10.1 degC"),
        (skin_temperature(), K0 + 80.1, Trip.SENSOR_RANGE, "80.1 degC, which is not believable"),
        (skin_temperature(), K0 - 10.1, Trip.SENSOR_RANGE, "-10.1 degC"),
        (skin_temperature(low=200.0, high=900.0), 400.0, Trip.SENSOR_RANGE, "126.9 degC"),
        (skin_temperature(low=290.0, high=300.0), 289.0, Trip.SENSOR_RANGE, "15.9 degC"),
        (heat_flux(full_scale=1e4), 1.02e4, Trip.SENSOR_RANGE, "1.02e+04 W/m^2"),
        (heat_flux(full_scale=1e4), -1.02e4, Trip.SENSOR_RANGE, "-1.02e+04 W/m^2"),
        (measured_wrench(force=50.0), 50.1, Trip.SENSOR_RANGE, "reads wrench 50.1 N"),
        (Channel("skin_valid", 1, "", (0.0,), (1.0,)), 1.5, Trip.SENSOR_RANGE, "reads skin_valid 1.5, which"),
        (Channel("share", 1, "1", (0.0,), (1.0,)), 11.0, Trip.SENSOR_RANGE, "reads share 11, which"),
    ],
)
def test_readings_that_are_not_believable_trip(channel: Channel, value: float, trip: Trip, words: str) -> None:
    watch = watched([channel])
    assert trip_of(watch) is None
    watch.reading[channel.name][-1] = value
    found = trip_of(watch)
    assert found is not None
    assert found[0] is trip
    assert words in found[1]


@pytest.mark.parametrize(
    ("channel", "value"),
    [
        (plate_temperature(), K0 + 41.9), (plate_temperature(), K0 + 12.1),
        (sink_temperature(), K0 + 54.9), (skin_temperature(), K0 + 79.9),
        (heat_flux(full_scale=1e4), 1.005e4), (heat_flux(full_scale=1e4), -1.005e4), (pose(), -1.0005),
        (measured_wrench(force=50.0), -49.9), (Channel("grip", 1, "N"), 1e9),
    ],
)  # fmt: skip
def test_readings_at_the_edge_are_believed(channel: Channel, value: float) -> None:
    watch = watched([channel])
    watch.reading[channel.name][-1] = value
    assert trip_of(watch) is None


def test_the_scene_tightens_the_trip() -> None:
    for value, trips in ((K0 + 36.9, False), (K0 + 37.1, True), (K0 + 15.1, False), (K0 + 14.9, True)):
        watch = watched([plate_temperature()], limits=TIGHT)
        watch.reading["plate_temperature"][0] = value
        assert (trip_of(watch) is not None) is trips


def test_a_place_is_within_two_metres() -> None:
    for axis in range(3):
        for value, trips in ((1.99, False), (-2.01, True), (2.01, True)):
            watch = watched(ARM[0])
            watch.reading["pose"][axis] = value
            assert (trip_of(watch) is not None) is trips


def test_a_finger_goes_at_most_five_metres_a_second() -> None:
    watch = watched(ARM[0], ARM[1])
    assert trip_of(watch) is None
    for axis in range(3):
        watch.reading["pose"][axis] += 0.0069
        assert trip_of(watch) is None
        watch.reading["pose"][axis] -= 0.0071
        found = trip_of(watch)
        assert found is not None
        assert found[0] is Trip.SENSOR_JUMP
        assert found[1].endswith("after 0.0069 m, which is not believable")
        watch.reading["pose"][axis] += 0.0002
        assert trip_of(watch) is None


def test_more_time_lets_it_go_further() -> None:
    watch = watched(ARM[0], ARM[1])
    assert trip_of(watch) is None
    watch.reading["pose"][0] = 0.0119
    assert trip_of(watch, 2e-3) is None
    watch.reading["pose"][0] = 0.0
    assert trip_of(watch, 1e-3) is not None


def test_a_surface_goes_at_most_three_times_as_fast_as_it_can() -> None:
    for commands, room in ((TABLE[1], 0.0029), ((Channel("pose_target", 7, "m", role=Role.SURFACE_POSE),), 0.0029)):
        watch = watched(TABLE[0], commands)
        assert trip_of(watch) is None
        watch.reading["pose"][2] = room - 1e-5
        assert trip_of(watch) is None
        watch.reading["pose"][2] = -2e-5
        assert trip_of(watch) is not None
    fast = watched(TABLE[0], (pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=1.0),))
    assert trip_of(fast) is None
    fast.reading["pose"][2] = 0.0049
    assert trip_of(fast) is None


def test_temperatures_do_not_jump_but_skin_may() -> None:
    for name, trips in (("plate_temperature", True), ("sink_temperature", True), ("skin_temperature", False)):
        watch = watched([temperature(name, ROLES[name])])
        watch.reading[name][0] = K0 + 15.0
        assert trip_of(watch) is None
        watch.reading[name][0] = K0 + 34.9
        assert trip_of(watch, 1e9) is None
        watch.reading[name][0] = K0 + 14.8
        found = trip_of(watch, 1e9)
        assert (found is not None) is trips
        assert found is None or found[1] == f"reads {name} 14.8 degC after 34.9 degC, which is not believable"


def test_orientation_and_force_may_jump() -> None:
    watch = watched(TABLE[0], TABLE[1])
    assert trip_of(watch) is None
    watch.reading["pose"][3:] = (-0.5, 0.5, 0.5, -0.5)
    watch.reading["wrench"][:] = 40.0
    assert trip_of(watch) is None


@pytest.mark.parametrize(
    ("turn", "believed"),
    [
        ((1.0, 0.0, 0.0, 0.0), True),
        ((-0.5, 0.5, -0.5, 0.5), True),
        ((0.0, 0.0, 0.0, 0.0), True),  # none is told
        ((0.707, 0.707, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0, 1.0009), True),
        ((0.5, 0.0, 0.0, 0.0), False),
        ((0.0, 0.98, 0.0, 0.0), False),
        ((0.9, 0.9, 0.9, 0.9), False),
        ((0.0, 0.0, 1e-9, 0.0), False),
    ],
)
def test_a_quaternion_is_a_rotation(turn: tuple[float, ...], believed: bool) -> None:
    """Another length would stretch the place of what is mounted on the device."""
    watch = watched((measured_wrench(), pose()))
    watch.reading["pose"][3:] = turn
    found, length = trip_of(watch), math.dist(turn, (0.0,) * 4)
    assert readings_of(watch).usable(watch.reading) == believed
    if believed:
        assert found is None
    else:
        assert found is not None
        assert found[0] is Trip.SENSOR_RANGE
        assert f"reads a quaternion of length {length:.3g} (pose), which is not a rotation" in found[1]


def test_a_place_without_a_rotation_is_put_back_and_a_force_is_not() -> None:
    watch = watched((pose(), measured_wrench()))
    watch.reading["pose"][:] = (0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0)
    assert trip_of(watch) is None
    watch.reading["pose"][:] = (0.1, 0.2, 0.3, 0.25, 0.0, 0.0, 0.0)
    watch.reading["wrench"][2] = 1.5
    readings_of(watch).mend(watch.state, watch.reading)
    assert watch.reading["pose"].tolist() == [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]
    assert watch.reading["wrench"][2] == 1.5


def test_two_sensors_of_the_plate_agree() -> None:
    names = ("plate_temperature", "skin_temperature", "plate_temperature_2", "plate_temperature_3")
    watch = watched([temperature(name, ROLES.get(name, Role.SKIN_CONTACT_TEMPERATURE)) for name in names])
    watch.reading["plate_temperature"][0] = 300.0
    watch.reading["skin_temperature"][0] = 280.0
    for wrong in names[2:]:
        for value, trips in ((302.9, False), (303.0, False), (303.1, True), (296.9, True), (297.1, False)):
            watch.reading[wrong][0] = value
            found = trip_of(watch)
            assert (found is not None) is trips
            assert found is None or found[0] is Trip.SENSOR_DISAGREE
            assert found is None or "3.1 K" in found[1]


def test_numbers_too_large_to_add_up_are_not_believed() -> None:
    watch = watched([Channel("grip", 2, "N")])
    watch.reading["grip"][:] = 1e308
    assert trip_of(watch) == (Trip.NOT_A_NUMBER, "reads numbers that are too large to add up")


def test_the_right_channel_is_named() -> None:
    watch = watched(PLATE[0])
    watch.reading["heat_flux"][0] = math.nan
    found = trip_of(watch)
    assert found is not None
    assert found[1] == "reads NaN (heat_flux)"
    watch.reading["heat_flux"][0], watch.reading["sink_temperature"][0] = 0.0, 340.0
    found = trip_of(watch)
    assert found is not None
    assert found[0] is Trip.SINK_TEMPERATURE


def test_after_forgetting_a_reading_may_be_anywhere_and_recalling_compares_again() -> None:
    watch = watched(ARM[0], ARM[1])
    watch.check(1e-3)
    watch.reading["pose"][0] = 1.0
    watch.forget()
    assert trip_of(watch) is None
    watch.reading["pose"][0] = 0.5
    readings_of(watch).recall(watch.state, watch.reading)
    watch.reading["pose"][0] = 1.0
    assert trip_of(watch) is not None


def test_what_is_not_believed_is_put_back() -> None:
    watch = watched(TABLE[0], TABLE[1])
    watch.reading["pose"][:] = (0.01, 0.02, 0.03, 1, 0, 0, 0)
    readings_of(watch).put_back(watch.state, watch.reading)
    assert not np.any(watch.reading["pose"])
    watch.reading["pose"][:] = (0.01, 0.02, 0.03, 1, 0, 0, 0)
    assert trip_of(watch) is None
    watch.forget()
    watch.reading["pose"][0] = math.nan
    readings_of(watch).put_back(watch.state, watch.reading)
    assert watch.reading["pose"].tolist() == [0.01, 0.02, 0.03, 1, 0, 0, 0]
    watch.reading["pose"][1] = 0.5
    readings_of(watch).recall(watch.state, watch.reading)
    watch.reading["pose"][1] = 0.0
    readings_of(watch).put_back(watch.state, watch.reading)
    assert watch.reading["pose"].tolist()[:3] == [0.01, 0.5, 0.03]


def test_what_a_stopped_device_reads_is_mended_channel_by_channel() -> None:
    """A table whose place is no number may still feel what presses on it."""
    watch = watched(TABLE[0], TABLE[1])
    watch.reading["pose"][:] = (0.01, 0.02, 0.03, 1, 0, 0, 0)
    watch.reading["wrench"][:] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    assert trip_of(watch) is None
    watch.reading["pose"][:3] = (0.5, math.nan, 0.04)
    watch.reading["wrench"][2] = -2.0
    readings_of(watch).mend(watch.state, watch.reading)
    assert watch.reading["pose"].tolist()[:3] == [0.01, 0.02, 0.03]
    assert watch.reading["wrench"][2] == -2.0
    watch.reading["pose"][:3] = (0.5, 0.02, 0.04)
    watch.reading["wrench"][:3] = (0.5, math.inf, -2.0)
    readings_of(watch).mend(watch.state, watch.reading)
    assert watch.reading["pose"].tolist()[:3] == [0.5, 0.02, 0.04]
    assert watch.reading["wrench"].tolist()[:3] == [0.0, 0.0, -1.0]


@pytest.mark.parametrize(
    ("channel", "good", "bad"),
    [
        (plate_temperature(), (K0 + 79.0, K0 - 9.0), (K0 + 81.0, K0 - 11.0, math.nan, math.inf)),
        (skin_temperature(low=200.0, high=900.0), (K0 + 79.0,), (K0 + 81.0,)),
        (Channel("grip", 1, "N"), (1e9, -1e9), (math.inf, -math.inf, math.nan, 1e301)),
        (measured_wrench(force=50.0), (49.0,), (51.0, math.nan)),
    ],
)
def test_what_can_be_worked_with_though_it_may_trip(
    channel: Channel, good: tuple[float, ...], bad: tuple[float, ...]
) -> None:
    watch = watched([channel])
    for value in good:
        watch.reading[channel.name][-1] = value
        assert readings_of(watch).usable(watch.reading)
    for value in bad:
        watch.reading[channel.name][-1] = value
        assert not readings_of(watch).usable(watch.reading)
