"""What is written reads back to an equal scene: for every shipped scene, and for generated ones."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import SCENE_FILES

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads, write
from itouch.scene.elements import (
    Box,
    ContactMaterial,
    DeviceElement,
    Limits,
    Material,
    Mesh,
    Motion,
    Mount,
    Operator,
    Plane,
    Probe,
    Rates,
    Safety,
    Sphere,
    To,
    Visual,
    WorldElement,
)

SHIPPED = SCENE_FILES


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.name)
def test_a_shipped_scene_is_read_back_equal(path: Path) -> None:
    scene = itouch.load(path)
    again = loads(write(scene).encode(), Catalog())
    assert again == scene
    assert write(again) == write(scene)


_number = st.floats(-1.0, 1.0, allow_subnormal=False)
_three = st.tuples(_number, _number, _number)
_length = st.floats(1e-4, 1.0)
_temperature = st.none() | st.floats(180.0, 600.0)
_rotation = st.none() | st.tuples(_number, _number, _number)


@st.composite
def objects(draw: st.DrawFn, index: int) -> Box | Sphere | Plane | Mesh:
    placed = {
        "name": f"o{index}",
        "pos": draw(_three),
        "rpy": draw(_rotation),
        "material": "m0",
        "temperature": draw(_temperature),
    }
    kind = draw(st.sampled_from(["box", "sphere", "plane", "mesh"]))
    if kind == "box":
        return Box(size=draw(st.tuples(_length, _length, _length)), **placed)
    if kind == "mesh":
        file = draw(st.sampled_from(["a.stl", "parts/b c.obj", "ä & <b>.ply", "..c.glb"]))
        return Mesh(file=file, scale=draw(st.floats(1e-6, 1e4)), sides=draw(st.sampled_from(["one", "two"])), **placed)
    return Sphere(radius=draw(_length), **placed) if kind == "sphere" else Plane(**placed)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    friction = sorted(draw(st.tuples(st.floats(0, 2), st.floats(0, 2))))
    contact = ContactMaterial(
        stiffness=draw(st.floats(1e-3, 1e5)), damping=draw(st.floats(0, 100)),
        static_friction=friction[1], dynamic_friction=friction[0],
    )  # fmt: skip
    color = st.floats(0, 1)
    finish = st.sampled_from(["matte", "metal", "glass", "wood", "foam"])
    visual = draw(st.none() | st.builds(Visual, color=st.tuples(color, color, color), finish=finish))
    arm = DeviceElement(
        name="arm", plugin="usb-arm", optional=draw(st.booleans()),
        mount=Mount(pos=draw(_three), rpy=draw(_rotation)), limits=Limits(force=draw(st.none() | st.floats(0.1, 3.0))),
    )  # fmt: skip
    targets = draw(st.lists(st.builds(To, pos=_three, in_=st.floats(1e-3, 10), hold=st.floats(0, 10)), max_size=4))
    return Scene(
        world=WorldElement(
            temperature=draw(st.floats(260, 320)),
            objects=tuple(draw(objects(i)) for i in range(draw(st.integers(0, 4)))),
        ),
        materials=(Material(name="m0", contact=contact, visual=visual),),
        devices=(arm,),
        probes=(Probe(name="finger", pose_from="arm", force_to="arm", radius=draw(st.floats(0, 0.1))),),
        operators=(Operator(probe="finger", motion=Motion(targets=tuple(targets))),),
        rates=Rates(servo=draw(st.sampled_from([500.0, 1000.0, 2000.0]))),
        safety=Safety(force=draw(st.none() | st.floats(0.1, 3.0))),
    )


@settings(max_examples=150, deadline=None)
@given(scenes())
def test_a_generated_scene_is_read_back_equal(scene: Scene) -> None:
    assert loads(write(scene).encode(), Catalog()) == scene
