"""What holds a shape in the world: exact along each axis, however it stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.plugin import poses
from itouch.scene.elements import Capsule, Cylinder
from itouch.world.bindings import extent

LENGTH = st.floats(1e-3, 0.2)
ANGLE = st.floats(-3.2, 3.2)


def test_a_disc_is_as_high_as_it_is_long() -> None:
    low, high = extent(Cylinder(name="disc", material="wood", pos=(0.0, 0.0, 0.007), radius=0.04, length=0.014), {})
    assert low == pytest.approx([-0.04, -0.04, 0.0])
    assert high == pytest.approx([0.04, 0.04, 0.014])


@given(radius=LENGTH, length=LENGTH, rpy=st.tuples(ANGLE, ANGLE, ANGLE), kind=st.sampled_from([Cylinder, Capsule]))
def test_the_extent_is_that_of_the_points_of_the_shape(
    radius: float, length: float, rpy: tuple[float, float, float], kind: type
) -> None:
    low, high = extent(kind(name="it", material="wood", radius=radius, length=length, rpy=rpy), {})
    turn = poses.matrix(poses.quaternion_from_rpy(rpy))
    around = np.linspace(0.0, 2.0 * np.pi, 721)
    rim = np.stack([radius * np.cos(around), radius * np.sin(around), np.full_like(around, length / 2)], axis=1)
    points = np.concatenate([rim, rim * [1, 1, -1]]) @ np.asarray(turn).T
    assert (points <= high + 1e-12).all()
    assert (points >= low - 1e-12).all()
    if kind is Cylinder:
        assert points.max(axis=0) == pytest.approx(high, rel=1e-4)
        assert points.min(axis=0) == pytest.approx(low, rel=1e-4)
    else:
        assert high == pytest.approx(length / 2 * np.abs(turn[:, 2]) + radius)
