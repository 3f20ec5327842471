"""Who renders a slope: the plate what it can, the arm the rest, and never both or neither at a change."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from shipped import SCENES

from itouch.loop.surface import plate
from itouch.session import build
from itouch_encountered.over_wire import LAG_FIRST
from itouch_evidence.surface.course import PLATE_FORCE, Course, Floats, follow
from itouch_evidence.surface.draw import Wire, draw, draw_wire
from itouch_evidence.surface.laws import broken, judge
from itouch_evidence.surface.meshes import KINDS, make
from itouch_evidence.surface.scenes import RADIUS, Slope, ball, ramp

LIMIT = 25.0
#: Above this a plate trips that slides past a finger (K5: 0.15 m/s) [mm/s].
FASTEST = 140.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("slopes") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def hold(course: Course) -> None:
    """Assert what holds on every surface: no force twice, none missing, none in steps, and the plate away or there."""
    away = course.touching & ~course.plate
    assert course.pad[away].max(initial=0.0) == 0.0
    assert np.abs(course.flux[away]).max(initial=0.0) == 0.0
    assert np.linalg.norm(course.total, axis=1).max() <= course.force * (1.0 + 1e-9)
    assert course.steps[course.changing()].max(initial=0.0) <= 0.1
    alone = away & (course.share >= 0.999) & ~course.after(course.changes(), 0.3)
    size = np.linalg.norm(course.virtual, axis=1)
    allowed = course.virtual * np.minimum(1.0, course.force / np.maximum(size, 1e-9))[:, None]
    wrong = np.linalg.norm(course.arm - allowed, axis=1)[alone]
    assert (wrong <= 0.02 * np.maximum(np.minimum(size, course.force)[alone], 0.25)).all()
    rigid, pad, there = course.rigid()
    off = np.abs(pad - rigid)[there] / np.maximum(rigid[there], 0.5)
    assert off.size < 100 or np.percentile(off, 95) <= 0.02
    assert course.late() <= 500
    aside = course.virtual - _along(course.virtual, course.normal)  # what the arm adds, as far as the limit allows
    there &= np.linalg.norm(aside, axis=1) + course.pad < course.force - 0.15
    extra = np.linalg.norm(course.arm - aside, axis=1)[there] / np.maximum(size[there], 0.5)
    assert extra.size < 100 or np.percentile(extra, 95) <= 0.02


def _along(force: Floats, normal: Floats) -> Floats:
    """Return the part of forces (n, 3) along normals (n, 3)."""
    return np.sum(force * normal, axis=1)[:, None] * normal


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


@pytest.mark.parametrize("degrees", [0.0, 10.0, 20.0, 24.0])
def test_a_plate_presses_as_a_rigid_surface_at_that_height_would(folder: Path, degrees: float) -> None:
    course = follow(Slope(*ramp(degrees)).build(folder))
    rigid, pad, there = course.rigid()
    assert there.sum() > 300
    assert rigid[there].max() > 0.8
    assert (np.abs(pad - rigid) <= 0.02 * np.maximum(rigid, 0.5))[there].all()


@pytest.mark.parametrize("each", [0.15, 0.5])
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_stroke_over_a_ball_changes_hands_without_a_step(folder: Path, each: float, friction: float) -> None:
    course = follow(Slope(*ball([20, 40, 60, 40, 20, 0, -40, 0], each), friction=friction).build(folder))
    assert len(course.changes()) == 4
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


def thin(kind: str, folder: Path) -> str:
    """Return a world whose top is 10 mm high in the middle: how thick it is, and what is below, nobody feels."""
    if kind == "mesh":
        trimesh.creation.box((60.0, 60.0, 4.0)).export(folder / "meshes" / "thin.stl")
        return '<mesh name="thing" file="meshes/thin.stl" pos="0 0 8 mm" material="stuff"/>'
    if kind == "prism":  # its ridge is above x = 0
        corners = [(x, y, z) for y in (-30.0, 30.0) for x, z in ((-25.0, 0.0), (25.0, 0.0), (0.0, 10.0))]
        prism = trimesh.convex.convex_hull(np.array(corners))
        prism.export(folder / "meshes" / "prism.stl")
        return '<mesh name="thing" file="meshes/prism.stl" pos="0 0 0 mm" material="stuff"/>'
    thick, tilt = (80.0, 0.0) if kind == "thick" else (4.0, 20.0 if kind == "tilted" else 0.0)
    world = (
        f'<box name="thing" pos="0 0 {10.0 - thick / 2} mm" rpy="0 {tilt} 0 deg" size="60 60 {thick} mm" '
        'material="stuff"/>'
    )
    return world + '<box name="lower" pos="0 0 -10 mm" size="90 90 4 mm" material="stuff"/>' * (kind == "shelves")


def test_where_nothing_is_below_a_finger_that_touches_the_arm_renders(folder: Path) -> None:
    """A finger came round the rim to the back of a sheet: no plate was near it, but one was said to render that."""
    corners = [[-20, 0, 10], [20, 0, 10], [20, 20, 10], [-20, 20, 10], [-20, 0, 0], [20, 0, 0]]
    faces = [[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]]  # a sheet whose front is below, and a wall under its edge
    trimesh.Trimesh(corners, faces, process=False).export(folder / "meshes/rim.stl")
    world = '<mesh name="thing" file="meshes/rim.stl" pos="0 0 0 mm" sides="one" material="stuff"/>'
    motion = (
        '<to pos="0 14 30 mm" in="0.1 s" hold="0.1 s"/><to pos="0 14 13 mm" in="0.4 s" hold="0.1 s"/>'
        '<to pos="0 -1 14 mm" in="0.5 s" hold="0.4 s"/><to pos="0 -1 35 mm" in="0.4 s"/>'
    )
    course = follow(Slope(world, motion).build(folder))
    bare = course.touching & (course.normal[:, 2] > 0.95) & (course.depth == -np.inf)
    assert bare.sum() > 100 and course.pad.max() == 0.0
    assert not (course.plate | course.renders)[bare].any()
    assert broken(judge(course)) == []


@pytest.mark.parametrize("deep", [20.0, 40.0])
@pytest.mark.parametrize(("kind", "friction"), [
    ("thin", 0.0), ("thin", 0.6), ("thick", 0.0), ("mesh", 0.0), ("shelves", 0.3), ("tilted", 0.0), ("prism", 0.6),
])  # fmt: skip
def test_a_hand_that_presses_through_an_object_feels_its_top(
    folder: Path, kind: str, friction: float, deep: float
) -> None:
    """The plate stays at its own limit, the arm adds what the scene's leaves, and nothing changes hands."""
    motion = (
        f'<to pos="0 0 30 mm" in="0.1 s" hold="0.2 s"/><to pos="0 0 {18.0 - deep} mm" in="1 s" hold="0.4 s"/>'
        '<to pos="0 0 30 mm" in="1 s" hold="0.1 s"/>'
    )
    course = follow(Slope(thin(kind, folder), motion, friction=friction).build(folder))
    height = (course.depth + course.lowest)[course.touching]
    rise = np.tan(np.radians(20.0 if kind == "tilted" else 22.0 if kind == "prism" else 0.0))
    assert np.abs(np.diff(height)).max() <= 1e-4 * rise + 1e-6  # as far as the finger goes aside in a tick
    assert not course.changes()
    assert len(course.begins()) == 1
    assert course.plate[course.touching][20:-20].all()
    held = course.touching & (course.time > 1.45) & (course.time < 1.65)
    assert held.sum() > 150
    assert course.pad[held].min() > 1.8
    assert course.pad.max() < PLATE_FORCE + 0.1
    total = np.linalg.norm(course.total, axis=1)
    assert total.max() <= course.force
    assert total[held].min() > 2.7
    own = np.r_[0.0, np.linalg.norm(np.diff(course.virtual, axis=0), axis=1)]
    after = course.touching & ~course.after(course.begins(), 0.05)
    assert (course.steps <= np.maximum(0.1, own + 0.03))[after].all()


