"""Objects that come, go, tilt and slide away under a finger: plate and arm follow without a step, and nothing trips."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from campaign import tell
from shipped import SCENES

from itouch_evidence.surface.course import PAD, PAD_DAMPING, Course, Floats, around, follow
from itouch_evidence.surface.moving import block, moved, press
from itouch_evidence.surface.scenes import Slope

#: What a step may be above 0.1 N, or above what the object itself does: sensors of force and place have noise [N].
NOISE = 0.015
#: How many ticks apart the virtual force and what is felt may do the same.
APART = 10


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("moving") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def excess(course: Course) -> Floats:
    """Return by how much the finger feels a greater step than it may [N], after first impacts.

    It may feel 0.1 N a tick; what the virtual contact itself does; and what a surface does that comes at the finger, or
    a finger that goes up or down by itself, on a plate that is not soft: those are true impacts.
    """
    virtual = np.r_[0.0, np.linalg.norm(np.diff(course.virtual, axis=0), axis=1)]
    period = course.time[1] - course.time[0]
    depth = np.where(np.isfinite(course.depth), course.depth, 0.0)
    own, comes = np.r_[0.0, np.diff(course.lowest)], np.r_[0.0, np.diff(depth)]
    pad = np.maximum(np.abs(own), np.where(comes < 1e-3, comes, 0.0))
    jerk = np.abs(np.r_[0.0, np.diff(own)]) / period
    allowed = np.maximum(np.maximum(0.1, around(virtual, APART)), PAD * pad + PAD_DAMPING * jerk)
    return np.where(course.after(course.begins(), 0.05), 0.0, course.steps - allowed)


def hold(course: Course) -> None:
    assert excess(course).max() <= NOISE
    assert np.linalg.norm(course.total, axis=1).max() <= course.force * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", [44, 53, 85, 111, 128, 179, *range(12)])
def test_an_object_that_moves_under_a_finger_is_felt_without_steps(folder: Path, seed: int) -> None:
    hold(follow(moved(seed).build(folder)))


@pytest.mark.long
@pytest.mark.campaign
def test_nearly_no_object_that_moves_under_a_finger_is_felt_in_steps(folder: Path) -> None:
    """What is left; the one that was looked at: a finger falls onto a plate on its way down from a slope."""
    courses = {seed: follow(moved(seed).build(folder)) for seed in range(1000, 1400)}
    over = {seed: course.steps[excess(course) > NOISE].max() for seed, course in courses.items()
            if excess(course).max() > NOISE}  # fmt: skip
    listed = ", ".join(f"{seed} ({step:.2f} N)" for seed, step in over.items())
    tell(f"{len(courses)} motions, {len(over)} with a step that the virtual contact does not have: {listed or 'none'}")
    assert len(over) <= 4


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_hand_that_lifts_while_an_edge_goes_by_trips_nothing(folder: Path, friction: float) -> None:
    """The plate goes down from the edge in a hurry, and must come up again behind the hand without one (K5)."""
    motion = '<to pos="0 0 0 mm" in="1 s"/><to pos="60 0 0 mm" in="2.25 s"/>'
    course = follow(Slope(block(motion), press(4.0), friction=friction).build(folder))
    hold(course)


def test_a_surface_that_falls_away_eases_a_finger_slowly(folder: Path) -> None:
    motion = '<to pos="0 0 0 mm" in="1 s"/><to pos="0 0 -30 mm" in="0.06 s"/>'
    course = follow(Slope(block(motion), press(4.0)).build(folder))
    falls = -np.diff(course.pad)[(course.time[1:] > 1.0) & (course.time[1:] < 1.2)]
    assert course.pad[course.time < 1.0].max() > 0.8
    assert falls.max() < 0.08
    assert course.pad[(course.time > 1.1) & (course.time < 1.2)].max() == 0.0


def test_what_rises_with_an_object_is_no_fault_of_the_table(folder: Path) -> None:
    """How far the table gives way is learned from its force, not from an object that moves under the finger."""
    motion = '<to pos="0 0 0 mm" in="1 s"/>' + '<to pos="0 0 3 mm" in="0.15 s"/><to pos="0 0 0 mm" in="0.15 s"/>' * 3
    session = Slope(block(motion), press(4.0)).build(folder)
    session.run(0.99)
    still = session.state["finger.surface.climb"].item()
    given = [session.state[name].item() for name in session.state if name.endswith(".give")]
    session.run(0.06)
    assert abs(still) < 1e-3
    assert session.state["finger.surface.climb"].item() > 0.02
    session.run(0.9)
    after = [session.state[name].item() for name in session.state if name.endswith(".give")]
    assert abs(after[0] - given[0]) < 2e-5
