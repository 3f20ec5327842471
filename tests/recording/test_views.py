"""What 3-D viewers see of a recording, decoded by the library of Protocol Buffers from the schemas in the file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from numpy.typing import NDArray

import itouch
from itouch.plugin import poses
from itouch.recording import read, views
from itouch.recording.wellknown import MESSAGES, decode
from itouch.session.outputs import Outputs, open_outputs

SCENES = Path(__file__).resolve().parents[2] / "scenes"
EVERY = 33


def decoded(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time and message; the file brings the schemas."""
    classes: dict[str, Any] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if not channel.topic.startswith("/view/"):
                continue
            assert schema is not None and schema.encoding == channel.message_encoding == "protobuf"
            if schema.name not in classes:
                files = descriptor_pb2.FileDescriptorSet()
                files.ParseFromString(schema.data)
                pool = descriptor_pool.DescriptorPool()
                for file in files.file:
                    pool.Add(file)
                classes[schema.name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            found = classes[schema.name]()
            found.ParseFromString(message.data)
            yield channel.topic, message.log_time, found


def placed(transforms: Any) -> dict[str, NDArray[np.float64]]:
    """Return the pose (7,) in the world of every frame of a message."""
    own = {t.child_frame_id: t for t in transforms}

    def world(name: str) -> NDArray[np.float64]:
        t = own[name]
        pose = np.array([t.translation.x, t.translation.y, t.translation.z,
                         t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z])  # fmt: skip
        return pose if t.parent_frame_id == "world" else poses.compose(world(t.parent_frame_id), pose)

    return {name: world(name) for name in own}


@pytest.fixture(scope="module", params=["four_materials.xml", "moving.xml", "two_fingers.xml"])
def session(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("view") / "a.mcap"
    engine, states = itouch.build(SCENES / request.param), {}
    engine.taps.append(lambda tick: states.update({tick: engine.state.tobytes()}) if tick % EVERY == 0 else None)
    with open_outputs(engine, Outputs(str(path), True, "", 0.0, False)):
        engine.run(8.5)
    engine.close()
    return engine, states, path


def test_frames_are_where_the_state_says(session: Any) -> None:
    engine, states, path = session
    start, compared, state = read(path).session["start_ns"], 0, engine.state.copy()
    for topic, time, message in decoded(path):
        tick = round((time - start) / 1e9 / engine.model.period)
        if topic != "/view/transforms" or tick not in states:
            continue
        state.raw.data[:] = states[tick]
        found = placed(message.transforms)
        for index, name in enumerate(engine.model.objects):
            assert np.abs(found[f"object/{name}"] - state["objects.pose"][index]).max() < 1e-6
        for probe in engine.model.probes:
            for part in ("hip", "proxy"):
                assert np.abs(found[f"{probe.name}/{part}"][:3] - state[f"{probe.name}.{part}"]).max() < 1e-6
        compared += 1
    assert compared > 150


def test_plates_are_where_the_window_draws_them(session: Any) -> None:
    from itouch_tools.viewer.scene_graph import SceneGraph

    engine, states, path = session
    stage, state, compared = SceneGraph(engine.model), engine.state.copy(), 0
    start = read(path).session["start_ns"]
    for topic, time, message in decoded(path):
        tick = round((time - start) / 1e9 / engine.model.period)
        if topic == "/view/transforms" and tick in states:
            state.raw.data[:] = states[tick]
            found = placed(message.transforms)
            for device in engine.model.devices.values():
                matrix = stage.place(state, device)
                pose = found[f"device/{device.name}"]
                assert np.abs(poses.matrix(pose[3:]) - matrix[:3, :3]).max() < 1e-6
                assert np.abs(pose[:3] - matrix[:3, 3]).max() < 1e-6
                compared += 1
    assert compared > 150


def test_every_object_is_drawn_once_and_forces_come_and_go(session: Any) -> None:
    engine, states, path = session
    state, start = engine.state.copy(), read(path).session["start_ns"]
    drawn: list[str] = []
    arrows = 0
    shown: set[str] = set()
    for topic, time, message in decoded(path):
        if topic == "/view/solids":
            assert not drawn, "solids are told once, before the first mark"
        elif topic != "/view/scene":
            continue
        shown -= {deletion.id for deletion in message.deletions}
        tick = round((time - start) / 1e9 / engine.model.period)
        for entity in message.entities:
            drawn.append(entity.id)
            assert entity.frame_locked and entity.frame_id
            if not entity.arrows:
                continue
            shown.add(entity.id)
            if tick in states:
                state.raw.data[:] = states[tick]
                force = state[entity.id.replace("/force", ".contact_force")]
                q = entity.arrows[0].pose.orientation
                points = poses.rotate(np.array([q.w, q.x, q.y, q.z]), np.array([1.0, 0.0, 0.0]))
                assert points == pytest.approx(force / np.linalg.norm(force), abs=1e-6)
                arrows += 1
    for name in engine.model.objects:
        assert sum(word.split("/")[:2] == ["object", name] for word in drawn) >= 1
    assert arrows > 10
    state.raw.data[:] = states[max(states)]
    touching = {p.name for p in engine.model.probes if np.linalg.norm(state[f"{p.name}.contact_force"]) >= 0.01}
    assert shown == {f"{name}/force" for name in touching}


@pytest.mark.parametrize(
    ("force", "arrow"),
    [
        ((0.0, 0.0, 2.0), (0.0, 0.0, 0.04)),  # 2 cm a newton
        ((-1.5, 2.0, 0.0), (-0.03, 0.04, 0.0)),
        ((0.0, -30.0, 40.0), (0.0, -0.048, 0.064)),  # 8 cm at most
        ((0.0, 0.0, 0.009), None),
        ((math.nan, 0.0, 1.0), None),
    ],
)
def test_the_arrow_of_a_force_is_as_long_as_it_is_strong(
    force: tuple[float, ...], arrow: tuple[float, ...] | None
) -> None:
    found = views.arrow_of(force)
    assert found == (None if arrow is None else pytest.approx(arrow))


def test_a_viewer_that_is_set_to_another_time_still_has_the_solids(session: Any) -> None:
    """It has the newest message of each topic before that time, and nothing else."""
    engine, _, path = session
    newest = {topic: message for topic, _, message in decoded(path)}
    there = {entity.id for message in newest.values() for entity in getattr(message, "entities", ())}
    for name in engine.model.objects:
        assert any(word.split("/")[:2] == ["object", name] for word in there), f"{name} is gone"


def test_a_mesh_keeps_its_corners_and_a_huge_one_becomes_a_box() -> None:
    from itouch.session.viewer_geometry import view_of

    engine = itouch.build(SCENES / "mesh.xml")
    view = view_of(engine.model, engine.state)
    kinds = {solid.name: solid for solid in view.solids}
    meshes = [shape for shape in engine.model.shapes if hasattr(shape, "surface")]
    skins = [solid for solid in kinds.values() if solid.kind == "skin"]
    assert len(skins) == len([m for m in meshes if len(m.surface.vertices) <= 60_000]) > 0
    assert type(view).load(view.dump()) == view
    engine.close()


def test_a_temperature_stands_above_its_frame_while_it_is_one() -> None:
    view = views.View(
        frames=(views.Frame("plate", "world", "pose", 0, 3),),
        warmths=(views.TemperatureLabel("plate/temperature", "plate", "plate"),),
    )
    drawing = views.Drawing(view, {"pose": 0, "plate": 24}, period=0.1, start_ns=0)
    rows = np.array([(0.1, 0.2, 0.3, kelvin) for kelvin in (300.15, 310.65, math.nan, 0.0)]).view(np.uint8)
    told = [
        (tick, decode("SceneUpdate", data)) for topic, tick, data in drawing.messages(np.arange(4), rows)
        if topic == "/view/scene"
    ]  # fmt: skip
    assert [[entity["texts"][0]["text"] for entity in content["entities"]] for _, content in told] == [
        ["27.0 °C"], ["37.5 °C"], [],
    ]  # fmt: skip
    (text,), (gone,) = told[0][1]["entities"][0]["texts"], told[2][1]["deletions"]
    assert [text["color"][part] for part in "rgba"] == list(views._WORDS) and max(views._WORDS) <= 1.0
    place = text["pose"]["position"]
    assert [place.get(axis, 0.0) for axis in "xyz"] == [0.0, 0.0, 0.012]
    assert told[0][1]["entities"][0]["frame_id"] == "plate"
    assert (told[2][0], gone["id"]) == (2, "plate/temperature")


@pytest.mark.parametrize("name", MESSAGES)
def test_each_field_of_a_message_has_a_number_of_its_own(name: str) -> None:
    names, numbers, _ = zip(*MESSAGES[name], strict=True)
    assert len(set(names)) == len(set(numbers)) == len(MESSAGES[name])


def test_a_rod_is_as_thick_as_its_radius_says_and_as_long_as_twice_its_half() -> None:
    view = views.View(solids=(views.Solid("rod", "world", "rod", (0.01, 0.05), (1.0, 0.0, 0.0, 1.0)),))
    drawing = views.Drawing(view, {}, period=0.1, start_ns=0)
    rows = np.zeros((1, 8), np.uint8)
    (content,) = [
        decode("SceneUpdate", data)
        for topic, _, data in drawing.messages(np.arange(1), rows)
        if topic.startswith("/view/solid")
    ]
    (rod,) = content["entities"][0]["cylinders"]
    assert [rod["size"][axis] for axis in "xyz"] == [0.02, 0.02, 0.1]
    assert rod["bottom_scale"] == rod["top_scale"] == 1.0


def test_colours_are_shares_of_red_green_and_blue(session: Any) -> None:
    from itouch.session.viewer_geometry import view_of

    engine, _, _ = session
    solids = view_of(engine.model, engine.state).solids
    faces = [
        device for device in engine.model.devices.values() if device.cls.surface_half_extents(device.params) is not None
    ]
    assert {solid.name for solid in solids} >= {f"{device.name}/face" for device in faces}
    assert all(len(solid.colour) == 4 and min(solid.colour) >= 0.0 and max(solid.colour) <= 1.0 for solid in solids)


def test_what_is_drawn_stays_as_the_file_says_it() -> None:
    """A recording tells it once, at its begin."""
    view = views.View(
        frames=(views.Frame("plate", "world", "pose", 0, 3),), solids=(views.Solid("b", "plate", "ball", (0.1,), ()),),
        forces=(views.Force("push", "plate", "force"),), warmths=(views.TemperatureLabel("t", "plate", "kelvin"),),
    )  # fmt: skip
    for part in (*view.frames, *view.solids, *view.forces, *view.warmths):
        with pytest.raises(FrozenInstanceError):
            part.name = "other"  # type: ignore[misc, union-attr]
    with pytest.raises(FrozenInstanceError):
        view.solids = ()  # type: ignore[misc]


def test_a_recording_made_of_a_path_names_the_function_that_reads_one() -> None:
    with pytest.raises(TypeError, match=r"itouch\.read\(PATH\), not made of 'r\.mcap'"):
        itouch.Recording("r.mcap")  # type: ignore[arg-type]
