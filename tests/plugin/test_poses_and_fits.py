"""The arithmetic that plugins are given: poses against matrices, lines through samples, what an ideal twin mirrors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import (
    Channel,
    Role,
    line_through,
    plate_temperature,
    poses,
    sink_temperature,
    skin_temperature,
)
from itouch.plugin.ideal import pairs

ANGLES = st.tuples(*[st.floats(-3.2, 3.2)] * 3)
VECTORS = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def about(axis: int, angle: float) -> np.ndarray:
    turn, (i, j) = np.eye(3), [k for k in range(3) if k != axis]
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[j, i] = math.sin(angle) if axis != 1 else -math.sin(angle)
    turn[i, j] = -turn[j, i]
    return turn


@given(rpy=ANGLES, other=ANGLES, vector=VECTORS)
def test_a_quaternion_turns_as_the_matrices_about_x_then_y_then_z(
    rpy: tuple[float, ...], other: tuple[float, ...], vector: tuple[float, ...]
) -> None:
    one, two = (np.array(poses.quaternion_from_rpy(angles)) for angles in (rpy, other))
    turns = [about(2, yaw) @ about(1, pitch) @ about(0, roll) for roll, pitch, yaw in (rpy, other)]
    v = np.array(vector)
    assert poses.rotate(one, v) == pytest.approx(turns[0] @ v, abs=1e-12)
    assert np.asarray(poses.matrix(one)) == pytest.approx(turns[0], abs=1e-12)
    assert poses.rotate(poses.multiply(one, two), v) == pytest.approx(turns[0] @ turns[1] @ v, abs=1e-12)
    assert poses.rotate(poses.conjugate(one), poses.rotate(one, v)) == pytest.approx(v, abs=1e-12)


def test_a_line_has_slope_zero_and_what_is_left() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0])
    assert line_through(x, 2.0 * x - 1.0) == pytest.approx((2.0, -1.0, 0.0), abs=1e-12)
    off = np.array([1.0, -1.0, -1.0, 1.0])  # neither a line's height nor its slope
    assert line_through(x, 2.0 * x - 1.0 + 0.1 * off) == pytest.approx((2.0, -1.0, 0.1))


@pytest.mark.parametrize("x", [[0.0, 1.0], [2.0, 2.0, 2.0]])
def test_what_says_nothing_of_a_line_is_refused(x: list[float]) -> None:
    with pytest.raises(ValueError, match="three samples or more at different values"):
        line_through(np.array(x), np.arange(float(len(x))))


def test_an_ideal_twin_mirrors_by_role_then_by_name_then_by_unit() -> None:
    reads = (
        Channel("temperature", unit="K", role=Role.SKIN_CONTACT_TEMPERATURE),
        Channel("right", unit="V", role=Role.SIGNAL),
        Channel("left", unit="V", role=Role.SIGNAL),
        Channel("lonely", unit="bar", role=Role.SIGNAL),
    )
    commands = (
        Channel("left", unit="V", role=Role.SIGNAL),
        Channel("drive", unit="V", role=Role.SIGNAL),
        Channel("target", unit="K", role=Role.TEMPERATURE_TARGET),
    )
    assert dict(pairs(reads, commands)) == {"temperature": "target", "right": "drive", "left": "left"}


@pytest.mark.parametrize(
    ("channel", "low", "high"),
    [
        (plate_temperature(), -10.0, 80.0),
        (skin_temperature(), -10.0, 80.0),
        (sink_temperature(), -10.0, 80.0),
    ],
)
def test_a_temperature_is_read_over_the_range_that_a_sensor_at_a_finger_needs(
    channel: Channel, low: float, high: float
) -> None:
    assert [channel.low[0] - 273.15, channel.high[0] - 273.15] == pytest.approx([low, high])
