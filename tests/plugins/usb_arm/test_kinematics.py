"""The delta's kinematics over the whole workspace: inverse, forward, Jacobian and power."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itouch_usb_arm import kinematics as k


def places(count: int, seed: int) -> Iterator[tuple[float, float, float]]:
    """Positions all over a region larger than the useful workspace (z 75 to 175 mm)."""
    rng = np.random.default_rng(seed)
    while count:
        radius, turn = 0.06 * math.sqrt(rng.random()), rng.uniform(0.0, math.tau)
        place = (radius * math.cos(turn), radius * math.sin(turn), rng.uniform(0.065, 0.18))
        try:
            if np.linalg.cond(k.jacobian(place)) > 40:
                continue
        except k.UnreachableError:
            continue
        yield place
        count -= 1


def test_forward_undoes_inverse_from_the_centre() -> None:
    worst = max(float(np.abs(np.subtract(k.forward(k.inverse(p)), p)).max()) for p in places(3000, 1))
    assert worst < 1e-12


def test_inverse_undoes_forward_in_counts() -> None:
    rng = np.random.default_rng(2)
    for _ in range(500):
        counts = rng.integers(-1400, 1000) + rng.integers(-300, 300, 3)
        again = k.counts_of(k.inverse(k.forward(k.angles_of(counts.tolist()))))
        assert np.abs(np.subtract(again, counts)).max() < 1e-8


def test_jacobian_by_extrapolated_differences() -> None:
    """Richardson's extrapolation: a plain difference is itself off by more than 1e-7 near the edge."""
    for place in places(300, 4):
        exact = np.array(k.jacobian(place))

        def slope(step: float, place: tuple[float, float, float] = place) -> np.ndarray:
            sides = [[k.inverse(np.add(place, sign * step * e)) for e in np.eye(3)] for sign in (1, -1)]
            return np.subtract(sides[0], sides[1]).T / (2 * step)

        better = (4 * slope(1e-5) - slope(2e-5)) / 3
        assert np.abs(better - exact).max() / np.abs(exact).max() < 1e-7


def test_power_is_conserved_and_push_undoes_torques() -> None:
    rng = np.random.default_rng(5)
    for place in places(500, 5):
        force, velocity = rng.normal(size=3), rng.normal(size=3)
        torque = np.array(k.torques(place, force))
        assert torque @ (np.array(k.jacobian(place)) @ velocity) == pytest.approx(force @ velocity, abs=1e-12)
        assert k.push(place, torque) == pytest.approx(force, abs=1e-12)


def test_the_middle_and_the_sizes() -> None:
    """On the axis all legs are equal; a leg's turn is 9881 counts; a count is 0.03 to 0.05 mm at the centre."""
    one, two, three = k.inverse((0.0, 0.0, 0.11))
    assert one == pytest.approx(two, abs=1e-14) == pytest.approx(three, abs=1e-14)
    assert k.COUNTS_PER_RADIAN * math.tau == pytest.approx(9880.7, abs=0.1)
    resolution = 1.0 / (np.linalg.svd(k.jacobian(k.CENTRE))[1] * k.COUNTS_PER_RADIAN)
    assert 2.5e-5 < resolution.min() < resolution.max() < 6e-5


def test_turning_the_place_by_a_third_moves_the_legs_on() -> None:
    turn = math.radians(120.0)
    c, s = math.cos(turn), math.sin(turn)
    x, y, z = 0.02, -0.013, 0.12
    angles = k.inverse((x, y, z))
    turned = k.inverse((c * x - s * y, s * x + c * y, z))  # leg at 105 degrees goes to 225 = -135
    assert turned == pytest.approx((angles[1], angles[2], angles[0]), abs=1e-14)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.4), (0.3, 0.0, 0.1), (0.0, 0.0, 0.0), (0.0, -0.2, 0.12)])
def test_out_of_reach_is_told(place: tuple[float, float, float]) -> None:
    with pytest.raises(k.UnreachableError, match="reach"):
        k.inverse(place)


@settings(max_examples=150, deadline=None)
@given(st.tuples(*[st.integers(-32768, 32767)] * 3))
def test_any_counts_give_a_position_with_these_counts_or_an_error(counts: tuple[int, int, int]) -> None:
    try:
        place = k.forward(k.angles_of(counts))
    except k.UnreachableError:
        return
    turns = np.subtract(k.inverse(place), k.angles_of(counts))
    assert np.abs(turns).max() < 1e-10


def test_not_a_number_is_no_angle() -> None:
    with pytest.raises(k.UnreachableError):
        k.forward((math.nan, 0.0, 0.0))
