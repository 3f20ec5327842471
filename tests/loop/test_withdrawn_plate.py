"""A plate that safety withdraws (T4) is not there any more: in State, in the report, for heat and in what is told."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import program
from shipped import SCENES

import itouch
from itouch_evidence.surface.course import Course, follow
from itouch_evidence.surface.scenes import RADIUS, Slope, ball, ramp

SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <include file="materials.xml"/>
  <include file="rigs/twin.xml"/>
  <world temperature="23 degC"><box name="sample" pos="0 0 6 mm" size="60 60 12 mm" material="pyrex"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC">
      <motion>
        <to pos="0 0 44 mm" in="0.5 s" hold="3 s"/>
        <to pos="0 0 16 mm" in="0.7 s" hold="4 s"/>
        <to pos="0 0 44 mm" in="0.5 s" hold="3 s"/>
        <to pos="0 0 16 mm" in="0.7 s" hold="0.5 s"/>
        <to pos="0 0 44 mm" in="0.5 s" hold="0.2 s"/>
      </motion>
    </operator>
    {heat}
  </interaction>
  <rates servo="1 kHz"/>
  <safety force="3 N" contact-time="1.5 s"/>
</itouch>"""
HEAT = """<thermal:heat probe="finger" contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>
    <thermal:flux-control display="peltier" desired-from="heat"/>"""


