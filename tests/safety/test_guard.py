"""The guard: what may be sent, whatever is asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import Channel, Field, Record, current, pose, pose_target, temperature, wrench
from itouch.safety import Guard, Trip, TripError, Watch
from itouch.world.limits import DeviceLimits

LIMITS = DeviceLimits(force=3.0, speed=0.25, speed_near=0.10, current=2.0, watchdog=0.02)
_any = st.floats(-1e6, 1e6)


@given(st.lists(_any, min_size=6, max_size=6), st.lists(_any, min_size=6, max_size=6), st.floats(1e-6, 1))
def test_a_wrench_keeps_its_direction_and_never_passes_the_limit(
    wanted: list[float], last: list[float], ramp: float
) -> None:
    guard = Guard(wrench(force=8.0), LIMITS)
    sent = np.array(last)
    guard.limit(np.array(wanted), sent, ramp, 1e-3, 1.0)
    size, asked = np.linalg.norm(sent[:3]), np.linalg.norm(wanted[:3])
    assert size <= 3.0 * ramp * (1 + 1e-12)
    assert size <= np.linalg.norm(last[:3]) + 1000.0 * 1e-3 + 1e-9
    if asked > 1e-6 and size > 0:
        assert np.allclose(sent[:3] / size, np.array(wanted[:3]) / asked, atol=1e-9)
    assert np.all(sent[3:] == 0.0)  # rotations are locked


@given(st.lists(_any, min_size=7, max_size=7), st.tuples(*(st.floats(0.0, 0.04) for _ in range(3))))
def test_a_surface_stays_in_its_travel_and_below_its_speeds(wanted: list[float], start: tuple[float, ...]) -> None:
    channel = pose_target(low=(0, 0, 0), high=(0.04, 0.04, 0.04), speed=0.3)
    guard = Guard(channel, LIMITS)
    sent = np.array([*start, 1.0, 0, 0, 0])
    before = sent.copy()
    guard.limit(np.array(wanted), sent, 1.0, 1e-3, 0.10)
    step = sent[:3] - before[:3]
    assert np.linalg.norm(step) <= 0.25e-3 * (1 + 1e-9)
    assert step[2] <= 0.10e-3 * (1 + 1e-9)
    assert np.all(sent[:3] >= -1e-12)
    assert np.all(sent[:3] <= 0.04 + 1e-12)
    assert list(sent[3:]) == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("at", range(6))
def test_what_is_not_a_number_stops_and_nothing_is_sent(bad: float, at: int) -> None:
    guard = Guard(wrench(force=8.0, torque=0.1), LIMITS)
    wanted, sent = np.zeros(6), np.full(6, 0.25)
    wanted[at] = bad
    with pytest.raises(TripError) as caught:
        guard.limit(wanted, sent, 1.0, 1e-3, 1.0)
    assert caught.value.trip is Trip.NOT_A_NUMBER
    assert np.all(sent == 0.25)


def test_current_is_clipped_to_the_scene_and_ramped() -> None:
    guard = Guard(current(limit=6.4), LIMITS)
    sent = np.zeros(1)
    assert guard.limit(np.array([5.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == 2.0
    guard.limit(np.array([-5.0]), sent, 0.5, 1e-3, 1.0)
    assert sent[0] == -1.0


def test_locked_components_are_zeroed_and_counted() -> None:
    guard = Guard(wrench(force=8.0, locked=(0, 1, 3, 4, 5)), LIMITS)
    sent = np.zeros(6)
    clamped, dropped = guard.limit(np.array([1.0, 0.0, 0.5, 0.0, 0.0, 2.0]), sent, 1.0, 1e-3, 1.0)
    assert (clamped, dropped) == (0, 2)
    assert list(sent) == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]


def test_retract_goes_down_as_fast_as_allowed_and_stops_at_the_end() -> None:
    guard = Guard(pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.3), LIMITS)
    sent = np.array([0.5, 0.5, 0.0006, 1.0, 0, 0, 0])
    heights = []
    for _ in range(4):
        guard.safe(sent, 1e-3)
        heights.append(float(sent[2]))
    assert heights == pytest.approx([0.00035, 0.0001, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("channel", "value", "trip"),
    [
        (pose(), math.nan, Trip.NOT_A_NUMBER),
        (temperature("plate_temperature"), 315.3, Trip.PLATE_TEMPERATURE),
        (temperature("plate_temperature"), 285.0, Trip.PLATE_TEMPERATURE),
        (temperature("sink_temperature"), 328.3, Trip.SINK_TEMPERATURE),
        (temperature("skin_temperature"), 400.0, Trip.SENSOR_RANGE),
        (temperature("skin_temperature"), math.inf, Trip.NOT_A_NUMBER),
    ],
)
def test_readings_that_are_not_believable_trip(channel: Channel, value: float, trip: Trip) -> None:
    reading = Record.of([Field(channel.name, "f8", channel.size)])
    reading[channel.name] = 300.0 if channel.unit == "K" else 0.0
    watch = Watch([channel], reading, DeviceLimits())
    watch.check(1e-3)
    reading[channel.name][-1] = value
    with pytest.raises(TripError) as caught:
        watch.check(1e-3)
    assert caught.value.trip is trip
