"""A plate that should be felt and is not: it gives its force back to the arm, and that is told."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from program import program
from shipped import SCENES

from itouch.loop.surface import surface_memory as surface
from itouch.plugin import carried_surfaces
from itouch_encountered import surface_fields
from itouch_encountered.choosing import FAR_UNCALIBRATED, doubt, touches_unasked
from itouch_encountered.motion import Numbers
from itouch_evidence.surface.course import Course, follow
from itouch_evidence.surface.scenes import RADIUS, Slope, ramp


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("missing") / "scenes"
    shutil.copytree(SCENES, path)
    return path


@pytest.fixture(scope="module")
def low(folder: Path) -> Course:
    return follow(Slope(*ramp(0.0), error=3.0).build(folder))


def test_a_plate_that_is_too_low_gives_its_force_to_the_arm(low: Course) -> None:
    begin = int(np.flatnonzero(low.touching)[0])
    deep = np.flatnonzero(low.touching & (np.linalg.norm(low.virtual, axis=1) > 1.0))
    late = deep[deep > begin + 200]
    assert late.size > 100
    allowed = np.minimum(3.0, np.linalg.norm(low.virtual[late], axis=1))
    assert np.linalg.norm(low.total[late], axis=1) == pytest.approx(allowed, rel=0.02)
    assert low.steps[begin + 5 :][low.touching[begin + 5 :]].max() < 0.1


def test_a_missing_plate_is_noticed_once_and_marked_in_its_contact(low: Course) -> None:
    told = [notice for notice in low.report["notices"] if "should have been felt" in notice]
    assert len(told) == 1
    assert "'table'" in told[0]
    assert "touch-off" in told[0]
    assert [entry["plate_missed"] for entry in low.report["contacts"]] == [True]


def test_the_run_command_tells_a_missing_plate_once(folder: Path) -> None:
    Slope(*ramp(0.0), error=3.0).build(folder)
    ended = program("run", folder / "slope.xml", "--pace", "fast")
    assert ended.stderr.count("should have been felt") == 1
    assert "the arm gave its force" in ended.stdout


@pytest.mark.parametrize("touch_off", [False, True])
def test_nothing_is_told_of_a_plate_that_is_felt(folder: Path, touch_off: bool) -> None:
    slope = Slope(*ramp(0.0), error=3.0 if touch_off else 0.0, touch_off=touch_off)
    report = follow(slope.build(folder)).report
    assert not [notice for notice in report["notices"] if "should have been felt" in notice]
    assert [entry["plate_missed"] for entry in report["contacts"]] == [False]


@pytest.mark.parametrize("error", [-1.5, -3.0, -6.5, -11.0])
def test_a_plate_that_is_too_high_is_left_away_and_told(folder: Path, error: float) -> None:
    course = follow(Slope(*ramp(0.0), error=error, warm=True).build(folder))
    felt = np.flatnonzero(course.pad > 0.0)
    begin = int(np.flatnonzero(course.touching)[0])
    assert 0 < felt.size < 150
    assert felt[-1] < begin  # it is met too early, and is away before the virtual touch
    assert np.ptp(felt) == felt.size - 1  # once: it does not come back
    assert np.linalg.norm(course.total, axis=1).max() < 3.0
    assert not course.flux[course.touching].any()
    on = course.touching & (np.arange(len(course.time)) > begin + 20)
    assert np.linalg.norm(course.arm - course.virtual, axis=1)[on].max() < 0.02
    told = [notice for notice in course.report["notices"] if "should not have been" in notice]
    assert len(told) == 1
    assert "'table'" in told[0]
    assert "touch-off" in told[0]
    (contact,) = course.report["contacts"]
    assert (contact["plate"], contact["plate_missed"]) == (False, True)


@pytest.mark.parametrize("error", [2.0, 3.0])
def test_a_plate_that_is_too_low_and_was_late_is_missed_too(folder: Path, error: float) -> None:
    """It comes softly to a finger that was quicker, and stood still 2 mm deep in it by its height, for it may not press

    harder than 2 N: it was not at its goal, so nobody asked for its force.
    """
    world, _ = ramp(0.0)
    motion = (
        f'<to pos="0 0 25 mm" in="0.1 s" hold="0.2 s"/><to pos="0 0 {1.0 + RADIUS} mm" in="0.12 s" hold="0.8 s"/>'
        '<to pos="0 0 25 mm" in="0.3 s" hold="0.1 s"/>'
    )
    course = follow(Slope(world, motion, stiffness=0.5, error=error).build(folder))
    (begin,) = course.begins()
    late = course.touching & (course.time > course.time[begin] + 0.5)
    assert late.sum() > 200
    virtual, total = np.linalg.norm(course.virtual[late], axis=1), np.linalg.norm(course.total[late], axis=1)
    assert total == pytest.approx(np.minimum(3.0, virtual), rel=0.02)
    assert len([notice for notice in course.report["notices"] if "should have been felt" in notice]) == 1


@pytest.mark.parametrize(
    ("deep", "into"), [(0.5, 0.5), (0.95, 0.5), (2.5, 2.0)], ids=["half a millimetre", "lightly", "slowly"]
)
def test_a_light_touch_of_a_plate_that_is_too_low_is_missed_as_soon(folder: Path, deep: float, into: float) -> None:
    """Nobody felt anything: a light touch never was as deep in it as an error is large, and a slow one late."""
    world, _ = ramp(0.0)
    motion = (
        f'<to pos="0 0 25 mm" in="0.1 s" hold="0.1 s"/><to pos="0 0 {5.0 + RADIUS - deep} mm" in="{into} s" hold="1 s"/>'
        '<to pos="0 0 25 mm" in="0.4 s" hold="0.1 s"/>'
    )
    course = follow(Slope(world, motion, error=3.0).build(folder))
    (begin,) = course.begins()
    first = int(np.flatnonzero(np.linalg.norm(course.arm, axis=1) > 0.02)[0])
    assert course.time[first] - course.time[begin] < 0.1
    on = course.touching & (np.arange(len(course.time)) > first + 100) & (course.time < course.time[first] + 0.8)
    assert np.linalg.norm(course.total - course.virtual, axis=1)[on].max() < 0.02
    assert course.steps[begin + 5 :].max() < 0.1
    assert [entry["plate_missed"] for entry in course.report["contacts"]] == [True]
    assert len([notice for notice in course.report["notices"] if "should have been felt" in notice]) == 1


@pytest.mark.parametrize("error", [0.0, 0.3])
@pytest.mark.parametrize("deep", [0.45, 0.7])
def test_a_light_touch_of_a_plate_that_is_there_is_the_plates(folder: Path, deep: float, error: float) -> None:
    world, _ = ramp(0.0)
    motion = (
        f'<to pos="0 0 25 mm" in="0.1 s" hold="0.1 s"/><to pos="0 0 {5.0 + RADIUS - deep} mm" in="0.5 s" hold="1 s"/>'
        '<to pos="0 0 25 mm" in="0.4 s" hold="0.1 s"/>'
    )
    report = follow(Slope(world, motion, error=error).build(folder)).report
    assert [(entry["plate"], entry["plate_missed"]) for entry in report["contacts"]] == [(True, False)]


@pytest.mark.parametrize(
    ("stiffness", "depth", "told"), [(1e3, 0.5, True), (1e3, 0.3, False), (100.0, 0.45, False), (100.0, 0.9, False)]
)
def test_a_pad_that_is_soft_by_itself_is_no_plate_that_is_missing(stiffness: float, depth: float, told: bool) -> None:
    """It gives less than a sensor tells from nothing, where a stiffer one is felt for sure."""
    numbers = Numbers._make(np.zeros(len(Numbers._fields)))
    numbers = numbers._replace(period=1e-3, has_load=True, stiffness=stiffness)
    memory = np.zeros(len(surface_fields.FIELDS))
    memory[surface_fields.TAKES] = 1.0
    for _ in range(200):
        if memory[surface_fields.LOST] == 0.0:
            doubt(numbers, memory, depth * 1e-3, 0.04, True)
    assert memory[surface_fields.LOST] == (carried_surfaces.LOW if told else 0.0)


def hover(height: float, approach: float) -> tuple[str, str]:
    """Return a block, and a finger that comes so near to it [mm] in so many seconds, stays there, and leaves."""
    world, _ = ramp(0.0)
    return world, (
        f'<to pos="0 0 25 mm" in="0.1 s" hold="0.2 s"/><to pos="0 0 {5.0 + RADIUS + height} mm" in="{approach} s" '
        'hold="0.8 s"/><to pos="0 0 25 mm" in="0.3 s" hold="0.1 s"/>'
    )


@pytest.mark.parametrize(
    ("error", "height"), [(-0.5, 0.1), (-0.9, 0.1), (-0.9, 0.5), (-1.2, 0.9), (-1.6, 1.3), (-3.0, 2.7)]
)
@pytest.mark.parametrize("approach", [0.15, 0.4, 1.5])
def test_a_plate_that_is_too_high_leaves_a_finger_that_hovers(
    folder: Path, error: float, height: float, approach: float
) -> None:
    """It pressed with less than 0.1 N, or from less than 1 mm below, for as long as the finger stayed there."""
    course = follow(Slope(*hover(height, approach), error=error, warm=True).build(folder))
    felt = (course.pad > 0.05) & ~course.touching
    first = int(np.flatnonzero(felt)[0])
    assert felt.sum() < 150
    assert not (course.pad[first + 300 :] > 0.0).any()
    assert not course.flux[first + 300 :].any()
    told = [notice for notice in course.report["notices"] if "should not have been" in notice]
    assert len(told) == 1
    assert "touch-off" in told[0]


@pytest.mark.parametrize("approach", [0.15, 0.4, 1.5])
def test_a_plate_on_which_a_finger_rests_so_lightly_that_it_is_hardly_felt_leaves_too(
    folder: Path, approach: float
) -> None:
    """It pressed with less than 0.05 N, and took heat for as long as the finger stayed there: nobody was told."""
    course = follow(Slope(*hover(0.2, approach), error=-0.4, warm=True).build(folder))
    first = int(np.flatnonzero(course.pad > 0.02)[0])
    assert not (course.pad[first + 500 :] > 0.0).any()
    assert not course.flux[first + 500 :].any()
    told = [notice for notice in course.report["notices"] if "should not have been" in notice]
    assert len(told) == 1
    assert "heat" in told[0]


def test_a_tap_on_a_plate_that_is_too_high_is_noticed(folder: Path) -> None:
    """It lasted less than 30 ms and pressed with half a newton, at each approach anew."""
    course = follow(Slope(*hover(1.0, 0.15), error=-1.2).build(folder))
    assert not course.touching.any()
    assert 0.3 < course.pad.max() < 1.0
    assert ((course.pad > 0.05).sum()) < 40
    assert len([notice for notice in course.report["notices"] if "should not have been" in notice]) == 1


@pytest.mark.parametrize("height", [0.0, 0.2])
@pytest.mark.parametrize("error", [-0.2, 0.0, 0.5])
def test_a_plate_that_is_as_good_as_there_stays(folder: Path, error: float, height: float) -> None:
    report = follow(Slope(*hover(height, 0.4), error=error).build(folder)).report
    assert not [notice for notice in report["notices"] if "should" in notice]


def unasked(force: float, noise: float, gap: float = 0.6) -> float:
    """Return when a surface is said to be too high that presses so [N] on a finger above it [mm]; 60: not in a minute."""
    numbers = Numbers._make(np.zeros(len(Numbers._fields)))._replace(period=1e-3, has_load=True, stiffness=1e3)
    memory, rng = np.zeros(len(surface_fields.FIELDS)), np.random.default_rng(1)
    for tick in range(60_000):
        touches_unasked(numbers, memory, -gap * 1e-3, max(0.0, force + noise * rng.standard_normal()), False)
        if memory[surface_fields.LOST] > 0.0:
            assert memory[surface_fields.LOST] == carried_surfaces.HIGH
            return tick * 1e-3
    return 60.0


@pytest.mark.parametrize(("force", "noise", "within"), [(0.07, 0.0, 0.06), (0.07, 0.005, 0.07), (0.07, 0.02, 0.3)])
def test_a_small_force_is_noticed_through_the_noise_of_its_sensor(force: float, noise: float, within: float) -> None:
    assert unasked(force, noise) < within


@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1, 0.5])
def test_the_noise_of_a_force_sensor_is_no_finger(noise: float) -> None:
    assert unasked(0.0, noise) == 60.0


@pytest.mark.parametrize(
    ("gap", "force", "told"), [(5.0, 0.3, False), (5.0, 0.7, True), (2.0, 0.3, True), (16.0, 0.7, False)]
)
def test_what_an_axis_reads_in_the_air_is_no_finger(gap: float, force: float, told: bool) -> None:
    """Friction and its own mass stand in the force that a real axis reads; it hovers some mm below the finger."""
    numbers = Numbers._make(np.zeros(len(Numbers._fields)))
    numbers = numbers._replace(period=1e-3, has_load=True, early=FAR_UNCALIBRATED, stiffness=1e3)
    memory = np.zeros(len(surface_fields.FIELDS))
    for _ in range(1000):
        if memory[surface_fields.LOST] == 0.0:
            doubt(numbers, memory, -gap * 1e-3, force, False)
    assert memory[surface_fields.LOST] == (carried_surfaces.HIGH if told else 0.0)


def test_all_that_a_surface_remembers_has_a_place_in_state(folder: Path) -> None:
    """Compiled code does not look whether it writes beyond the end of a view."""
    session = Slope(*ramp(10.0)).build(folder)
    carry = next(step for step in session.plan.steps if step.name == "surface finger")
    lengths = {
        len(part)
        for bound in carry.bounds
        for argument in bound.arguments
        for part in (argument if isinstance(argument, tuple) else (argument,))
        if isinstance(part, np.ndarray) and np.shares_memory(part, session.state["finger.surface.renders"])
    }
    assert lengths == {surface.MEMORY}