LAW = {"deadline": None, "phases": (Phase.explicit, Phase.generate), "suppress_health_check": list(HealthCheck)}


@settings(max_examples=8, derandomize=True, **LAW)
@given(
    angles=st.lists(st.floats(-70.0, 70.0), min_size=3, max_size=5), each=st.floats(0.15, 1.2),
    friction=st.sampled_from([0.0, 0.3, 0.8]), stiffness=st.floats(0.4, 1.5), radius=st.floats(20.0, 45.0),
    force=st.floats(1.0, 3.0), seed=st.integers(0, 99),
)  # fmt: skip
def test_no_stroke_over_a_ball_breaks_the_law(
    folder: Path, angles: list[float], each: float, friction: float, stiffness: float, radius: float, force: float,
    seed: int,
) -> None:  # fmt: skip
    longest = np.radians(np.abs(np.diff([0.0, *angles])).max()) * (radius + RADIUS)
    each = max(each, 1.875 * longest / FASTEST)
    world, motion = ball(angles, each, radius)
    hold(follow(Slope(world, motion, stiffness=stiffness, friction=friction, force=force, seed=seed).build(folder)))


def test_short_quick_strokes_over_a_large_ball(folder: Path) -> None:
    """A plate that goes down a slope goes with the finger: no limit may stop it there; and coming back, it arrives."""
    angles, radius = [11.269709516082145, 34.08813692861966, 11.608022855588686, 1.9, 8.682500781701194], 45.0
    longest = np.radians(np.abs(np.diff([0.0, *angles])).max()) * (radius + RADIUS)
    world, motion = ball(angles, max(0.32840858326098477, 1.875 * longest / FASTEST), radius)
    slope = Slope(world, motion, stiffness=1.2679233512035195, friction=0.3, force=1.5689173501810627, seed=42)
    hold(follow(slope.build(folder)))


