"""A recording as a bag of ROS 2, read back by the reader of the package that is not ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import program
from shipped import SCENES

import itouch
from itouch.recording import read
from itouch.session.outputs import Outputs, open_outputs

pytest.importorskip("rosbags")
from rosbags.highlevel import AnyReader


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("bag")
    path, engine = folder / "a touch.mcap", itouch.build(SCENES / "four_materials.xml")
    with open_outputs(engine, Outputs(str(path), True, "", 0.0, False)):
        engine.run(0.1)
        engine.mark("begin", {"trial": 3})
        engine.run(0.1)
    engine.close()
    done = program("export", str(path), "--rosbag", str(folder / "bag"))
    assert done.returncode == 0, done.stderr
    return read(path), folder / "bag"


def messages(bag: Path) -> dict[str, list[tuple[int, str, Any]]]:
    found: dict[str, list[tuple[int, str, Any]]] = {}
    with AnyReader([bag]) as reader:
        for line, time, data in reader.messages():
            found.setdefault(line.topic, []).append((time, line.msgtype, reader.deserialize(data, line.msgtype)))
    return found


def test_it_is_read_back_as_it_was_recorded(recorded: Any) -> None:
    recording, bag = recorded
    found, start = messages(bag), recording.session["start_ns"]
    poses = found["/arm/pose"]
    assert len(poses) == len(recording["arm"]) and {kind for _, kind, _ in poses} == {"geometry_msgs/msg/PoseStamped"}
    for (stamp, _, message), row in zip(poses, recording["arm"], strict=True):
        assert stamp == start + round(row["time"] * 1e9)
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
        assert message.header.frame_id == "device/arm"
        place, turn = message.pose.position, message.pose.orientation
        assert [place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z] == row["pose"].tolist()
    for (_, kind, message), row in zip(found["/table/wrench"], recording["table.wrench"], strict=True):
        force, torque = message.wrench.force, message.wrench.torque
        assert kind == "geometry_msgs/msg/WrenchStamped"
        assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == row.tolist()
    plate = [message.temperature for _, _, message in found["/peltier/plate_temperature"]]
    assert plate == (np.ravel(recording["peltier.plate_temperature"]) - 273.15).tolist()
    assert [message.data for _, _, message in found["/peltier/heat_flux"]] == np.ravel(
        recording["peltier.heat_flux"]
    ).tolist()
    hip = [[message.point.x, message.point.y, message.point.z] for _, _, message in found["/finger/hip"]]
    assert hip == recording["finger.hip"].tolist()
    (mark,) = found["/marks"]
    said = json.loads(mark[2].data)
    assert said["name"] == "begin" and said["tick"] == 100 and json.loads(said["payload"]) == {"trial": 3}


def test_the_tree_of_frames_leads_from_each_device_to_the_world(recorded: Any) -> None:
    frames = messages(recorded[1])["/tf"]
    assert len(frames) >= 6
    above = {one.child_frame_id: one.header.frame_id for one in frames[0][2].transforms}
    for frame in above:
        seen = set()
        while frame != "world":
            assert frame not in seen
            seen.add(frame)
            frame = above[frame]


def test_what_a_scene_chose_of_a_device_is_in_the_frame_of_the_device(tmp_path: Path) -> None:
    text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    mounted = '<device name="arm" plugin="usb-arm"><mount pos="100 0 0 mm"/></device>'
    text = text.replace('<device name="arm" plugin="usb-arm"/>', mounted)
    chosen = '<record to="run.mcap" channels="arm.pose arm.twin.pose finger.proxy" rate="100 Hz"/>'
    (tmp_path / "mounted.xml").write_text(text.replace("</interaction>", f"</interaction>{chosen}"), encoding="utf-8")
    for words in (("run", "mounted.xml", "--headless", "--for", "50ms"), ("export", "run.mcap", "--rosbag", "bag")):
        done = program(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    found = messages(tmp_path / "bag")
    for topic in ("/arm/pose", "/chosen_arm_100Hz/pose", "/chosen_arm_100Hz/twin/pose"):
        _, _, message = found[topic][0]
        assert message.pose.position.x < -0.09 and message.header.frame_id == "device/arm", topic
    assert found["/chosen_finger_100Hz/proxy"][0][2].header.frame_id == "world"


def test_an_existing_bag_is_not_overwritten(recorded: Any, tmp_path: Path) -> None:
    recording, bag = recorded
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    done = program("export", recording.path, "--rosbag", str(bag))
    assert done.returncode == 2 and "is there already" in done.stderr
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    data = Path(recording.path).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    failed = program("export", str(tmp_path / "cut.mcap"), "--rosbag", str(tmp_path / "cut"))
    assert failed.returncode == 2 and "cut.mcap" in failed.stderr and "Traceback" not in failed.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cut.mcap"]
