"""Objects that move by a script or with a device: where they are, how fast, what is felt, and what is refused."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.contact.object_motion import PIECE_WIDTH, SCRIPT_WIDTH, carry, move_scripted
from itouch.loop.rigid_transforms import frame, quaternion
from itouch.plugin import Contact, poses
from itouch.schema import SceneError
from itouch.world.motion_tables import read_motion

Write = Callable[[str, str], Path]
MOVING = SCENES / "moving.xml"

SCENE = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="1 N/mm" static-friction="0.8" dynamic-friction="0.6"/></material></materials>
  <world>{objects}</world>
  <devices><device name="arm" plugin="usb-arm"/>{devices}</devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="0 0 16 mm" in="0.1 s" hold="{hold}"/></motion></operator>
    {others}
  </interaction>
</itouch>"""


def build(write: Write, objects: str, *, hold: str = "1 s", devices: str = "", others: str = "") -> itouch.Session:
    return itouch.build(write("s.xml", SCENE.format(objects=objects, hold=hold, devices=devices, others=others)))


def box(inside: str, attributes: str = "") -> str:
    return f'<box name="block" size="60 60 20 mm" pos="0 0 0 mm" material="m"{attributes}>{inside}</box>'


def test_a_script_takes_an_object_along_and_its_twist_is_the_derivative(write: Write) -> None:
    engine = build(
        write,
        box(
            '<motion><to pos="20 0 5 mm" rpy="0 0 90 deg" in="0.4 s" hold="0.2 s"/><to pos="0 0 0" in="0.2 s"/></motion>'
        ),
    )
    rows, twists = [], []

    def note() -> None:
        rows.append(np.array(engine.state["objects.pose"][0]))
        twists.append(np.array(engine.state["objects.twist"][0]))

    engine.run(0.9, each=note)
    path, rate = np.array(rows), np.array(twists)
    np.testing.assert_allclose(path[450, :3], [0.02, 0, 0.005], atol=1e-12)
    np.testing.assert_allclose(path[450, 3:], poses.quaternion_from_rpy((0, 0, np.pi / 2)), atol=1e-12)
    np.testing.assert_allclose(path[-1, :3], 0, atol=1e-12)
    np.testing.assert_allclose(path[-1, 3:], path[450, 3:], atol=1e-12)
    np.testing.assert_allclose(rate[1:-1, :3], (path[2:, :3] - path[:-2, :3]) / 2e-3, atol=2e-4)
    spin = [
        2 * poses.multiply((b - a) / 2e-3, poses.conjugate(m))[3]
        for a, m, b in zip(path[:-2, 3:], path[1:-1, 3:], path[2:, 3:], strict=True)
    ]
    np.testing.assert_allclose(rate[1:-1, 5], spin, atol=2e-2)
    assert np.abs(rate[:, 5]).max() == pytest.approx(1.875 * (np.pi / 2) / 0.4, rel=1e-3)


def test_the_scene_of_moving_things_drags_and_lifts_the_finger() -> None:
    engine = itouch.build(MOVING)
    kinds, highest, aside = [], 0.0, 0.0

    def note() -> None:
        nonlocal highest, aside
        if engine.state["finger.object"] == 0:
            aside = max(aside, float(engine.state["finger.hip"][1]))
        if engine.state["finger.object"] == 1:
            highest = max(highest, float(engine.state["finger.proxy"][2]))

    engine.run(each=note)
    assert engine.done
    assert aside > 1e-3  # the turntable takes the finger along
    assert highest == pytest.approx(0.006 + 0.008, abs=2e-4)  # the piston lifts it
    for row in engine.state["events.table"][: int(engine.state["events.count"])]:
        kinds.append(Contact(int(row["kind"])))
    assert kinds.count(Contact.BEGIN) == kinds.count(Contact.END) == 2


@pytest.mark.parametrize("stop", [300, 777, 2900])
def test_moving_things_go_on_after_a_restore_to_the_same_bytes(tmp_path: Path, stop: int) -> None:
    straight = itouch.build(MOVING)
    straight.run((stop + 250) * 1e-3)
    broken = itouch.build(MOVING)
    broken.run(stop * 1e-3)
    broken.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(0.25)
    assert again.state.tobytes() == straight.state.tobytes()


def test_events_tell_the_speed_relative_to_the_surface(write: Write) -> None:
    rising = box('<motion><to pos="0 0 0 mm" in="0.2 s"/><to pos="0 0 8 mm" in="0.4 s" hold="0.4 s"/></motion>')
    engine = build(
        write,
        rising.replace('pos="0 0 0 mm" material', 'pos="0 0 -10 mm" material').replace(
            '"0 0 0 mm" in', '"0 0 -10 mm" in'
        ),
    )
    engine.run(1.0)
    begin = next(row for row in engine.state["events.table"] if row["kind"] == Contact.BEGIN and row["tick"] > 0)
    twist = begin["speed"]
    assert twist > 0.02  # the finger waits, the surface comes
    near = next(row for row in engine.state["events.table"] if row["kind"] == Contact.NEAR)
    assert near["distance"] > 0.0


