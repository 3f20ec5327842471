"""Where a contact goes over from plate to arm or back, the finger feels no step that the virtual contact has not."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kernels_in_python import kernel_of
from shipped import SCENES

from itouch import Session, build
from itouch.loop import render
from itouch.loop.surface import force, surface_memory
from itouch_encountered import motion
from itouch_evidence.surface import run
from itouch_evidence.surface.course import Course, Floats, follow
from itouch_evidence.surface.draw import draw
from itouch_evidence.surface.edges import edge, rim
from itouch_evidence.surface.laws import broken, judge
from itouch_evidence.surface.scenes import Slope, ball, ramp

_part, _within, _lead = map(kernel_of, (force._part, force._within, force._lead))

#: How many ticks apart the virtual force and what is felt may do the same.
APART = 3
#: A table goes down at 0.25 m/s: a finger that falls about as fast strikes its plate, whoever renders [m/s].
STRIKES, AROUND = 0.2, 0.05
#: The hardware of a table that measures no force.
NO_FORCE = 'tmcl="/dev/ttyACM0" motors="0 1 2" lead="20 20 10 mm" speed="0.3 m/s" acceleration="20 m/s^2"'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("changes") / "scenes"
    shutil.copytree(SCENES, path)
    return path


def excess(course: Course) -> Floats:
    """Return by how much the finger feels a greater step at a change than 0.1 N and than the virtual force's own [N]."""
    own = np.r_[0.0, np.linalg.norm(np.diff(course.virtual, axis=0), axis=1)]
    near = np.lib.stride_tricks.sliding_window_view(np.pad(own, APART), 2 * APART + 1).max(axis=1)
    period = course.time[1] - course.time[0]
    falls = np.flatnonzero(np.diff(course.lowest) < -STRIKES * period)
    on = course.changing() & ~course.after(falls.tolist(), AROUND)
    return np.where(on, course.steps - np.maximum(0.1, near), 0.0)


@pytest.mark.parametrize(
    ("make", "seed"),
    [
        pytest.param(edge, 50021, id="a plate that leaves goes with the finger from the first tick on"),
        pytest.param(edge, 50086, id="a plate that a finger left behind does not come after it"),
        pytest.param(rim, 50177, id="a plate that leaves follows no noise of a steep surface"),
        pytest.param(rim, 50221, id="nor on another rim"),
        pytest.param(rim, 50074, id="nor on a third"),
        pytest.param(edge, 50020, id="the limit of the plate's force does not jump"),
        pytest.param(edge, 50194, id="a plate that turns round"),
        pytest.param(edge, 50210, id="a plate that turns round on a slope"),
    ],
)
def test_a_contact_changes_hands_without_a_step(folder: Path, make: Callable[[int], Slope], seed: int) -> None:
    course = follow(make(seed).build(folder))
    assert course.changes()
    assert excess(course).max() <= 0.0
    assert np.linalg.norm(course.total, axis=1).max() <= course.force * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("seed", "number", "law"),
    [
        pytest.param(281128, 234, "step", id="a plate does not come on at a finger that turns before it is there"),
        pytest.param(5002, 213, "step", id="nor at one that slows down on its way up"),
        pytest.param(5004, 438, "arm", id="a plate that comes up to a slowing finger takes no force from the arm"),
        pytest.param(5002, 171, "step", id="a part of what a plate is read to give is noise"),
        pytest.param(5004, 304, "step", id="a plate that presses lightly may bounce"),
        pytest.param(5003, 48, "step", id="a plate that catches up with a falling surface takes no more than that"),
        pytest.param(5004, 121, "step", id="an arm that is alone catches up in small steps"),
        pytest.param(5004, 367, "step", id="what a plate leaves of the limit changes in steps"),
        pytest.param(112803, 158, "step", id="and by no more than the virtual force when its share grows"),
        pytest.param(6002, 53, "trip", id="a plate that is left behind goes past the finger slowly"),
        pytest.param(7003, 111, "heat", id="a plate that bounces after a contact is told"),
        pytest.param(7003, 41, "heat", id="until it is no longer felt at all"),
    ],
)
def test_a_random_scene_keeps_a_law_that_it_once_broke(folder: Path, seed: int, number: int, law: str) -> None:
    figures = run(number, seed, folder)["figures"]
    assert law in figures
    assert law not in broken(figures)


