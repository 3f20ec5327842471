"""Properties of surfaces in a scene: what is felt, what is refused, and that nothing of it is lost between sessions."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.contact.effects import EFFECTS_MEMORY
from itouch.plugin import Contact
from itouch.schema import SceneError

Write = Callable[[str, str], Path]
TILES = SCENES / "texture.xml"

SCENE = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="1 N/mm"{contact}/>{effects}</material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"{probe}/>
    <operator probe="finger"><motion>
      <to pos="0 0 40 mm" in="0.1 s"/><to pos="0 0 26 mm" in="0.3 s"/><to pos="15 0 26 mm" in="0.3 s"/><to pos="15 0 50 mm" in="0.2 s"/>
    </motion></operator>
  </interaction>
</itouch>"""


def scene(write: Write, effects: str = "", contact: str = "", probe: str = "") -> Path:
    return write("scene.xml", SCENE.format(effects=effects, contact=contact, probe=probe))


def forces(path: Path, seconds: float = 0.7) -> np.ndarray:
    engine = itouch.build(path)
    found: list[np.ndarray] = []
    engine.run(seconds, each=lambda: found.append(np.array(engine.state["finger.contact_force"])))
    return np.array(found)


def test_the_scene_of_tiles_shows_each_property() -> None:
    engine = itouch.build(TILES)
    felt: dict[int, list[np.ndarray]] = {}

    def note() -> None:
        felt.setdefault(int(engine.state["finger.object"]), []).append(np.array(engine.state["finger.contact_force"]))

    engine.run(each=note)
    tiles = {name: np.array(felt[i]) for i, name in enumerate(engine.model.objects)}
    assert min(f[2] for f in felt[-1]) < -0.5  # the magnet pulls at a distance
    assert np.std(tiles["ridges-tile"][200:, 0]) > 3 * np.std(tiles["pad-tile"][50:-50, 0])
    assert tiles["pad-tile"][50:-50, 2].max() < tiles["honey-tile"][50:-50, 2].min()
    assert np.abs(np.diff(tiles["rubber-tile"][:, 0])).max() > 0.2
    assert tiles["honey-tile"][50:-50, 0].mean() < -0.2
    assert tiles["drum-tile"][:, 2].max() > 1.1 * tiles["drum-tile"][-100:, 2].mean()
    assert len(engine.report()["contacts"]) == 7


def test_without_effects_there_is_no_state_for_them(write: Write) -> None:
    assert "finger.effects" not in itouch.build(scene(write)).state
    engine = itouch.build(scene(write, '<viscosity damping="1 N*s/m"/>'))
    assert engine.state["finger.effects"].shape == (EFFECTS_MEMORY,)


@pytest.mark.parametrize("stop", [400, 1301, 2222, 4350])
def test_tiles_go_on_after_a_restore_to_the_same_bytes(tmp_path: Path, stop: int) -> None:
    straight = itouch.build(TILES)
    straight.run((stop + 300) * 1e-3)
    broken = itouch.build(TILES)
    broken.run(stop * 1e-3)
    broken.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    again.run(0.3)
    assert again.state.tobytes() == straight.state.tobytes()


def test_softness_is_that_of_its_layers(write: Write) -> None:
    hard = forces(scene(write))
    soft = forces(scene(write, '<softness><layer thickness="5 mm" stiffness="0.1 N/mm"/></softness>'))
    assert 0.1 < soft[:, 2].max() < 0.6 * hard[:, 2].max()


def test_force_shading_of_a_mesh_by_an_attribute(write: Write, tmp_path: Path) -> None:
    import trimesh

    trimesh.creation.icosphere(subdivisions=1, radius=0.02).export(tmp_path / "ball.stl")
    text = SCENE.format(effects="", contact="{shading}", probe="").replace(
        '<box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="m"/>',
        '<mesh name="block" file="ball.stl" scale="1 m" pos="1 1 2 mm" material="m"/>',
    )
    found = [forces(write("scene.xml", text.format(shading=shading))) for shading in ("", ' shading="yes"')]
    norms = [np.linalg.norm(force, axis=1) for force in found]
    touched = (norms[0] > 0.05) & (norms[1] > 0.05)
    assert touched.sum() > 100
    turn = np.einsum("ni,ni->n", found[0][touched], found[1][touched]) / (norms[0][touched] * norms[1][touched])
    assert np.degrees(np.arccos(turn.min())) > 1.0


def test_a_viscosity_beyond_what_the_arm_can_render_is_lowered_and_said(write: Write) -> None:
    engine = itouch.build(scene(write, '<viscosity damping="19 N*s/m"/>'))
    assert any("viscosity of material 'm'" in notice for notice in engine.notices)
    assert engine.model.probes[0].effects[0].viscosity < 19


