"""Who renders a slope: the plate what it can, the arm the rest, and never both or neither at a change."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from shipped import SCENES
from slope_scenes import Course, Slope, ball, follow, ramp

LIMIT = 25.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("slopes") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def hold(course: Course, force: float = 3.0, jerk: float = 0.1) -> None:
    """Assert what holds on every surface: no force twice, none missing, none in steps, and the plate away or there."""
    away = course.touching & ~course.plate
    assert course.pad[away].max(initial=0.0) == 0.0
    assert np.abs(course.flux[away]).max(initial=0.0) == 0.0
    assert np.linalg.norm(course.total, axis=1).max() <= force + 0.05  # one tick of the pad
    alone = away & (course.share >= 0.999)
    size = np.linalg.norm(course.virtual, axis=1)
    allowed = course.virtual * np.minimum(1.0, force / np.maximum(size, 1e-9))[:, None]
    wrong = np.linalg.norm(course.arm - allowed, axis=1)[alone]
    assert (wrong <= 0.02 * np.maximum(size[alone], 0.25)).all()
    own = np.r_[0.0, np.linalg.norm(np.diff(course.virtual, axis=0), axis=1)]  # what the surface itself does in a tick
    late = course.after_changes()
    assert (course.steps[late] <= np.maximum(jerk, own[late] + 0.02)).all()


@pytest.mark.parametrize("degrees", [0.0, 24.0, 26.0, 35.0, 60.0, 80.0])
def test_a_ramp_is_the_plates_or_the_arms(folder: Path, degrees: float) -> None:
    course = follow(Slope(*ramp(degrees)).build(folder))
    (contact,) = course.report["contacts"]
    assert contact["plate"] is (degrees < LIMIT)
    assert course.plate[course.touching].all() == (degrees < LIMIT)
    assert (course.pad.max() > 0.3) == (degrees < LIMIT)
    hold(course)


def test_a_steep_ramp_draws_no_heat(folder: Path) -> None:
    course = follow(Slope(*ramp(35.0), warm=True).build(folder))
    (contact,) = course.report["contacts"]
    assert contact["plate"] is False
    assert contact["mean_flux_W_m2"] is None
    assert not course.flux.any()
    assert np.ptp(course.skin) < 0.01
    hold(course)


@pytest.mark.parametrize("each", [0.15, 0.5])
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_stroke_over_a_ball_changes_hands_without_a_step(folder: Path, each: float, friction: float) -> None:
    course = follow(Slope(*ball([20, 40, 60, 40, 20, 0, -30, 0], each), friction=friction).build(folder))
    assert len(course.changes()) == (4 if friction == 0.0 or each < 0.5 else 2)  # a pad that is held by friction lags
    assert course.report["contacts"][0]["plate"] is True
    assert 0.0 < course.report["contacts"][0]["plate_s"] < course.touching.sum() * 1e-3 - 0.2
    hold(course)


def test_the_tilt_at_which_hands_change_has_hysteresis(folder: Path) -> None:
    course = follow(Slope(*ball([28, 20, 28, 20, 0], 0.6)).build(folder))
    tilt = np.degrees(np.arccos(np.clip(course.normal[:, 2], -1.0, 1.0)))
    for tick in course.changes():
        assert tilt[tick] == pytest.approx(25.0 if not course.renders[tick] else 23.0, abs=0.3)
    still = follow(Slope(*ball([24, 25.5, 24, 25.5, 24], 0.3)).build(folder))
    assert len(still.changes()) <= 1


@pytest.mark.parametrize("name", ["pebble.stl", "relief.obj"])
def test_a_mesh_is_felt_without_steps(folder: Path, name: str) -> None:
    sides = ' sides="one"' if name.endswith("obj") else ""
    world = f'<mesh name="thing" file="meshes/{name}" pos="0 0 0 mm"{sides} material="stuff"/>'
    motion = (
        '<to pos="-20 0 30 mm" in="0.2 s" hold="0.1 s"/><to pos="-14 0 12 mm" in="0.5 s"/>'
        '<to pos="14 3 12 mm" in="1.5 s"/><to pos="0 8 30 mm" in="0.5 s"/>'
    )
    hold(follow(Slope(world, motion, friction=0.3).build(folder)))


LAW = {"deadline": None, "phases": (Phase.explicit, Phase.generate), "suppress_health_check": list(HealthCheck)}


@settings(max_examples=6, derandomize=True, **LAW)
@given(
    angles=st.lists(st.floats(-70.0, 70.0), min_size=3, max_size=5), each=st.floats(0.6, 1.2),
    friction=st.sampled_from([0.0, 0.3, 0.8]), stiffness=st.floats(0.4, 1.5), radius=st.floats(20.0, 45.0),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_no_stroke_over_a_ball_breaks_the_law(
    folder: Path, angles: list[float], each: float, friction: float, stiffness: float, radius: float,
    seed: int,
) -> None:  # fmt: skip
    world, motion = ball(angles, each, radius)
    slope = Slope(world, motion, stiffness=stiffness, friction=friction, seed=seed)
    hold(follow(slope.build(folder)))


@pytest.mark.long
@settings(max_examples=60, **LAW)
@given(degrees=st.floats(0.0, 80.0), deep=st.floats(1.0, 6.0), friction=st.floats(0.0, 0.9), seed=st.integers(0, 99))
def test_no_ramp_breaks_the_law(folder: Path, degrees: float, deep: float, friction: float, seed: int) -> None:
    hold(follow(Slope(*ramp(degrees, deep), friction=friction, seed=seed).build(folder)))


@pytest.mark.parametrize("force", [1.0, 2.0])
def test_arm_and_plate_together_keep_to_the_scenes_limit(folder: Path, force: float) -> None:
    """A hand that presses harder than the scene allows goes in deeper; it is not pushed back harder."""
    course = follow(Slope(*ball([40, -40, 0], 1.0, deep=14.0), friction=0.3, force=force).build(folder))
    assert np.linalg.norm(course.virtual, axis=1).max() > 3.0 * force
    first = course.time[np.flatnonzero(course.touching)[0]]
    assert np.linalg.norm(course.total, axis=1)[course.time > first + 0.2].max() <= force + 0.05
