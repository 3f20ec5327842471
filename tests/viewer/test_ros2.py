"""A session as topics of ROS 2: what a listener gets by Zenoh is decoded by the package that is not ours."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from program import program
from shipped import SCENES

import itouch

if not os.environ.get("CI"):
    pytest.importorskip("zenoh_ros2_sdk")

from itouch_evidence.bench_ros2 import listening, measure
from itouch_tools.viewer.live.published_states import Moment
from itouch_tools.viewer.live.ros2 import Place, Topics

START = 1_700_000_000_123_456_789


class Heard:
    """Takes what comes on every topic of a domain, decoded by rosbags; and the tokens by which ROS finds topics."""

    def __init__(self, port: int, domain: int) -> None:
        import zenoh
        from rosbags.typesys import Stores, get_typestore

        self.found: dict[str, list[Any]] = {}
        self.types = get_typestore(Stores.ROS2_JAZZY)
        self.tokens: set[str] = set()
        self._more = threading.Condition()
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self.session = zenoh.open(config)
        self._subscriber = self.session.declare_subscriber(f"{domain}/**", self._take)

    def _take(self, sample: Any) -> None:
        *topic, kind, hashed = str(sample.key_expr).split("/")[1:]
        name = kind.replace("::", "/").replace("/dds_", "").rstrip("_")
        assert hashed == self.types.hash_rihs01(name)
        with self._more:
            message = self.types.deserialize_cdr(sample.payload.to_bytes(), name)
            self.found.setdefault("/" + "/".join(topic), []).append(message)
            self._more.notify_all()

    def wait(self, topic: str, count: int) -> list[Any]:
        with self._more:
            assert self._more.wait_for(lambda: len(self.found.get(topic, ())) >= count, 60), self.found.keys()
            return list(self.found[topic])


@pytest.fixture(scope="module")
def told() -> Iterator[tuple[Any, list[Any], Heard, list[str], set[str]]]:
    """Yield an engine, its States that were told, who listened, the topics and the tokens of discovery."""
    with listening() as (port, _):
        engine = itouch.build(SCENES / "four_materials_hurried.xml")
        engine.run(7.3)
        heard = Heard(port, 7)
        topics = Topics(engine.model, engine.state, Place("127.0.0.1", port, 7))
        states = []
        end = time.monotonic() + 300
        while "/tf" not in heard.found and time.monotonic() < end:  # until the listener is known
            topics.tell(Moment(0, START, engine.state.copy()))
            time.sleep(0.05)
        time.sleep(0.2)
        heard.found.clear()
        for number in range(20):
            if number == 4:
                engine.mark("begin", {"trial": 3})
            engine.run(0.01)
            states.append(engine.state.copy())
            topics.tell(Moment(int(engine.state["tick"]), START + number, states[-1]))
        for name in topics.names:
            if name not in ("/events", "/marks"):
                heard.wait(name, len(states))
        heard.wait("/marks", 1)
        tokens = {str(reply.ok.key_expr) for reply in heard.session.liveliness().get("@ros2_lv/7/**", timeout=600.0)}
        yield engine, states, heard, topics.names, tokens
        topics.close()
        heard.session.close()
        engine.close()


def test_messages_have_the_values_of_state(told: Any) -> None:
    engine, states, heard, _, _ = told
    for number, (state, pose) in enumerate(zip(states, heard.found["/arm/pose"], strict=True)):
        place, turn = pose.pose.position, pose.pose.orientation
        assert [place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z] == state["arm.pose"].tolist()
        assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == START + number
        assert pose.header.frame_id == "device/arm"
    for state, wrench in zip(states, heard.found["/table/wrench"], strict=True):
        force, torque = wrench.wrench.force, wrench.wrench.torque
        assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == state["table.wrench"].tolist()
    flux = [message.data for message in heard.found["/peltier/heat_flux"]]
    assert flux == [float(np.ravel(state["peltier.heat_flux"])[0]) for state in states]
    for state, told_frames in zip(states, heard.found["/tf"], strict=True):
        hip = next(one for one in told_frames.transforms if one.child_frame_id == "finger/hip").transform.translation
        assert [hip.x, hip.y, hip.z] == state["finger.hip"].tolist()


def test_contacts_and_marks_come_once(told: Any) -> None:
    engine, _, heard, _, _ = told
    (mark,) = [json.loads(message.data) for message in heard.found["/marks"]]
    assert mark["name"] == "begin" and mark["payload"] == {"trial": 3}
    (begin,) = [one for message in heard.found["/events"] if (one := json.loads(message.data))["kind"] == "BEGIN"]
    assert begin["object"] == "aluminium" and begin["probe"] == "finger"
    assert begin["time"] == pytest.approx(7.347)


def test_ros_finds_every_topic(told: Any) -> None:
    """By the tokens that rmw_zenoh looks for: node, kind of end, topic and type."""
    _, _, heard, names, tokens = told
    kinds = {"/arm/pose": "geometry_msgs::msg::dds_::PoseStamped_", "/tf": "tf2_msgs::msg::dds_::TFMessage_"}
    for name in names:
        ends = [
            token for token in tokens if f"/MP/%/%/itouch{name.replace('/', '_')}/{name.replace('/', '%')}/" in token
        ]
        assert len(ends) == 1, name
        assert name not in kinds or f"/{kinds[name]}/RIHS01_" in ends[0]


#: Kinds of entity -> what `ros2` calls them; the rules are those of rmw_zenoh's design.md and of `Entity::make`.
KINDS = {"NN": "node", "MP": "publisher", "MS": "subscription", "SS": "service", "SC": "client"}


def entity(token: str) -> dict[str, str]:
    """Return what a token of discovery says, read as strictly as rmw_zenoh does, and by nothing of the SDK that made it."""
    space, domain, session, node, number, kind, *names = token.split("/")
    assert all(token.split("/")), "an empty part: rmw_zenoh refuses the token"
    assert space == "@ros2_lv" and domain == "7"
    assert re.fullmatch(r"[0-9a-f]{1,32}", session)
    assert node.isdecimal() and number.isdecimal() and kind in KINDS
    enclave, namespace, name = (part.replace("%", "/") for part in names[:3])
    said = {"kind": KINDS[kind], "node": node, "name": name, "session": session}
    assert (enclave, namespace) == ("/", "/") and re.fullmatch(r"[A-Za-z_]\w*", name)
    if kind == "NN":
        assert node == number and len(names) == 3
        return said
    topic, of, digest, quality = names[3:]
    assert re.fullmatch(r"[a-z]\w*::(msg|srv)::dds_::\w+_", of)
    assert re.fullmatch(r"RIHS01_[0-9a-f]{64}", digest)
    reliability, durability, history, deadline, lifespan, liveliness = quality.split(":")
    assert reliability in {"", "0", "1", "2", "3", "4"} and durability in {"", "0", "1", "2", "3", "4"}
    for words, count in ((history, 2), (deadline, 2), (lifespan, 2), (liveliness, 3)):
        parts = words.split(",")
        assert len(parts) == count and all(part == "" or part.isdecimal() for part in parts)
    return {**said, "topic": topic.replace("%", "/"), "type": of, "digest": digest, "reliability": reliability}


def test_tokens_are_as_the_design_of_rmw_zenoh_has_them(told: Any) -> None:
    """`ros2 topic list` and `ros2 node list` are made of nothing else; what is measured is told without repetition."""
    _, _, _, names, tokens = told
    found = [entity(token) for token in tokens]
    nodes = {(one["session"], one["node"]): one["name"] for one in found if one["kind"] == "node"}
    ends = [one for one in found if one["kind"] == "publisher"]
    assert sorted(one["topic"] for one in ends) == sorted(names)
    assert all(nodes[one["session"], one["node"]] == one["name"] for one in ends), "an end without its node"
    digests = {one["type"]: one["digest"] for one in ends}
    # what `ros2 topic info --verbose` prints of std_msgs/msg/String
    known = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert digests["std_msgs::msg::dds_::String_"] == known
    assert {one["reliability"] for one in ends if one["topic"].endswith("/pose")} == {"2"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--ros2", "--web"), "choose one"),
        (("--rate", "10"), "go with --ros2"),
        (("--to", "x"), "goes with --rerun"),
        (("--ros2", "--router", "here:x"), "write HOST or HOST:PORT"),
        (("--ros2", "--router", "here:0"), "a port of 1 to 65535"),
        (("--ros2", "--router", "here:65536"), "a port of 1 to 65535"),
        (("--ros2", "--domain", "999"), "0 to 232"),
        (("none-of-this-name", "--ros2"), "no running session named"),
    ],
)
def test_what_can_not_be_told_is_said(words: tuple[str, ...], said: str) -> None:
    done = program("view", *words)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr, done.stderr


@pytest.mark.long
@pytest.mark.punctual  # three processes have to come to their turn a hundred times a second
def test_two_processes_and_a_listener() -> None:
    """A session in real time, `view --ros2` beside it, and who listens here: all moments come, soon."""
    rows = {row["topic"]: row for row in measure(3.0, 100.0)}
    assert {"/arm/pose", "/table/wrench", "/peltier/heat_flux", "/tf"} <= rows.keys()
    for topic in ("/arm/pose", "/table/wrench", "/peltier/heat_flux"):
        assert rows[topic]["messages"] >= 0.9 * 300, rows[topic]
    assert rows["/arm/pose"]["late_p50_ms"] < 100.0


def test_without_git_it_is_imported_all_the_same() -> None:
    words = "from itouch_tools.viewer.live.ros2 import library; library()"
    done = subprocess.run([sys.executable, "-c", words], env={**os.environ, "PATH": "/nowhere"}, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
