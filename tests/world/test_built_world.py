"""What is made of a scene's elements: the tables of motions, what may press on a finger, what a table cannot reach."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.contact import Box as BoxShape
from itouch.contact import object_motion as at
from itouch.plugin import Role
from itouch.scene.elements import Box, Key, ObjectMotion, Operator, Probe
from itouch.world.bindings import check_reach
from itouch.world.limits import PLATE_FORCE
from itouch.world.motion_tables import build_motions
from itouch.world.presented_surfaces import surfaces_of
from itouch.world.state_fields import probe_fields, skin_fields

PLACES: Any = SimpleNamespace(of=lambda *_: None)


def scene(**parts: Any) -> Any:
    return SimpleNamespace(places=PLACES, objects=(), **parts)


def test_a_motion_is_a_table_of_where_from_and_which_way() -> None:
    keys = (
        Key(in_=0.5, pos=(0.0, 0.0, 0.03), rpy=(0.0, 0.0, math.pi / 2), hold=0.25),
        Key(in_=1.0, pos=(0.01, 0.0, 0.03)),
    )
    moved = Box(name="moved", size=(0.01, 0.01, 0.01), material="wood", motion=ObjectMotion(keys=keys))
    start, problems = np.array([[0.0, 0.02, 0.01, 1.0, 0.0, 0.0, 0.0]]), list[Any]()
    world: Any = SimpleNamespace(places=PLACES, objects=(moved,))
    found = build_motions(world, start, [BoxShape((0.01, 0.01, 0.01))], {}, None, problems)  # type: ignore[arg-type]
    assert not problems
    assert found.pieces.shape == (3, at.PIECE_WIDTH)
    half = math.sqrt(0.5)
    assert found.pieces == pytest.approx(np.array([
        [0.0, 0.5, 1.0, 0.0, 0.02, 0.01, 0.0, -0.02, 0.02, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.pi / 2],
        [0.5, 0.25, 1.0, 0.0, 0.0, 0.03, 0.0, 0.0, 0.0, half, 0.0, 0.0, half, 0.0, 0.0, 0.0],
        [0.75, 1.0, 1.0, 0.0, 0.0, 0.03, 0.01, 0.0, 0.0, half, 0.0, 0.0, half, 0.0, 0.0, 0.0],
    ]))  # fmt: skip
    assert (found.scripts.tolist(), found.duration) == ([[0.0, 0.0, 3.0, 1.75, 0.0]], 1.75)


def device(name: str, *, force: float | None = None, plate: float | None = None, **more: Any) -> Any:
    limits = SimpleNamespace(force=force, plate_force=plate, finger_force=3.0)
    return SimpleNamespace(
        **{"name": name, "limits": limits, "carrier": "", "mount": (0.0,) * 3 + (1.0,) + (0.0,) * 3, "touch_off": None}
        | more
    )


@pytest.mark.parametrize(
    ("plate", "force", "most"),
    [(1.0, None, 1.0), (None, None, PLATE_FORCE), (1.0, 0.5, 0.5), (1.0, 2.0, 1.0)],
)
def test_a_surface_presses_no_more_than_plate_and_arm_may(
    plate: float | None, force: float | None, most: float
) -> None:
    probe = Probe(name="finger", radius=0.008, pose_from="arm", force_to="arm", surface_to="table")
    devices = {"table": device("table", plate=plate), "arm": device("arm", force=force)}
    people = {"finger": Operator(probe="finger")}
    assert surfaces_of(scene(probes=(probe,)), devices, people)["finger"].greatest_force == most


def test_an_object_above_what_the_table_reaches_is_told_with_its_height_and_the_range() -> None:
    target = SimpleNamespace(low=(-0.1, -0.1, 0.01), high=(0.1, 0.1, 0.05))
    table = device("table", command=lambda role: target if role is Role.SURFACE_POSE else None)
    tower = Box(name="tower", size=(0.02, 0.02, 0.08), pos=(0.0, 0.0, 0.04), material="wood")
    probe = Probe(name="finger", radius=0.008, pose_from="arm", surface_to="table")
    world: Any = SimpleNamespace(places=PLACES, objects=(tower,), probes=(probe,))
    (problem,) = check_reach(world, {"table": table})
    assert problem.sentence == (
        "the top of object 'tower' is at height 80 mm, outside 10 to 50 mm of what 'table' can reach"
    )


def test_what_renders_an_object_out_of_reach_is_said_of_the_finger_whose_table_it_is() -> None:
    """Another finger's table may reach it, and a finger without an arm is given nothing at all."""
    target = SimpleNamespace(low=(-0.05, -0.05, 0.0), high=(0.05, 0.05, 0.05))
    near, far = (device(name, command=lambda role: target if role is Role.SURFACE_POSE else None) for name in "ab")
    far.mount = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    block = Box(name="block", size=(0.02, 0.02, 0.02), pos=(0.0, 0.0, 0.01), material="wood")
    thumb = Probe(name="thumb", radius=0.008, pose_from="arm", force_to="arm", surface_to="a")
    index = Probe(name="index", radius=0.008, pose_from="arm", force_to="arm", surface_to="b")
    bare = Probe(name="bare", radius=0.008, pose_from="arm", surface_to="b")
    world: Any = SimpleNamespace(places=PLACES, objects=(block,), probes=(thumb, index, bare))
    assert [problem.advice for problem in check_reach(world, {"a": near, "b": far})] == [
        "only the arm renders the contacts of probe 'index' with it, without heat",
        "nothing renders the contacts of probe 'bare' with it",
    ]


def test_places_speeds_and_forces_have_three_numbers() -> None:
    """Whoever reads State, a recording or an export takes them for x, y and z."""
    for field in probe_fields(2):
        assert field.size in (0, 1, 3), field.name
    sizes = {field.name: field.size for field in skin_fields(2, 24)}
    assert sizes == {"skin": 3, "tissue": 24, "taken": 2}