def test_a_still_finger_on_a_sliding_table_feels_its_friction(write: Write) -> None:
    engine = build(write, box('<motion><to pos="0 0 0 mm" in="0.3 s"/><to pos="20 0 0 mm" in="0.5 s"/></motion>'))
    forces: list[float] = []
    pushes: list[float] = []

    def note() -> None:
        forces.append(float(engine.state["finger.force"][0]))
        pushes.append(float(engine.state["finger.normal_force"]))

    engine.run(0.75, each=note)
    assert max(forces) == pytest.approx(0.6 * pushes[int(np.argmax(forces))], rel=0.4)
    assert max(forces) > 0.25


ARM = '<device name="hand" plugin="usb-arm"><mount pos="0 0 10 mm" rpy="0 0 90 deg"/></device>'
OTHER = """<probe name="other" radius="1 mm" pose-from="hand" force-to="hand"/>
    <operator probe="other"><motion><to pos="40 0 -20 mm" in="0.1 s"/><to pos="40 0 0 mm" in="0.5 s"/></motion></operator>"""


def test_a_device_carries_an_object(write: Write) -> None:
    plate = '<box name="plate" size="60 60 4 mm" pos="-40 0 6 mm" material="m" pose-from="hand"/>'
    engine = build(write, plate, devices=ARM, others=OTHER)
    rows: list[np.ndarray] = []
    engine.run(
        0.62,
        each=lambda: rows.append(
            np.concatenate(
                [engine.state["objects.pose"][0], engine.state["objects.twist"][0], engine.state["other.hip"]]
            )
        ),
    )
    path = np.array(rows)
    # the device's frame is turned by 90 degrees about z, so its x axis points along the world's y
    np.testing.assert_allclose(path[:, :3], path[:, 13:16] + [0, -0.04, 0.006], atol=1e-9)
    np.testing.assert_allclose(path[-1, 3:7], poses.quaternion_from_rpy((0, 0, np.pi / 2)), atol=1e-9)
    middle = path[200:550]
    velocity = np.gradient(middle[:, 2], 1e-3)
    assert np.abs(middle[:, 9] - velocity).max() < 0.4 * np.abs(velocity).max()


def test_carry_finds_the_twist_of_a_turning_device() -> None:
    place, twist = np.zeros((1, 7)), np.zeros((1, 6))
    place[0, 3] = 1.0
    offset, world = np.array([0.1, 0, 0, 1.0, 0, 0, 0]), np.array([1.0, 2, 3, 1, 0, 0, 0])
    for k in range(200):
        reading = np.array([0.01 * k * 1e-3, 0, 0, *poses.quaternion_from_rpy((0, 0, 3.0 * k * 1e-3))])
        carry(0, world, reading, offset, 1e-3, 0.4, k == 0, place, twist)
    np.testing.assert_allclose(twist[0, 3:], [0, 0, 3.0], atol=1e-6)
    turn = 3.0 * 0.199
    np.testing.assert_allclose(twist[0, :3], [0.01 - 0.3 * np.sin(turn), 0.3 * np.cos(turn), 0], atol=2e-3)
    before = place.copy()
    carry(0, world, np.zeros(7), offset, 1e-3, 0.4, False, place, twist)
    carry(0, world, np.full(7, np.nan), offset, 1e-3, 0.4, False, place, twist)
    np.testing.assert_array_equal(place, before)


def test_a_matrix_becomes_the_quaternion_it_came_from() -> None:
    rng = np.random.default_rng(4)
    for q in [*rng.normal(size=(50, 4)), *np.eye(4)]:
        q = q / np.linalg.norm(q)
        found = np.array(quaternion(frame((0, 0, 0, *q)).r))
        assert abs(found @ q) == pytest.approx(1.0, abs=1e-12)


def test_a_script_of_many_pieces_is_found_by_halving() -> None:
    times = np.sort(np.random.default_rng(2).uniform(0, 5, 300))
    pieces = np.zeros((299, PIECE_WIDTH))
    pieces[:, 0], pieces[:, 1] = times[:-1], np.diff(times)
    pieces[:, 3], pieces[:, 6], pieces[:, 9] = times[:-1], np.diff(times), 1.0
    scripts = np.array([[0.0, 0, 299, times[-1], 0.0]])
    assert scripts.shape[1] == SCRIPT_WIDTH
    for time in np.random.default_rng(3).uniform(times[0], times[-1], 200):
        place, twist = np.zeros((1, 7)), np.zeros((1, 6))
        move_scripted(scripts, pieces, time, place, twist)
        assert place[0, 0] == pytest.approx(time, abs=1e-12)
        assert twist[0, 0] == pytest.approx(1.0)


