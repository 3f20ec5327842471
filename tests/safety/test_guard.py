"""The guard: what may be sent, whatever is asked for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itouch.plugin import HOLD, Channel, Role, current, pose_target, wrench
from itouch.safety import Guard, Trip, TripError
from itouch.safety.guard import ANYWHERE, not_finite
from itouch.world.limits import DeviceLimits, ceilings

LIMITS = DeviceLimits(force=3.0, speed=0.25, speed_near=0.10, current=2.0, watchdog=0.02)
TABLE = pose_target(low=(0, 0, 0), high=(0.04, 0.04, 0.04), speed=0.3)
_any = st.floats(-1e6, 1e6)


@given(st.lists(_any, min_size=6, max_size=6), st.lists(_any, min_size=6, max_size=6), st.floats(1e-6, 1))
def test_a_wrench_keeps_its_direction_and_never_passes_the_limit(
    wanted: list[float], last: list[float], share: float
) -> None:
    guard = Guard(wrench(force=8.0), LIMITS)
    sent = np.array(last)
    guard.limit(np.array(wanted), sent, share, 1e-3, 1.0)
    size, asked = np.linalg.norm(sent[:3]), np.linalg.norm(wanted[:3])
    assert size <= 3.0 * share * (1 + 1e-12)
    assert size <= np.linalg.norm(last[:3]) + 1000.0 * 1e-3 + 1e-9
    if asked > 1e-6 and size > 0:
        assert np.allclose(sent[:3] / size, np.array(wanted[:3]) / asked, atol=1e-9)
    assert np.all(sent[3:] == 0.0)  # rotations are locked


def test_a_force_grows_by_a_newton_a_millisecond_and_falls_at_once() -> None:
    guard, sent = Guard(wrench(force=8.0), LIMITS), np.array([0.3, 0.4, 0.0, 0, 0, 0])
    assert guard.limit(np.array([3.0, 0, 0, 0, 0, 0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent.tolist() == pytest.approx([1.5, 0, 0, 0, 0, 0])
    assert guard.limit(np.array([0.0, 1.2, 1.6, 0, 0, 0]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent.tolist() == [0.0, 1.2, 1.6, 0, 0, 0]
    assert guard.limit(np.array([0.0, 0, 3.0, 0, 0, 0]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert guard.limit(np.zeros(6), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent.tolist() == [0.0] * 6


def test_a_drive_that_may_cool_less_than_heat_is_held_to_its_part_of_each() -> None:
    """With half a share, half of what each way may have: not half of the other way's."""
    channel = Channel("current", 1, "A", (-0.8,), (1.6,), role=Role.DRIVE, doc="of a pad", safe=0.0)
    for wanted, got in ((-5.0, -0.4), (5.0, 0.8), (-0.3, -0.3), (0.7, 0.7)):
        sent = np.zeros(1)
        Guard(channel, LIMITS).limit(np.array([wanted]), sent, 0.5, 1.0, 1.0)
        assert sent.tolist() == pytest.approx([got])


def test_each_axis_counts_in_the_size_of_a_force() -> None:
    for axis in range(3):
        guard, sent = Guard(wrench(force=8.0), LIMITS), np.zeros(6)
        sent[axis] = 3.0
        wanted = np.zeros(6)
        wanted[axis] = -9.0
        guard.limit(wanted, sent, 1.0, 1e-3, 1.0)
        assert sent[axis] == pytest.approx(-3.0)


def test_without_a_limit_no_force_at_all() -> None:
    sent = np.zeros(6)
    Guard(wrench(force=8.0), DeviceLimits()).limit(np.array([1.0, 0, 0, 0, 0, 0]), sent, 1.0, 1e-3, 1.0)
    assert sent.tolist() == [0.0] * 6


TURNING = dataclasses.replace(LIMITS, torque=0.06)


def test_torques_stay_below_the_ceiling_and_ramp_in() -> None:
    guard, sent = Guard(wrench(force=8.0, torque=0.04), TURNING), np.zeros(6)
    assert guard.limit(np.array([0.0, 0, 0, 0.05, -0.05, 0.01]), sent, 1.0, 1.0, 1.0) == (1, 0)
    assert sent.tolist() == [0.0, 0, 0, 0.04, -0.04, 0.01]
    assert guard.limit(np.array([0.0, 0, 0, 0.01, -0.03, 0.01]), sent, 0.5, 1.0, 1.0) == (1, 0)
    assert sent.tolist() == pytest.approx([0.0, 0, 0, 0.01, -0.02, 0.01])
    assert guard.limit(np.array([0.0, 0, 0, 0.04, -0.04, 0.01]), sent, 1.0, 1.0, 1.0) == (0, 0)