@pytest.fixture(scope="module", params=[HEAT, ""], ids=["heat", "force alone"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("withdrawn") / "scenes"
    shutil.copytree(SCENES, folder)
    path = folder / "long.xml"
    path.write_text(SCENE.format(heat=request.param))
    session = itouch.build(path)
    state, fields = session.state, ["finger.plate", "finger.surface.present", "table.surface.withdrawn",
                                    "finger.plate_force", "finger.total_force", "finger.plate_distance"]  # fmt: skip
    fields += ["flux-control.touching"] if request.param else []
    rows: list[list[float]] = []
    session.taps.append(lambda tick: rows.append([float(np.ravel(state[name])[0]) for name in fields]))
    session.run()
    columns = dict(zip(fields, np.array(rows).T, strict=True))
    return {"path": path, "report": session.report(), "columns": columns, "heat": bool(request.param)}


def test_a_plate_that_is_away_is_not_called_present(run: Mapping[str, Any]) -> None:
    columns = run["columns"]
    away = (columns["table.surface.withdrawn"] > 0.0) & (columns["finger.plate_distance"] > 1e-3)
    assert away.sum() > 1000
    for name in ("finger.plate", "finger.surface.present", *(["flux-control.touching"] if run["heat"] else [])):
        assert not columns[name][away].any(), name
    assert (columns["finger.total_force"][away][200:] > 0.5).any()  # the arm gives the rest of the contact


def test_the_force_goes_over_without_a_step(run: Mapping[str, Any]) -> None:
    begin = int(np.flatnonzero(run["columns"]["table.surface.withdrawn"])[0])
    force = run["columns"]["finger.total_force"][begin - 5 : begin + 300]
    assert np.abs(np.diff(force)).max() < 0.1
    assert force.max() < 3.0


def test_the_report_marks_the_withdrawn_plate(run: Mapping[str, Any]) -> None:
    long, short = run["report"]["contacts"]
    assert long["plate_withdrawn"] is True
    assert not long["plate_missed"]
    assert long["plate_s"] == pytest.approx(1.5, abs=0.05)
    assert long["end_s"] - long["begin_s"] > 3.5
    assert short["plate_withdrawn"] is False
    assert short["plate"]
    assert run["report"]["table"]["height_error_mm_max"] < 1.0
    if run["heat"]:
        assert long["flux_error_rms"] < 0.05  # of what the plate rendered, not of the time without it


def test_the_run_command_tells_the_withdrawn_plate(run: Mapping[str, Any]) -> None:
    ended = program("run", run["path"], "--pace", "fast", "--no-record")
    assert ended.stdout.count("the plate was withdrawn after 1.5 s") == 1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("leaving") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def pressed(deep: float, slide: float, moves: str = "", lasts: float = 1.5) -> tuple[str, str]:
    """Return a flat block, which may move, and a press of it that lasts [s], its target so deep [mm], at so many mm/s."""
    down = 5.0 + RADIUS - deep
    world = f'<box name="block" pos="0 0 0 mm" size="160 100 10 mm" material="stuff">{moves}</box>'
    return world, (
        f'<to pos="-40 0 25 mm" in="0.2 s"/><to pos="-40 0 {down} mm" in="0.4 s"/>'
        f'<to pos="{-40 + lasts * slide} 5 {down - 1} mm" in="{lasts} s"/><to pos="0 0 30 mm" in="0.4 s" hold="0.2 s"/>'
    )


def held(world: str, motion: str) -> tuple[str, str]:
    """Return a touch that lasts for longer."""
    return world, motion.replace('hold="0.4 s"', 'hold="1.5 s"')


def hold(course: Course, begin: int) -> None:
    """Assert what holds of a withdrawal that begins in a tick: no step, never too much, and the arm has it all in the end."""
    assert begin in course.changes()
    assert course.steps[course.changing()].max() <= 0.1
    assert np.linalg.norm(course.total, axis=1).max() <= course.force * (1.0 + 1e-9)
    away = course.touching & ~course.plate
    assert course.pad[away].max() == 0.0
    assert np.abs(course.flux[away]).max() == 0.0
    assert course.plate[begin : begin + 250].sum() < 150  # it does leave
    late = away & course.after([begin + 300], 0.5) & (course.share >= 0.999)
    size = np.linalg.norm(course.virtual, axis=1)
    allowed = course.virtual * np.minimum(1.0, course.force / np.maximum(size, 1e-9))[:, None]
    assert late.sum() > 200
    wrong = np.linalg.norm(course.arm - allowed, axis=1)[late]
    assert (wrong <= 0.02 * np.maximum(np.minimum(size, course.force)[late], 0.25)).all()


def withdrawals(course: Course) -> list[int]:
    """Return the ticks in which T4 takes the plate away in this course, by what it is said to render."""
    return [tick for tick in course.changes() if not course.renders[tick]]


@pytest.mark.parametrize("stiffness", [0.4, 1.2, 3.0])
@pytest.mark.parametrize(("deep", "slide", "friction"), [(3.0, 0.0, 0.0), (6.0, 30.0, 0.6), (12.0, 0.0, 0.3)])
def test_it_leaves_without_a_step_however_hard_it_is_pressed(
    folder: Path, stiffness: float, deep: float, slide: float, friction: float
) -> None:
    slope = Slope(*pressed(deep, slide), stiffness=stiffness, friction=friction, contact_time=1.0, warm=deep == 6.0)
    course = follow(slope.build(folder))
    (begin,) = withdrawals(course)
    hold(course, begin)


@pytest.mark.parametrize(
    "surface", [held(*ramp(20.0, 8.0)), ball([12.0, -12.0, 12.0], 0.7, deep=6.0)], ids=["ramp", "ball"]
)
@pytest.mark.parametrize("force", [1.2, 3.0])
def test_it_leaves_a_slope_and_a_ball_likewise(folder: Path, surface: tuple[str, str], force: float) -> None:
    course = follow(Slope(*surface, friction=0.4, force=force, contact_time=1.0).build(folder))
    hold(course, withdrawals(course)[0])


def test_it_leaves_a_session_that_was_restored_in_the_middle_likewise(folder: Path, tmp_path: Path) -> None:
    slope = Slope(*pressed(10.0, 30.0), stiffness=2.0, friction=0.4, contact_time=1.0)
    session = slope.build(folder)
    whole = follow(session)
    (begin,) = withdrawals(whole)
    before = slope.build(folder)
    first = follow(before, whole.time[begin + 20])
    before.save(tmp_path / "middle")
    rest = follow(itouch.restore(tmp_path / "middle"))
    assert np.array_equal(np.r_[first.total, rest.total], whole.total)


def test_a_plate_that_comes_back_to_a_deep_press_leads_the_force_until_it_is_there(folder: Path) -> None:
    """A block turns steep under the finger and back: what the arm still had to give back fell by 0.8 N at once."""
    turns = (
        '<motion><to pos="0 0 0 mm" in="1.2 s"/><to pos="0 0 0 mm" rpy="0 40 0 deg" in="0.5 s" hold="0.3 s"/>'
        '<to pos="0 0 0 mm" rpy="0 0 0 deg" in="0.5 s"/></motion>'
    )
    course = follow(Slope(*pressed(5.0, 0.0, turns, 2.0), stiffness=3.0).build(folder))
    back = next(tick for tick in course.changes() if course.renders[tick])
    assert course.share[back] > 0.5
    assert course.steps[back + 280 : back + 400].max() <= 0.1  # at first its own turning moves the plate