@pytest.mark.long
@settings(max_examples=60, **LAW)
@example(  # a finger that lifts quickly: the virtual force falls by 0.2 N a tick before the plate takes over
    steps=[-22.88059849900338, 22.943745447107247, -22.88059849900338, -9.250247015586545, -22.88059849900338, -7.4445],
    deep=5.146403593918214, speed=59.951667392727934, radius=84.36214217014874, friction=0.8, stiffness=1.0,
    force=2.2723019188525466, seed=60,
)  # fmt: skip
@given(
    steps=st.lists(st.floats(-35.0, 35.0), min_size=3, max_size=6), deep=st.floats(2.0, 6.0),
    speed=st.floats(10.0, 120.0), radius=st.floats(5.0, 100.0), friction=st.sampled_from([0.0, 0.3, 0.8]),
    stiffness=st.floats(0.4, 1.5), force=st.floats(1.0, 3.0), seed=st.integers(0, 99),
)  # fmt: skip
def test_no_ball_however_large_and_no_speed_breaks_the_law(
    folder: Path, steps: list[float], deep: float, speed: float, radius: float, friction: float, stiffness: float,
    force: float, seed: int,
) -> None:  # fmt: skip
    angles = np.clip(np.cumsum(steps), -70.0, 70.0).tolist()
    longest = np.radians(np.abs(np.diff([0.0, *angles])).max()) * (radius + RADIUS)
    each = min(max(0.1, 1.875 * longest / speed), 8.0 / len(angles))  # a plate withdraws after 10 s (T4)
    each = max(each, 1.875 * longest / FASTEST)
    world, motion = ball(angles, each, radius, deep)
    hold(follow(Slope(world, motion, stiffness=stiffness, friction=friction, force=force, seed=seed).build(folder)))


@settings(max_examples=8, derandomize=True, **LAW)
@given(
    kind=st.sampled_from(KINDS), shape=st.integers(0, 10**6), speed=st.floats(20.0, 60.0),
    friction=st.sampled_from([0.0, 0.3, 0.8]), stiffness=st.floats(0.4, 1.5), force=st.floats(1.0, 3.0),
)  # fmt: skip
def test_no_stroke_over_a_mesh_that_nobody_has_seen_breaks_the_law(
    folder: Path, kind: str, shape: int, speed: float, friction: float, stiffness: float, force: float
) -> None:
    hold(
        follow(
            make(folder, kind, shape, speed=speed, friction=friction, stiffness=stiffness, force=force).build(folder)
        )
    )


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
    assert np.linalg.norm(course.total, axis=1).max() <= force * (1.0 + 1e-9)


@pytest.mark.parametrize(("mounted", "steep"), [(10.0, 10.0), (20.0, 20.0), (-15.0, -15.0)])
def test_a_plate_that_is_mounted_at_an_angle_is_where_the_surface_is(
    folder: Path, mounted: float, steep: float
) -> None:
    """All turned by one angle, finger and hand feel the same: a ball rests on such a plate beside the point below it."""
    felt, level = [], '<mount pos="0 0 -30 mm"'
    for table, slope in ((0.0, 0.0), (mounted, steep)):
        text = Slope(*ramp(slope)).text()
        assert level in text
        (folder / "turned.xml").write_text(text.replace(level, f'{level} rpy="0 {table} 0 deg"'), encoding="utf-8")
        session = build(folder / "turned.xml")
        session.run(0.85)
        felt.append(-session.state["table.wrench"][2].item())
        session.run()
        (contact,) = session.report()["contacts"]
        assert contact["plate"]
        assert not contact["plate_missed"]
        assert session.report()["table"]["height_error_mm_max"] < 0.1
    assert felt[0] > 1.0
    assert felt[1] == pytest.approx(felt[0], rel=5e-3)


#: What a table's wire may be: the time between two exchanges, and what one takes [s].
WIRES = [Wire(0.008, 0.004), Wire(0.008, 0.008), Wire(0.010, 0.005)]