def test_a_motion_from_a_file(write: Write, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("t,x,y,z\n10,0,0,0\n10.2,0,0,0\n10.4,0.02,0,0\n")
    engine = build(write, box('<motion file="m.csv"/>'))
    engine.run(0.302)
    np.testing.assert_allclose(engine.state["objects.pose"][0], [0.01, 0, 0, 1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(engine.state["objects.twist"][0], [0.1, 0, 0, 0, 0, 0], atol=1e-9)
    engine.save(tmp_path / "s.itouch")
    (tmp_path / "m.csv").unlink()
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(0.05)
    np.testing.assert_allclose(again.state["objects.pose"][0, 0], 0.015, atol=1e-9)


def test_a_table_that_repeats_goes_on_at_its_speed(write: Write, tmp_path: Path) -> None:
    """At 3.63 s, what is left after eleven rounds of 0.33 s is a little below 0 in floating point."""
    directions = np.repeat(np.exp(2j * np.pi * (np.arange(3) / 3 + 0.1)), 11)  # once round a triangle, at 0.1 m/s
    places = 1e-3 * np.concatenate([[0.0], np.cumsum(directions)])
    rows = [f"{0.01 * k:.2f},{at.real:.9f},{at.imag:.9f},0" for k, at in enumerate(places)]
    (tmp_path / "m.csv").write_text("\n".join(["t,x,y,z", *rows]))
    engine = build(write, box('<motion file="m.csv" repeat="yes"/>'))
    engine.run(3.6)
    speeds: list[float] = []
    engine.run(0.06, each=lambda: speeds.append(float(np.linalg.norm(engine.state["objects.twist"][0, :2]))))
    np.testing.assert_allclose(speeds, 0.1, rtol=1e-4)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,x,y,z\n0,0,0,0\n", "shape"),
        ("0,0,0,0\n0,0,0,0\n", "does not rise"),
        ("0,0,0\n1,0,0\n", "4 columns"),
        ("0;0;0;0\n1;0;0;0\n", "no column named t, x, y, z; it has 0;0;0;0"),
        ("t [s],x [inch],y,z\n0,0,0,0\n1,0,0,0\n", "unit of column"),
        ("0,0,0,0\n1_0,0,0,0\n", "row 2 is not 4 numbers"),
        ("0,0,0,0\n1,0,150,0\n", "row 2 lies farther than 100 m"),
        ("-1e308,0,0,0\n1e308,0,0,0\n", "row 2 holds"),
        ("0," + "1" * 200_000 + ",0,0\n", "not a table"),
        ("0,0,0,0\n1,0,0,x\n", "row 2"),
        ("0,0,0,0\n1,0,0,nan\n", "finite"),
        ("0,0,0,0,0,0,0,0\n1,0,0,0,1,0,0,0\n", "zero"),
        ("\xff\xfe", "no column named"),
    ],
)
def test_tables_that_are_none_are_refused(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        read_motion(text.encode())


@pytest.mark.parametrize(
    "text",
    [
        "time [ms],z [mm],y [mm],x [mm]\n0,3,2,1\n500,6,4,2\n",
        "x,y,z,t,felt\n0.001,0.002,0.003,4,soft\n0.002,0.004,0.006,4.5,hard\n",
        "# a lid\r0,0.001,0.002,0.003\r0.5,0.002,0.004,0.006\r",
    ],
)
def test_a_table_says_what_its_columns_are_and_in_which_units(text: str) -> None:
    np.testing.assert_allclose(read_motion(text.encode()), [(0, 1e-3, 2e-3, 3e-3), (0.5, 2e-3, 4e-3, 6e-3)])


@pytest.mark.parametrize("kind", ["c16", "?", "M8[s]", "U3"])
def test_an_array_of_anything_but_real_numbers_is_no_motion(kind: str) -> None:
    file = io.BytesIO()
    np.save(file, np.zeros((2, 4), kind))
    with pytest.raises(ValueError, match="it must hold real numbers"):
        read_motion(file.getvalue())


BAD = {
    box("<motion/>"): "one-of",
    box('<motion file="none.csv"/>'): "no-such-file",
    box('<motion file="s.xml"/>'): "motion",
    box('<motion repeat="yes"><to pos="1 0 0 mm" in="1 s"/></motion>'): "motion",
    box('<motion><to pos="1 0 0 mm"/></motion>'): "missing-attribute",
    box('<motion><to pos="1 0 0 mm" in="0 s"/></motion>'): "out-of-range",
    box('<motion><to quat="1 0 0 0" rpy="0 0 0" in="1 s"/></motion>'): "exclusive",
    box('<motion><to pos="1 0 0 mm" in="1 s"/></motion>', ' pose-from="arm"'): "exclusive",
    box("", ' pose-from="arn"'): "unknown-name",
    box("", ' pose-from="peltier"'): "missing-channel",
}


@pytest.mark.parametrize("objects", BAD)
def test_motions_that_cannot_be_are_told(write: Write, objects: str) -> None:
    with pytest.raises(SceneError) as caught:
        build(write, objects, devices='<device name="peltier" plugin="thermal"/>' if "peltier" in objects else "")
    codes = [problem.code for problem in caught.value.problems if problem.severity == "error"]
    assert codes == [BAD[objects]]
    assert all(problem.place is not None and problem.place.line == 3 for problem in caught.value.problems)