@pytest.mark.parametrize("number", [3, 18])
def test_a_plate_lands_softly_on_a_pad_whose_damping_acts_at_once(folder: Path, number: int) -> None:
    """It came as fast as to any other pad: the damping of 3.8 N s/m gave up to 0.13 N in the first tick."""
    _, scene = draw(number, 8181, folder)
    figures = judge(follow(dataclasses.replace(scene, pad=(2000, 3.8)).build(folder)))
    assert figures["step"] > 0.0
    assert not broken(figures)


@pytest.mark.parametrize("number", [56, 65])
def test_an_arm_at_its_limit_makes_room_for_a_plate_in_no_steps_of_its_reading(folder: Path, number: int) -> None:
    """Its velocity jumps with each step of 30 um, and with that what is left for the plate: 0.11 N with a stiff pad."""
    row = run(number, 301127, folder, kind="wide")
    assert row["changes"] > 0
    assert not broken(row["figures"])


def test_how_softly_a_plate_comes_depends_on_the_pad() -> None:
    assert motion.landing_speed(1000.0, 2.0) == motion.landing_speed(300.0, 0.0) == motion.SOFTLY
    assert motion.landing_speed(2000.0, 4.0) == pytest.approx(0.5 * motion.SOFTLY)


def back_on_top(folder: Path, before: str, after: str) -> Session:
    """Return a session of a finger that strokes down a ball and back to its top, where it stays for 2 s.

    ``after`` is in place of ``before`` in the text of its scene.
    """
    world, motion = ball([60.0, 5.0], 0.6)
    *parts, top, _ = motion.split("<to ")
    slope = Slope(world, "<to ".join((*parts, top.replace("/>", ' hold="2 s"/>'))), friction=0.3)
    text, path = slope.text(), folder / "back.xml"
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    return build(path, seed=0)


@pytest.mark.parametrize(("amplitude", "frequency"), [(0.3, 30), (1.0, 60)])
def test_a_plate_comes_to_a_finger_that_its_material_shakes(folder: Path, amplitude: float, frequency: int) -> None:
    """It waits for a finger that turns, but this one turns again and again: it never came."""
    shakes = f'<vibration amplitude="{amplitude} N" frequency="{frequency} Hz"/></material>'
    course = follow(back_on_top(folder, "    </material>", shakes))
    assert course.renders[-1]
    assert not course.settled[course.changes()[-1]]
    assert course.settled[-1]
    assert course.pad[-200:].mean() > 0.5


def test_a_plate_comes_as_soon_at_a_higher_rate(folder: Path) -> None:
    """The steps in which an arm reads are no finger that turns: at 4 kHz the plate waited for them, too."""
    late = []
    for rate in (1000, 4000):
        course = follow(back_on_top(folder, "<safety", f'<rates servo="{rate} Hz"/><safety'))
        assert course.settled[-1]
        late.append(course.late() / rate)
    assert late[0] > 0.2
    assert late[1] < 1.05 * late[0]


@pytest.mark.parametrize(
    ("number", "seed", "before", "after"),
    [
        pytest.param(80, 13, "", "", id="where a mesh is steep"),
        pytest.param(15, 13, "skin-temp", 'pad-stiffness="1.5 N/mm" skin-temp', id="under a stiff pad"),
        pytest.param(3, 15, 'travel="200 140 80 mm"', f'travel="200 140 80 mm" {NO_FORCE}', id="unfelt"),
    ],
)
def test_a_plate_that_pushes_a_finger_does_not_wait_for_it_to_come_back(
    folder: Path, number: int, seed: int, before: str, after: str
) -> None:
    """A finger that the plate itself pushed was taken for one that turns: the plate pressed, let go and pressed again.

    ``after`` is in place of ``before`` in the text of the scene.
    """
    _, slope = draw(number, seed, folder)
    text, path = slope.text(), folder / "pushed.xml"
    assert before in text
    path.write_text(text.replace(before, after) if before else text, encoding="utf-8")
    course = follow(build(path, seed=slope.seed))
    comes = (course.touching & course.renders & ~course.settled)[1:]
    pressed = np.convolve(course.pad, np.ones(15) / 15.0, "same")
    edges = np.flatnonzero(np.diff(np.r_[0, comes.astype(int), 0]))
    falls = [-np.minimum(0.0, np.diff(pressed)[begin:end]).sum() for begin, end in edges.reshape(-1, 2)]
    assert max(falls) < 0.6
    assert course.late() < 300