_small = st.floats(-0.04, 0.04)


@given(st.lists(_any, min_size=6, max_size=6), st.lists(_small, min_size=3, max_size=3), st.floats(0, 1))
def test_a_torque_is_limited_in_size_and_in_its_increase(wanted: list[float], last: list[float], share: float) -> None:
    guard, sent = Guard(wrench(force=8.0, torque=5.0), TURNING), np.array([0.0, 0, 0, *last])
    guard.limit(np.array(wanted), sent, share, 1e-3, 1.0)
    size, before = float(np.linalg.norm(sent[3:])), math.hypot(*last)
    assert size <= 0.06 * share * (1 + 1e-9) + 1e-15
    assert size <= before + 1000.0 * 0.020 * 1e-3 + 1e-12  # K3, at the lever of a finger
    within = np.clip(wanted[3:], -5.0 * share, 5.0 * share)  # what the device can do about each axis
    assert np.allclose(np.cross(sent[3:], within), 0.0, atol=1e-9)


def test_a_torque_grows_as_a_force_does_and_shrinks_at_once() -> None:
    guard, sent, sizes = Guard(wrench(force=8.0, torque=5.0), TURNING), np.zeros(6), []
    for wanted in (*[(1.0, -1.0, 1.0)] * 4, (0.0, 0.0, 0.001)):
        guard.limit(np.array([0.0, 0, 0, *wanted]), sent, 1.0, 1e-3, 1.0)
        sizes.append(float(np.linalg.norm(sent[3:])))
    assert sizes == pytest.approx([0.02, 0.04, 0.06, 0.06, 0.001])
    guard.limit(np.array([0.0, 0, 0, 0.06, 0, 0]), sent, 1.0, 1.0, 1.0, 1.0)  # a newton is left: 20 mN m
    assert sent.tolist() == pytest.approx([0.0, 0, 0, 0.02, 0, 0])


def test_an_arm_without_a_limit_of_torque_gives_none() -> None:
    sent = np.zeros(6)
    Guard(wrench(force=8.0, torque=5.0), LIMITS).limit(np.array([1.0, 0, 0, 1, 1, 1]), sent, 1.0, 1.0, 1.0)
    assert sent.tolist() == [1.0, 0, 0, 0, 0, 0]


def test_an_arm_that_is_weaker_along_one_axis_or_one_way_is_asked_for_no_more() -> None:
    channel = Channel(
        "push", 6, "N", (-0.5, -2, -2, -0.01, 0, 0), (2, 2, 0, 0.05, 0, 0), safe=(0.0,) * 6, role=Role.FORCE_ON_OPERATOR
    )  # fmt: skip
    for wanted, kept in (
        ((-1.0, 0.5, 0, 0, 0, 0), (-0.5, 0.25, 0, 0, 0, 0)), ((1.0, 0.5, 0, 0, 0, 0), (1.0, 0.5, 0, 0, 0, 0)),
        ((0.1, 0, 1, 0, 0, 0), (0, 0, 0, 0, 0, 0)), ((0, 0, -1, 0, 0, 0), (0, 0, -1, 0, 0, 0)),
        ((0, 0, 0, -0.05, 0, 0), (0, 0, 0, -0.01, 0, 0)), ((0, 0, 0, 0.05, 0, 0), (0, 0, 0, 0.01, 0, 0)),
    ):  # fmt: skip
        sent = np.zeros(6)
        Guard(channel, TURNING).limit(np.array(wanted), sent, 1.0, 1.0, 1.0)
        assert sent.tolist() == pytest.approx(kept)


