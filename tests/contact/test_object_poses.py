"""Poses of objects in a step of contact: between an object's frame and the world's, now and a step ago."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_in_python import python_of
from scipy.spatial.transform import Rotation

from itouch.contact import object_poses as poses
from itouch.contact.layout import SITE_WIDTH


@pytest.mark.parametrize("length", [1.0, 0.2, 3.0])
def test_points_and_directions_go_to_the_world_and_back_by_the_pose_now_and_then(
    length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(poses, "rotate", python_of(poses.rotate))
    rng = np.random.default_rng(4)
    places, turns = rng.uniform(-1.0, 1.0, (3, 3)), Rotation.random(3, random_state=4)
    quaternions = length * np.roll(turns.as_quat(), 1, axis=1)  # of any length but zero
    site, table = np.zeros((2, SITE_WIDTH)), np.hstack([places, quaternions])
    python_of(poses.set_frame)(site, 1, 0, table, 2)
    python_of(poses.set_frame)(site, 1, 1, table, 1)
    for point in rng.uniform(-1.0, 1.0, (5, 3)):
        p = tuple(point.tolist())
        turned, then = turns[2].apply(point), turns[1].inv().apply(point - places[1])
        assert python_of(poses.rotate)(site, 1, p) == pytest.approx(turned)
        assert python_of(poses.unrotate)(site, 1, tuple(turned.tolist())) == pytest.approx(p)
        world = python_of(poses.to_world)(site, 1, p)
        assert world == pytest.approx(turned + places[2])
        assert python_of(poses.to_local)(site, 1, world) == pytest.approx(p)
        assert python_of(poses.to_local_then)(site, 1, p) == pytest.approx(then)
    assert not site[0].any()