NOISY = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <devices>
    <device name="arm" plugin="usb-arm"/>
    <device name="table" plugin="xyz-table"><xyz-table:hardware force-noise="30 mN"/></device>
  </devices>
  <world><box name="block" size="60 60 20 mm" pos="0 0 -10 mm" material="wood"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger"><motion>
      <to pos="0 0 28 mm" in="0.5 s"/>
      <to pos="0 0 6.5 mm" in="0.3 s" hold="0.3 s"/>
      <to pos="0 0 20 mm" in="0.3 s" hold="0.3 s"/>
    </motion></operator>
  </interaction>
</itouch>"""


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_a_force_sensor_is_no_plate_that_bounces(tmp_path: Path, seed: int) -> None:
    (tmp_path / "noisy.xml").write_text(NOISY, encoding="utf-8")
    session = build(tmp_path / "noisy.xml", seed=seed)
    session.run()
    assert len(session.report()["contacts"]) == 1
    assert not [said for said in session.report()["notices"] if "still felt" in said]
    session.close()


@pytest.mark.parametrize("noise", [20, 40])
@pytest.mark.parametrize("degrees", [32.0, 45.0])
def test_an_arm_gives_no_noise_of_a_plate_that_is_away(folder: Path, degrees: float, noise: int) -> None:
    """What a plate 5 mm below the finger seemed to press was taken from the arm: up to 0.08 N."""
    text, path = Slope(*ramp(degrees, 2.0), stiffness=1.0).text(), folder / "noisy.xml"
    hardware = "<xyz-table:hardware"
    assert hardware in text
    path.write_text(text.replace(hardware, f'{hardware} force-noise="{noise} mN"'), encoding="utf-8")
    course = follow(build(path, seed=3))
    begin = int(np.flatnonzero(course.touching)[0])
    on = course.touching & (np.arange(len(course.time)) > begin + 50)
    assert on.sum() > 300
    assert not course.pad.any()
    assert np.linalg.norm(course.arm - course.virtual, axis=1)[on].max() < 1e-6


def test_a_plate_that_seems_away_counts_as_far_as_noise_does_not_explain_its_force() -> None:
    """Its height may be wrong by millimetres.  As it comes nearer it counts more, and nothing jumps."""
    pressing = kernel_of(force.pressing)
    readings = np.linspace(0.0, 1.0, 1001)
    for depth in (1.0, 0.0, -3e-4):
        assert [pressing(reading, depth) for reading in readings] == readings.tolist()
    for depth in (-5e-4, -1e-3, -2e-3, -5e-3):
        found = np.array([pressing(reading, depth) for reading in readings])
        nearer = np.array([pressing(reading, depth + 2e-4) for reading in readings])
        assert (np.diff(found) >= 0.0).all()
        assert np.diff(found).max() < 2.1e-3
        assert (nearer >= found).all()
        assert found[readings >= 2.0 * force.LOUD] == pytest.approx(readings[readings >= 2.0 * force.LOUD])
    assert pressing(0.12, -5e-3) == pressing(0.12, -2e-3) == surface_memory.NOTHING


def part(share: float, normal: float, pressed: float = 0.0, *, renders: bool = False) -> float:
    """Return the arm's share a tick after it was another, of a normal force [N] of which 2 N are allowed."""
    c, kept = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY)
    c[render.FORCE_LIMIT], c[render.HAS_TABLE], c[render.TABLE + 11] = 2.0, 1.0, 1.0
    figures = np.zeros(render.FIGURES)
    figures[render.NORMAL + 2] = 1.0
    kept[surface_memory.SHARE], kept[surface_memory.RENDERS] = share, float(renders)
    _part(c, figures, kept, normal, pressed, True)
    return float(kept[surface_memory.SHARE])


def test_the_share_of_an_arm_at_its_limit_changes_in_steps_of_what_it_may_give() -> None:
    """Not in steps of 20 N that it may not give: it would take over for a second."""
    assert part(0.5, 20.0) == pytest.approx(0.5 + force.HAND_STEP / 2.0)
    assert part(0.5, 1.5) == pytest.approx(0.5 + force.HAND_STEP / 1.5)


def test_the_share_of_an_arm_goes_on_from_what_the_plate_leaves_it() -> None:
    assert part(0.9, 1.0, 0.62, renders=True) == pytest.approx(0.4)
    assert part(0.9, 1.0, 0.0, renders=True) == pytest.approx(0.9 - force.HAND_STEP)
    assert part(0.9, 1.0, 0.62) == pytest.approx(0.9 + force.HAND_STEP)  # it is to take over all of it