def test_a_steep_texture_is_smoothed_and_said(write: Write, tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", np.random.default_rng(1).random((32, 32)))
    engine = itouch.build(scene(write, '<texture file="t.npy" depth="2 mm" width="10 mm"/>'))
    assert any("steeper than 45 degrees" in notice for notice in engine.notices)


BAD = {
    '<texture file="none.png"/>': "no-such-file",
    '<texture file="../up.png"/>': "outside-folder",
    '<texture file="scene.xml"/>': "texture",
    "<texture/>": "missing-attribute",
    "<softness/>": "out-of-range",
    "<softness>" + '<layer thickness="1 mm" stiffness="1 N/m"/>' * 5 + "</softness>": "out-of-range",
    '<softness><layer thickness="1 mm"/></softness>': "missing-attribute",
    '<softness><layer thickness="1 mm" stiffness="9 N/mm"/></softness>': "bad-value",
    "<stick-slip/>": "missing-attribute",
    '<stick-slip force="9 N"/>': "out-of-range",
    "<vibration/>": "bad-value",
    '<vibration amplitude="0.1 N" frequency="400 Hz"/>': "out-of-range",
    '<magnetic force="1 N" range="60 mm"/>': "out-of-range",
    '<viscosity damping="1 N"/>': "bad-value",
    '<viscosity dampng="1 N*s/m"/>': "unknown-attribute",
}


@pytest.mark.parametrize("effects", BAD)
def test_what_cannot_be_is_told_with_its_place(write: Write, effects: str) -> None:
    with pytest.raises(SceneError) as caught:
        itouch.build(scene(write, effects))
    (problem,) = [p for p in caught.value.problems if p.severity == "error"]
    assert problem.code == BAD[effects]
    assert problem.place is not None
    assert problem.place.line == 2


def test_events_carry_all_that_is_known_of_a_contact(write: Write) -> None:
    engine = itouch.build(scene(write, contact=' static-friction="0.5" dynamic-friction="0.4"'))
    engine.run()
    table = engine.state["events.table"][: int(engine.state["events.count"])]
    assert [int(row["kind"]) for row in table] == [Contact.NEAR, Contact.BEGIN, Contact.END]
    near, begin, end = table
    assert near["distance"] == pytest.approx(0.012, abs=2e-3)
    assert near["time_to_contact"] > 0.02
    assert (near["penetration"], near["force"], near["area"]) == (0.0, 0.0, 0.0)
    assert begin["distance"] == 0.0
    assert begin["speed"] == pytest.approx(0.05, abs=0.04)
    assert begin["penetration"] > 0.0
    assert begin["area"] == pytest.approx(np.pi * (0.75 * begin["force"] * 0.008 / 5e4) ** (2 / 3))
    np.testing.assert_allclose(begin["normal"], [0, 0, 1])
    np.testing.assert_allclose(begin["point"], [0, 0, 0.02], atol=1e-6)
    assert end["tick"] > begin["tick"]
    (contact,) = engine.report()["contacts"]
    assert contact["peak_area_mm2"] == pytest.approx(
        np.pi * (0.75 * contact["peak_force_N"] * 8 / 0.05) ** (2 / 3), rel=0.2
    )
    assert contact["peak_penetration_mm"] > 0.5
    assert contact["impact_speed_m_s"] == pytest.approx(begin["speed"])


GROOVE = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials>
    <material name="damped"><contact stiffness="0.5 N/mm"{contact}/>{effects}</material>
    <material name="bare"><contact stiffness="0.5 N/mm"/></material>
  </materials>
  <world>{walls}</world>
  <devices><device name="arm" plugin="usb-arm"><usb-arm:hardware resolution="0 mm"/></device></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" hand-damping="20 N*s/m"/>
    <operator probe="finger"><motion>
      <to pos="0 0 30 mm" in="0.1 s"/><to pos="0 0 5 mm" in="0.15 s"/><to pos="0 9 5 mm" in="0.1 s"/><to pos="1 9 9 mm" in="0.1 s"/><to pos="-1 9 3 mm" in="0.1 s"/>
      <to pos="1 9 9 mm" in="0.1 s"/>
    </motion></operator>
  </interaction>
</itouch>"""
LEFT = '<box name="left" size="60 60 20 mm" pos="-14.1421356 0 0 mm" rpy="0 45 0 deg" material="damped"/>'
RIGHT = '<box name="right" size="60 60 20 mm" pos="14.1421356 0 0 mm" rpy="0 -45 0 deg" material="bare"/>'


#: What one of the two walls has: damping, or drag along it.
WALL = pytest.mark.parametrize(
    "wall",
    [
        {"contact": ' damping="4 N*s/m"', "effects": ""},
        {"contact": "", "effects": '<viscosity damping="8 N*s/m"/>'},
    ],
    ids=["damped", "viscous"],
)


@WALL
def test_in_a_groove_of_two_objects_each_damps_by_its_share_in_any_order_of_the_file(
    write: Write, wall: dict[str, str]
) -> None:
    one, other = (
        forces(write(f"{i}.xml", GROOVE.format(walls=walls, **wall)), 0.65)
        for i, walls in enumerate((LEFT + RIGHT, RIGHT + LEFT))
    )
    assert np.abs(one[:, 2]).max() > 1.0
    assert np.abs(one - other).max() < 1e-9


@WALL
def test_the_force_does_not_step_where_another_object_of_a_groove_bears_most(
    write: Write, wall: dict[str, str]
) -> None:
    engine = itouch.build(write("scene.xml", GROOVE.format(walls=LEFT + RIGHT, **wall)))
    found: list[tuple[int, np.ndarray]] = []
    engine.run(
        0.65,
        each=lambda: found.append((int(engine.state["finger.object"]), np.array(engine.state["finger.contact_force"]))),
    )
    steps = [
        float(np.linalg.norm(b - a)) for (k, a), (n, b) in itertools.pairwise(found) if k >= 0 and n >= 0 and k != n
    ]
    assert steps
    assert max(steps) < 0.05  # the finger moves at up to 0.06 m/s
