"""Two fingers lift a block: its weight is felt, sessions go on to the bit, and without MuJoCo a scene says so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.schema import SceneError
from itouch.world import motion_tables

Write = Callable[[str, str], Path]
FINGERS = SCENES / "two_fingers.xml"

SCENE = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="2 N/mm" damping="5 N*s/m" static-friction="0.5" dynamic-friction="0.4"/></material></materials>
  <world{world}>{objects}</world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion>
      <to pos="-60 0 20 mm" in="0.1 s" hold="0.1 s"/><to pos="0 0 20 mm" in="1 s" hold="0.2 s"/></motion></operator>
  </interaction>
</itouch>"""
GROUND = '<box name="ground" size="400 400 20 mm" pos="0 0 -10 mm" material="m"/>'


def body(mass: str = "50 g", more: str = "") -> str:
    return f'<box name="cube" size="40 40 40 mm" pos="0 0 20 mm" material="m"><dynamics mass="{mass}"{more}/></box>'


def build(write: Write, objects: str, world: str = "") -> itouch.Session:
    return itouch.build(write("s.xml", SCENE.format(objects=objects, world=world)))


def test_two_fingers_lift_the_block_and_feel_its_weight() -> None:
    engine = itouch.build(FINGERS)
    heights, weights = [], []

    def note() -> None:
        heights.append(float(engine.state["objects.pose"][1, 2]))
        weights.append(float(engine.state["thumb.contact_force"][2] + engine.state["index.contact_force"][2]))

    engine.run(each=note)
    height = np.array(heights)
    assert height.max() > 0.055
    held = (height > 0.05) & (np.abs(np.gradient(height)) < 1e-6)
    assert held.sum() > 100
    assert np.mean(np.array(weights)[held]) == pytest.approx(-0.1 * 9.81, rel=0.03)
    np.testing.assert_allclose(engine.state["objects.pose"][1], [0, 0, 0.02, 1, 0, 0, 0], atol=2e-3)
    probes = {contact["probe"] for contact in engine.report()["contacts"]}
    assert probes == {"thumb", "index"}


@pytest.mark.parametrize("stop", [1, 700, 1650])
def test_a_lifted_block_goes_on_after_a_restore_to_the_same_bytes(tmp_path: Path, stop: int) -> None:
    straight = itouch.build(FINGERS)
    straight.run((stop + 200) * 1e-3)
    broken = itouch.build(FINGERS)
    broken.run(stop * 1e-3)
    broken.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(0.2)
    assert again.state.tobytes() == straight.state.tobytes()


def test_a_finger_pushes_a_cube_along(write: Write) -> None:
    engine = build(write, GROUND + body())
    forces: list[float] = []
    engine.run(each=lambda: forces.append(float(engine.state["finger.contact_force"][0])))
    assert engine.state["objects.pose"][1, 0] > 0.02
    assert min(forces) < -0.5 * 0.4 * 0.05 * 9.81
    assert abs(engine.state["objects.pose"][1, 1]) < 1e-3


def test_gravity_is_the_worlds(write: Write) -> None:
    engine = build(write, body().replace("0 0 20 mm", "0 200 20 mm"), ' gravity="0 0 -1.62 m/s^2"')
    engine.run(0.201)
    assert engine.state["objects.twist"][0, 2] == pytest.approx(-1.62 * 0.2, rel=0.03)


def test_a_light_body_gets_a_softer_coupling_and_stays_calm(write: Write) -> None:
    engine = build(write, GROUND + body("2 g"))
    assert any("'cube' is too light" in notice for notice in engine.notices)
    speeds: list[float] = []
    engine.run(each=lambda: speeds.append(float(np.abs(engine.state["objects.twist"][1, :3]).max())))
    assert max(speeds) < 0.5


def test_a_body_that_turns_too_easily_gets_a_softer_coupling_and_stays_calm(write: Write) -> None:
    small = body("100 g").replace('mass="100 g"', 'mass="100 g" inertia="2e-9 2e-9 2e-9 kg*m^2"')
    engine = build(write, small.replace("0 0 20 mm", "0 12 20 mm"), ' gravity="0 0 0 m/s^2"')
    assert any("'cube' has too small an inertia for its material" in notice for notice in engine.notices)
    turns: list[float] = []
    engine.run(each=lambda: turns.append(float(np.abs(engine.state["objects.twist"][0, 3:]).max())))
    assert 0.0 < max(turns) < 1e3


def test_a_scripted_wall_pushes_a_body(write: Write) -> None:
    wall = '<box name="wall" size="10 100 60 mm" pos="60 0 31 mm" material="m"><motion><to pos="30 60 31 mm" in="0.01 s"/><to pos="-20 60 31 mm" in="1 s"/></motion></box>'
    engine = build(write, GROUND + wall + body().replace('pos="0 0 20 mm"', 'pos="0 80 20 mm"'))
    engine.run(1.2)
    assert engine.state["objects.pose"][2, 0] < -0.03


def test_without_mujoco_a_scene_says_what_to_install(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_tables, "available", lambda: False)
    with pytest.raises(SceneError) as caught:
        build(write, GROUND + body())
    (problem,) = [p for p in caught.value.problems if p.severity == "error"]
    assert problem.code == "missing-extra"
    assert "itouch-py[dynamics]" in problem.advice
    assert "MuJoCo" in problem.sentence
    assert problem.place is not None
    assert problem.place.line == 3


@pytest.mark.parametrize(
    ("objects", "code"),
    [
        ('<plane name="p" material="m"><dynamics mass="1 kg"/></plane>', "dynamics"),
        (body("0 kg"), "out-of-range"),
        (body(more=' inertia="1 1 kg*m^2"'), "bad-value"),
        (body(more=' inertia="1 1 9 kg*m^2"'), "dynamics"),
        (body().replace("/></box>", '/><motion><to pos="0 0 0" in="1 s"/></motion></box>'), "exclusive"),
    ],
)
def test_what_cannot_be_a_body_is_told(write: Write, objects: str, code: str) -> None:
    with pytest.raises(SceneError) as caught:
        build(write, objects)
    (problem,) = [p for p in caught.value.problems if p.severity == "error"]
    assert problem.code == code
    assert problem.place is not None


FLAT = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


@pytest.mark.parametrize(
    ("objects", "sentence"),
    [
        (body(more=' inertia="1 1 9 kg*m^2"'), "'cube' cannot be a rigid body: none of its three moments of inertia"),
        (body().replace("40 40 40 mm", "0.01 0.01 0.01 mm"), "'cube' cannot be a rigid body: it is so small or light"),
        (
            '<mesh name="sheet" file="flat.obj" scale="0.1" material="m"><dynamics mass="1 kg"/></mesh>',
            "'sheet' cannot be a rigid body: its mesh is flat",
        ),
        (
            body() + '<mesh name="sheet" file="flat.obj" scale="0.1" material="m"/>',
            "'sheet' cannot be met by rigid bodies: its mesh is flat",
        ),
    ],
)
def test_why_it_cannot_be_a_body_is_told_in_words_of_the_scene(write: Write, objects: str, sentence: str) -> None:
    write("flat.obj", FLAT)
    with pytest.raises(SceneError) as caught:
        build(write, objects)
    (problem,) = [p for p in caught.value.problems if p.severity == "error"]
    assert problem.sentence.startswith(f"object {sentence}")
    assert "Element" not in problem.sentence and "mjMINVAL" not in problem.sentence