def test_a_plate_whose_readings_come_every_8_ms_follows_a_ball_as_well(folder: Path) -> None:
    """From the first touch on: between two readings it seems to stand, and then to jump, and both are old."""
    slope = Slope(*ball([12.0, -12.0, 12.0, -12.0], 0.25))
    course = follow(slope.build(folder, catalog=Wire(0.008, 0.004).catalog()))
    rigid = 1e3 * course.depth
    on = course.touching & course.renders & course.settled & (rigid > 0.3)
    assert on.sum() > 1500  # it is there as the finger comes
    off = course.pad[on] / rigid[on] - 1.0
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.parametrize("wire", WIRES, ids=str)
@pytest.mark.parametrize(("world", "motion"), [
    pytest.param(*ramp(20.0), id="a ramp"), pytest.param(*ball([12.0, -12.0, 12.0, -12.0], 0.25), id="quick strokes"),
])  # fmt: skip
def test_behind_a_wire_the_force_is_that_of_the_surface(folder: Path, world: str, motion: str, wire: Wire) -> None:
    """A command that acts late is where the surface will be by then, and so is what is learned of old readings."""
    course = follow(Slope(world, motion).build(folder, catalog=wire.catalog()))
    figures = judge(course, wired=True)
    assert figures["plate"] <= 2.0
    assert not broken(figures)


def test_what_a_sensor_reads_of_a_plate_that_is_away_takes_nothing_from_the_arm(folder: Path) -> None:
    """The noise of one reading, and how far the plate came since, were 1.5 N of a plate that was 10 mm away."""
    slope = Slope(*ball([12.0, -12.0, 12.0], 0.25))
    course = follow(slope.build(folder, catalog=Wire(0.010, 0.010).catalog()))
    assert (course.touching & (course.pad == 0.0)).sum() > 200  # it is not there in time
    assert np.linalg.norm(np.diff(course.arm, axis=0), axis=1).max() < 0.2  # that of the first touch


def test_behind_a_wire_a_session_goes_on_from_its_state_alone(folder: Path) -> None:
    """Where the finger goes, how late the wire is and what was learned of it: all of that is State."""
    slope, wire = Slope(*ball([12.0, -12.0], 0.25)), Wire(0.007, 0.003)
    first = slope.build(folder, catalog=wire.catalog())
    first.run(1.173)
    lag, stored = first.state["finger.surface.lag"].item(), first.state.tobytes()
    assert lag != LAG_FIRST  # something was learned
    second = slope.build(folder, catalog=wire.catalog())
    second.run(0.2)
    second.adopt(stored)
    for _ in range(400):
        first.tick()
        second.tick()
        assert second.state.tobytes() == first.state.tobytes()


def test_behind_a_wire_an_arm_goes_on_from_state_alone_while_the_plate_comes(folder: Path) -> None:
    """How fast the plate rises by its readings decides what the arm may give: that is State, too."""
    _, scene = draw(101, 5, folder)
    catalog = draw_wire(101, 5).catalog()
    first, second = scene.build(folder, catalog=catalog), scene.build(folder, catalog=catalog)
    first.run(1.206)
    assert first.state["finger.rising.by_readings"].item() > 0.01  # it comes
    second.run(0.2)
    second.adopt(first.state.tobytes())
    for _ in range(60):
        first.tick()
        second.tick()
        assert second.state.tobytes() == first.state.tobytes()
    first.close()
    second.close()


def test_a_plate_rises_as_its_readings_say() -> None:
    """A reading comes in every fourth tick; in that tick the plate's height jumps by what it corrects."""
    kept, found = np.zeros(4), []
    for measured, top, moved in (
        (8, 0.030, 0.0), (8, 0.030, 2e-5), (8, 0.030, 2e-5), (8, 0.030, 2e-5),
        (12, 0.0304, 5e-4), (12, 0.0304, 5e-5), (12, 0.0304, 5e-5), (12, 0.0304, 1.5e-4),
        (16, 0.0302, -4e-4), (17, 0.0303, 1e-4),
    ):  # fmt: skip
        found.append(plate.rises(kept, measured, top, moved, 1e-3))
    assert found[:4] == pytest.approx([0.0, 0.02, 0.02, 0.02])  # of one reading alone, nothing is known
    assert found[4:8] == pytest.approx([0.1, 0.1, 0.1, 0.15])  # not 0.5 m/s, by which it is corrected
    assert found[8] == pytest.approx(0.15)  # it goes down by its readings; by what was said it came: that counts
    assert found[9] == pytest.approx(0.1)  # one tick after the other: what was said before counts no more