def test_torques_without_a_ceiling_are_nothing() -> None:
    channel = Channel("wrench", 6, "N", magnitude=8.0, safe=(0.0,) * 6, role=Role.FORCE_ON_OPERATOR)
    sent = np.zeros(6)
    assert Guard(channel, LIMITS).limit(np.array([0.5, 0, 0, 0.1, 0, -0.1]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent.tolist() == [0.5, 0, 0, 0, 0, 0]


@given(st.lists(_any, min_size=7, max_size=7), st.tuples(*(st.floats(0.0, 0.04) for _ in range(3))))
def test_a_surface_stays_in_its_travel_and_below_its_speeds(wanted: list[float], start: tuple[float, ...]) -> None:
    guard = Guard(TABLE, LIMITS)
    sent = np.array([*start, 1.0, 0, 0, 0])
    before = sent.copy()
    guard.limit(np.array(wanted), sent, 1.0, 1e-3, 0.10)
    step = sent[:3] - before[:3]
    assert np.linalg.norm(step) <= 0.25e-3 * (1 + 1e-9)
    assert step[2] <= 0.10e-3 * (1 + 1e-9)
    assert np.all(sent[:3] >= -1e-12)
    assert np.all(sent[:3] <= 0.04 + 1e-12)
    assert list(sent[3:]) == [1.0, 0.0, 0.0, 0.0]


def moved(wanted: tuple[float, float, float], *, share: float = 1.0, closing: float = 0.1) -> tuple[list[float], int]:
    """Return how far a surface at 20, 20, 20 mm goes in a millisecond [mm], and how many limits were applied."""
    sent = np.array([0.02, 0.02, 0.02, 1.0, 0, 0, 0])
    clamped, _ = Guard(TABLE, LIMITS).limit(np.array([*wanted, 1.0, 0, 0, 0]), sent, share, 1e-3, closing)
    return ((sent[:3] - 0.02) * 1e3).tolist(), clamped


def test_a_surface_goes_where_it_is_asked_as_fast_as_it_may() -> None:
    assert moved((0.0201, 0.01995, 0.0199)) == (pytest.approx([0.1, -0.05, -0.1]), 0)
    assert moved((0.02, 0.02, 0.021)) == (pytest.approx([0, 0, 0.1]), 1)
    assert moved((0.02, 0.02, 0.02009)) == (pytest.approx([0, 0, 0.09]), 0)
    assert moved((0.02, 0.02, 0.01)) == (pytest.approx([0, 0, -0.25]), 1)
    assert moved((0.03, 0.02, 0.02)) == (pytest.approx([0.25, 0, 0]), 1)
    assert moved((0.02, 0.01, 0.02)) == (pytest.approx([0, -0.25, 0]), 1)
    assert moved((0.05, 0.02, 0.02)) == (pytest.approx([0.25, 0, 0]), 1)
    assert moved((0.02024, 0.02, 0.02)) == (pytest.approx([0.24, 0, 0]), 0)
    assert moved((0.0203, 0.0204, 0.02)) == (pytest.approx([0.15, 0.2, 0]), 1)


def test_a_surface_ramps_in_but_never_stands_still() -> None:
    assert moved((0.03, 0.02, 0.02), share=0.4)[0] == pytest.approx([0.1, 0, 0])
    assert moved((0.02, 0.02, 0.03), share=0.4)[0] == pytest.approx([0, 0, 0.04])
    assert moved((0.03, 0.02, 0.02), share=0.0)[0] == pytest.approx([0.0125, 0, 0])


def test_a_surface_without_a_speed_stays() -> None:
    sent = np.array([0.02, 0.02, 0.02, 1.0, 0, 0, 0])
    Guard(TABLE, DeviceLimits()).limit(np.array([0.03, 0.02, 0.01, 1.0, 0, 0, 0]), sent, 1.0, 1e-3, 0.1)
    assert sent[:3].tolist() == [0.02] * 3


def test_a_free_orientation_stays_a_quaternion_of_numbers_up_to_one() -> None:
    channel = pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.3, locked=())
    sent = np.array([0.5, 0.5, 0.5, 1.0, 0, 0, 0])
    assert Guard(channel, LIMITS).limit(np.array([0.5, 0.5, 0.5, 9.0, -9.0, 0.5, 0]), sent, 1.0, 1e-3, 0.1) == (1, 0)
    assert sent[3:].tolist() == [1.0, -1.0, 0.5, 0.0]


@pytest.mark.parametrize("axis", range(3))
def test_a_locked_axis_of_a_surface_is_dropped(axis: int) -> None:
    channel = pose_target(low=(-1, -1, -1), high=(1, 1, 1), speed=0.3, locked=(axis, 3, 4, 5))
    sent = np.array([0.0, 0, 0, 1.0, 0, 0, 0])
    wanted = np.array([1e-4, 1e-4, 1e-4, 1.0, 0, 0, 0])
    assert Guard(channel, LIMITS).limit(wanted, sent, 1.0, 1e-3, 0.1) == (0, 1)
    assert sent.tolist() == [*(0.0 if one == axis else 1e-4 for one in range(3)), 1.0, 0, 0, 0]
    wanted = np.array([0.0, 0, 0, 0.5, 0.5, 0.5, 0.5])
    assert Guard(channel, LIMITS).limit(wanted, sent.copy(), 1.0, 1e-3, 0.1)[1] == 4


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("at", range(6))
def test_what_is_not_a_number_stops_and_nothing_is_sent(bad: float, at: int) -> None:
    guard = Guard(wrench(force=8.0, torque=0.1), LIMITS)
    wanted, sent = np.zeros(6), np.full(6, 0.25)
    wanted[at] = bad
    with pytest.raises(TripError, match=r"was commanded with (NaN|an infinite number) \(wrench\)") as caught:
        guard.limit(wanted, sent, 1.0, 1e-3, 1.0)
    assert caught.value.trip is Trip.NOT_A_NUMBER
    assert np.all(sent == 0.25)


def test_numbers_too_large_to_add_up_stop() -> None:
    with pytest.raises(TripError, match="too much"):
        Guard(wrench(force=8.0), LIMITS).limit(np.full(6, 1e308), np.zeros(6), 1.0, 1e-3, 1.0)


def test_the_words_for_what_is_not_finite() -> None:
    assert not_finite([1.0, math.nan]) == "NaN"
    assert not_finite([1.0, -math.inf, math.nan]) == "an infinite number"
    assert not_finite([1e308]) == "too much"


def test_current_is_clipped_to_the_scene_and_ramped() -> None:
    guard = Guard(current(limit=6.4), LIMITS)
    sent = np.zeros(1)
    assert guard.limit(np.array([5.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == 2.0
    assert guard.limit(np.array([-5.0]), sent, 0.5, 1e-3, 1.0) == (1, 0)
    assert sent[0] == -1.0
    assert guard.limit(np.array([-2.0]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent[0] == -2.0
    assert guard.limit(np.array([7.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)


def test_current_never_passes_the_hardware_and_is_nothing_without_a_limit() -> None:
    sent = np.zeros(1)
    assert Guard(current(limit=0.5), LIMITS).limit(np.array([1.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == 0.5
    assert Guard(current(limit=0.5), DeviceLimits()).limit(np.array([0.3]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == 0.0


def test_slew_limits_both_ways() -> None:
    channel = Channel("current", 1, "A", (-5.0,), (5.0,), slew=(100.0,), safe=(0.0,), role=Role.DRIVE)
    guard, sent = Guard(channel, DeviceLimits(current=5.0)), np.array([1.0])
    assert guard.limit(np.array([3.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == pytest.approx(1.1)
    assert guard.limit(np.array([-3.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent[0] == pytest.approx(1.0)
    assert guard.limit(np.array([1.05]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent[0] == pytest.approx(1.05)


def test_a_temperature_target_stays_between_the_limits() -> None:
    channel = Channel(
        "temperature_target", 1, "K", (250.0,), (400.0,), slew=(1000.0,), safe=HOLD, role=Role.TEMPERATURE_TARGET
    )
    limits, sent = DeviceLimits(temperature=(290.0, 310.0)), np.array([300.0])
    for wanted, got, count in ((305.0, 301.0, 1), (300.5, 300.5, 0), (100.0, 299.5, 1), (500.0, 300.5, 1)):
        assert Guard(channel, limits).limit(np.array([wanted]), sent, 1.0, 1e-3, 1.0) == (count, 0)
        assert sent[0] == pytest.approx(got)
    plain = Channel("temperature_target", 1, "K", safe=HOLD, role=Role.TEMPERATURE_TARGET)
    for wanted, got, count in ((280.0, 288.15, 1), (320.0, 313.15, 1), (300.0, 300.0, 0)):
        assert Guard(plain, DeviceLimits()).limit(np.array([wanted]), sent, 1.0, 1e-3, 1.0) == (count, 0)
        assert sent[0] == got


def pad(**others: object) -> Channel:
    """Return a target whose safe value is no temperature: the pad is off."""
    return Channel("goal", 1, "K", (0.0,), (320.0,), safe=(0.0,), role=Role.TEMPERATURE_TARGET, **others)  # type: ignore[arg-type]


def test_a_pad_that_is_commanded_off_is_off() -> None:
    guard, sent = Guard(pad(), DeviceLimits(temperature=(290.0, 310.0))), np.array([300.0])
    for wanted, share, got, count in (
        (0.0, 1.0, 0.0, 0), (300.0, 1.0, 300.0, 0), (0.0, 0.0, 0.0, 0), (300.0, 0.0, 0.0, 1), (-5.0, 0.5, 0.0, 1),
        (199.9, 1.0, 0.0, 1), (200.0, 1.0, 290.0, 1), (310.0, 0.5, 305.0, 1), (0.0, 0.5, 0.0, 0), (320.5, 1.0, 310.0, 1),
    ):  # fmt: skip
        assert guard.limit(np.array([wanted]), sent, share, 1e-3, 1.0) == (count, 0)
        assert sent[0] == got
    with pytest.raises(TripError):
        guard.limit(np.array([math.nan]), sent, 1.0, 1e-3, 1.0)
    held = Guard(dataclasses.replace(pad(), safe=HOLD), DeviceLimits(temperature=(290.0, 310.0)))
    for share, got in ((1.0, 290.0), (0.0, 300.0)):  # it has no off that anybody knows
        assert held.limit(np.array([0.0]), sent, share, 1e-3, 1.0) == (1, 0)
        assert sent[0] == got


def test_a_slew_from_off_begins_in_the_middle_of_the_limits() -> None:
    guard, sent = Guard(pad(slew=(1000.0,)), DeviceLimits(temperature=(290.0, 310.0))), np.zeros(1)
    for wanted, got in ((308.0, 301.0), (308.0, 302.0), (0.0, 0.0), (290.0, 299.0)):
        guard.limit(np.array([wanted]), sent, 1.0, 1e-3, 1.0)
        assert sent[0] == got


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(0.0, 1.0)), min_size=1, max_size=8),
    st.floats(288.15, 300.0), st.floats(300.0, 313.15), st.sampled_from([(), (50.0,), (5e4,)]),
)  # fmt: skip
def test_a_pad_is_off_or_within_its_limits_whatever_is_asked(
    asked: list[tuple[float, float]], low: float, high: float, slew: tuple[float, ...]
) -> None:
    guard, sent = Guard(pad(slew=slew), DeviceLimits(temperature=(low, high))), np.zeros(1)
    for wanted, share in asked:
        guard.limit(np.array([wanted]), sent, share, 1e-3, 1.0)
        off = share == 0.0 or wanted < 200.0
        assert sent[0] == 0.0 if off else low - 1e-9 <= sent[0] <= high + 1e-9


def test_other_commands_stay_in_their_range() -> None:
    channel = Channel("vibration", 2, "m/s^2", (-1.0, 0.0), (1.0, 2.0), safe=(0.0, 0.0))
    guard, sent = Guard(channel, DeviceLimits()), np.zeros(2)
    assert guard.limit(np.array([-3.0, 3.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent.tolist() == [-1.0, 2.0]
    assert guard.limit(np.array([3.0, -3.0]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent.tolist() == [1.0, 0.0]
    assert guard.limit(np.array([0.5, 1.5]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent.tolist() == [0.5, 1.5]
    endless = Channel("vibration", 1, "m/s^2", safe=(0.0,))
    assert Guard(endless, DeviceLimits()).limit(np.array([1e5]), sent[:1], 1.0, 1e-3, 1.0) == (0, 0)
    assert sent[0] == 1e5


def test_locked_components_are_zeroed_and_counted() -> None:
    guard = Guard(wrench(force=8.0, locked=(0, 1, 3, 4, 5)), LIMITS)
    sent = np.zeros(6)
    clamped, dropped = guard.limit(np.array([1.0, 0.0, 0.5, 0.0, 0.0, 2.0]), sent, 1.0, 1e-3, 1.0)
    assert (clamped, dropped) == (0, 2)
    assert list(sent) == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]


def test_what_a_channel_does_not_have_is_not_locked() -> None:
    channel = Channel("brake", 2, "N", (-1.0, -1.0), (1.0, 1.0), safe=(0.0, 0.0), locked=(1, 2))
    sent = np.zeros(2)
    assert Guard(channel, LIMITS).limit(np.array([0.5, 0.5]), sent, 1.0, 1e-3, 1.0) == (0, 1)
    assert sent.tolist() == [0.5, 0.0]


def heights(
    guard: Guard, start: float, *, backwards: bool = False, ends: tuple[float, float] = ANYWHERE
) -> list[float]:
    sent, found = np.array([0.5, 0.5, start, 1.0, 0, 0, 0]), []
    for _ in range(4):
        guard.safe(sent, 1e-3, backwards=backwards, ends=ends)
        found.append(float(sent[2]))
    assert sent[:2].tolist() == [0.5, 0.5]
    return found


def test_retract_goes_down_as_fast_as_allowed_and_stops_at_the_end() -> None:
    guard = Guard(pose_target(low=(0, 0, 0), high=(1, 1, 0.8), speed=0.3), LIMITS)
    assert heights(guard, 0.0006) == pytest.approx([0.00035, 0.0001, 0.0, 0.0], abs=1e-12)
    assert heights(guard, 0.7994, backwards=True) == pytest.approx([0.79965, 0.7999, 0.8, 0.8], abs=1e-12)
    assert heights(Guard(guard.channel, DeviceLimits()), 0.5) == [0.5] * 4


def test_how_far_a_retreat_leads_may_be_bounded() -> None:
    guard = Guard(pose_target(low=(0, 0, 0), high=(1, 1, 0.8), speed=0.3), LIMITS)
    nan = math.nan
    assert heights(guard, 0.5, ends=(0.4994, nan)) == pytest.approx([0.49975, 0.4995, 0.4994, 0.4994], abs=1e-12)
    assert heights(guard, 0.5, ends=(0.6, nan)) == [0.5] * 4  # what is lower already is not raised
    assert heights(guard, 0.0001, ends=(-1.0, nan)) == [0.0] * 4  # nor does it go beyond its travel
    up = heights(guard, 0.5, backwards=True, ends=(nan, 0.5006))
    assert up == pytest.approx([0.50025, 0.5005, 0.5006, 0.5006], abs=1e-12)
    assert heights(guard, 0.5, backwards=True, ends=(nan, 0.4)) == [0.5] * 4
    assert heights(guard, 0.7999, backwards=True, ends=(nan, 2.0)) == [0.8] * 4
    assert heights(guard, 0.5, ends=(nan, 0.6))[0] == pytest.approx(0.49975)
    assert heights(guard, 0.5, backwards=True, ends=(0.4, nan))[0] == pytest.approx(0.50025)


def test_retracting_is_downwards_unless_it_is_said() -> None:
    sent = np.array([0.5, 0.5, 0.5, 1.0, 0, 0, 0])
    Guard(pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.3), LIMITS).safe(sent, 1e-3)
    assert sent[2] < 0.5


def test_holding_and_endless_travel_stay() -> None:
    assert heights(Guard(Channel("pose_target", 7, "m", safe=HOLD, role=Role.SURFACE_POSE), LIMITS), 0.5) == [0.5] * 4
    endless = pose_target(low=(0, 0, 0), high=(1, 1, 1), speed=0.3)
    bare = Channel("pose_target", 7, "m", safe=endless.safe, role=Role.SURFACE_POSE)
    assert heights(Guard(bare, LIMITS), 0.5) == [0.5] * 4


def test_the_safe_value_is_sent_at_once() -> None:
    sent = np.full(6, 2.0)
    Guard(wrench(force=8.0), LIMITS).safe(sent, 1e-3)
    assert sent.tolist() == [0.0] * 6


@pytest.mark.parametrize("side", ["low", "high"])
def test_a_limit_on_one_side_leaves_the_other_endless(side: str) -> None:
    ends = {"low": (-0.5, 0.0), "high": (0.5, 2.0)}
    channel = Channel("valve", 2, "", **{side: ends[side]}, safe=HOLD)  # type: ignore[arg-type]
    sent = np.zeros(2)
    far = -9.0 if side == "low" else 9.0
    assert Guard(channel, LIMITS).limit(np.array([far, far]), sent, 1.0, 1e-3, 1.0) == (1, 0)
    assert sent.tolist() == list(ends[side])
    assert Guard(channel, LIMITS).limit(np.array([-far, -far]), sent, 1.0, 1e-3, 1.0) == (0, 0)
    assert sent.tolist() == [-far, -far]


def test_a_torque_or_current_without_a_ceiling_is_none() -> None:
    open_wrench = Channel("wrench", 6, "N", low=(-1.0,) * 6, safe=(0.0,) * 6, role=Role.FORCE_ON_OPERATOR)
    sent = np.zeros(6)
    for share in (1.0, 0.0):
        Guard(open_wrench, LIMITS).limit(np.array([0, 0, 0, 0.5, -0.5, 0.0]), sent, share, 1e-3, 1.0)
        assert not sent.any()
    assert "current" not in ceilings((), (Channel("current", 1, "A", low=(-1.0,), safe=(0.0,), role=Role.DRIVE),))
    assert ceilings((), (current(limit=1.5),))["current"][0] == 1.5