@pytest.mark.parametrize(
    ("left", "before", "most"),
    [(0.5, 0.0, 0.5), (2.0, 0.0, 2.0), (-1.0, 0.0, 0.0), (9.0, 2.5, 0.5 + 2.0 * force.HAND_STEP)],
)  # fmt: skip
def test_an_arm_gives_what_a_plate_leaves_of_the_limit(left: float, before: float, most: float) -> None:
    """``before``: what it was cut by a tick ago [N]; the limit of 3 N comes back in small steps."""
    c, kept, given = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY), np.array([3.0, 4.0, 0.0])
    c[render.FORCE_LIMIT], kept[surface_memory.CUT] = 3.0, before
    _within(c, kept, given, left, np.inf, 0.0)
    assert given == pytest.approx([0.6 * most, 0.8 * most, 0.0])


def test_what_an_arm_is_cut_by_grows_in_steps_where_the_plates_force_is_a_guess() -> None:
    c, kept, given = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY), np.array([0.0, 0.0, 3.0])
    c[render.FORCE_LIMIT], kept[surface_memory.CUT] = 3.0, 0.5
    _within(c, kept, given, 1.0, force.HAND_STEP, 0.0)
    assert given[2] == pytest.approx(2.5 - force.HAND_STEP)
    _within(c, kept, given, 2.49, force.HAND_STEP, 0.0)
    assert kept[surface_memory.CUT] == pytest.approx(0.51)  # no farther than it must be


@pytest.mark.parametrize(("left", "cut"), [(2.05, 1.0), (2.3, 0.94), (2.1, 0.98), (1.98, 1.02)])
def test_an_arm_does_not_follow_what_a_plates_force_seems_to_do_between_two_readings(left: float, cut: float) -> None:
    """Cut by 1 N of 3, it stays so while a plate leaves little more; ``cut``: what it is cut by then [N]."""
    c, kept, given = np.zeros(render.CONSTANTS), np.zeros(surface_memory.MEMORY), np.array([0.0, 0.0, 3.0])
    c[render.FORCE_LIMIT], kept[surface_memory.CUT] = 3.0, 1.0
    _within(c, kept, given, left, force.HAND_STEP, force.PLAY)
    assert kept[surface_memory.CUT] == pytest.approx(cut)
    assert given[2] == pytest.approx(3.0 - cut)


@pytest.mark.parametrize(
    ("wanted", "rise", "most", "given"),
    [(1.5, 0.0, np.inf, 1.065), (1.5, 0.0, 0.035, 1.035), (0.5, 0.1, 0.035, 0.965), (1.5, -0.1, 0.035, 1.035),
     (1.02, 0.0, 0.035, 1.02)],
)  # fmt: skip
def test_an_arm_itself_changes_by_no_more_than_it_may(wanted: float, rise: float, most: float, given: float) -> None:
    """Whatever the plate's force is thought to have done in the tick: that may be what a reading corrected."""
    c, asked = np.zeros(render.CONSTANTS), np.array([0.0, 0.0, wanted])
    for frame in (render.ARM, render.TABLE):
        c[frame + 3 : frame + 12] = np.eye(3).ravel()
    led = _lead(c, np.array([0.0, 0.0, 1.0]), asked, rise, 0.065, most)
    assert asked[2] == pytest.approx(given)
    assert led is (given != wanted)


def test_a_force_along_any_axis_follows_from_the_one_sent_along_it() -> None:
    """What was sent is in the arm's frame, which may be turned."""
    c, sent, turn = np.zeros(render.CONSTANTS), np.array([0.3, -0.4, 1.2]), np.eye(3)[[1, 2, 0]]
    c[render.ARM + 3 : render.ARM + 12], c[render.TABLE + 3 : render.TABLE + 12] = turn.ravel(), np.eye(3).ravel()
    before, step = turn @ sent, 0.065
    asked = before + (0.5, -1.0, 2.0)
    assert _lead(c, sent, asked, 0.0, step, np.inf)
    assert asked == pytest.approx(before + np.array((0.5, -1.0, 2.0)) * step / np.sqrt(5.25))
    near = before + (0.01, -0.02, 0.03)
    assert not _lead(c, sent, near, 0.0, step, np.inf)
    assert near == pytest.approx(before + (0.01, -0.02, 0.03))
