"""Objects that come, go, tilt and slide away under a finger: plate and arm follow without a step, and nothing trips."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from campaign import tell
from shipped import SCENES

from itouch_evidence.surface.course import PAD, PAD_DAMPING, Course, Floats, around, follow
from itouch_evidence.surface.draw import block, moved, press
from itouch_evidence.surface.edges import edge
from itouch_evidence.surface.laws import broken, judge
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
    """None is; one was, as a finger fell onto a plate on its way down from a slope."""
    courses = {seed: follow(moved(seed).build(folder)) for seed in range(1000, 1400)}
    over = {seed: course.steps[excess(course) > NOISE].max() for seed, course in courses.items()
            if excess(course).max() > NOISE}  # fmt: skip
    listed = ", ".join(f"{seed} ({step:.2f} N)" for seed, step in over.items())
    tell(f"{len(courses)} motions, {len(over)} with a step that the virtual contact does not have: {listed or 'none'}")
    assert not over


#: Objects that tilt slowly beyond 45 degrees and back, up to where the plate renders them: tilts before, at most and
#: after [deg], time of each way [s], how deep the hand presses [mm], scene.
STEEP = [
    pytest.param((35.0, 53.18, 37.0), 7.486, 3.923, Slope("", "", 1.5215, 0.0, 2.7954, warm=True, seed=77),
                 id="an arm that reads in steps makes a steep face jump, and the plate with it"),
    pytest.param((35.0, 48.42, 37.0), 0.339, 3.675, Slope("", "", 1.2603, 0.8, 2.4828, seed=52),
                 id="and the arm's part of the force"),
    pytest.param((-35.0, -50.23, -37.0), 2.741, 1.99, Slope("", "", 1.0194, 0.3, 2.7780, seed=88), id="likewise"),
]  # fmt: skip


@pytest.mark.parametrize(("tilts", "time", "deep", "scene"), STEEP)
def test_a_steep_object_that_tilts_slowly_keeps_the_laws(
    folder: Path, tilts: tuple[float, ...], time: float, deep: float, scene: Slope
) -> None:
    before, most, after = (f'<to pos="0 0 0 mm" rpy="0 {tilt} 0 deg" in=' for tilt in tilts)
    world = block(f'{before}"0.7 s"/>{most}"{time} s" hold="0.3 s"/>{after}"{time} s" hold="0.3 s"/>')
    motion = press(deep).replace('hold="1.5 s"', f'hold="{1.0 + 2.0 * time} s"')
    figures = judge(
        follow(dataclasses.replace(scene, world=world, motion=motion, probe='plate-angle="45 deg"').build(folder))
    )
    assert broken(figures) == []
    assert figures["step"] > 0.02  # there is a change of hands


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


def test_with_more_clearance_a_hand_that_falls_past_an_edge_is_stopped_by_no_trip(folder: Path) -> None:
    """It falls faster than the table moves, and presses too hard on a plate that waits 5 mm below it (K4)."""
    course = follow(dataclasses.replace(edge(5), probe='clearance="12 mm"').build(folder))
    assert course.pad.max() < 2.5
