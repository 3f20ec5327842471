"""Recordings for Rerun: the scene's messages are read back as they were written, and stand where State says.

Rerun itself (170 MB, extra ``[rerun]``) is there in the long form only.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from hypothesis import given
from hypothesis import strategies as st
from program import program
from requirements import need_package
from shipped import SCENES

import itouch
from itouch.recording import RecordingError, read
from itouch.recording.wellknown import MESSAGES, decode, descriptor, encode
from itouch.session.outputs import Outputs, open_outputs
from itouch_tools.export.rerun_viewer import messages

EVERY = 33
WHOLE = st.integers(0, 2**31 - 1)
KINDS: dict[str, st.SearchStrategy[Any]] = {
    "double": st.floats(allow_nan=False), "string": st.text(max_size=8), "bool": st.booleans(), "Type": st.just(0),
    "fixed32[]": st.lists(st.integers(0, 2**32 - 1), max_size=5),
}  # fmt: skip


def contents(name: str) -> st.SearchStrategy[dict[str, Any]]:
    """Return what a message may hold; any of its fields may be absent."""
    if name.startswith("google."):
        return st.fixed_dictionaries({}, optional={"seconds": WHOLE, "nanos": WHOLE})
    fields: dict[str, st.SearchStrategy[Any]] = {}
    for key, _, kind in MESSAGES[name]:
        if kind in KINDS:
            fields[key] = KINDS[kind]
        elif kind.endswith("[]"):
            fields[key] = st.lists(contents(kind[:-2]), max_size=2)
        else:
            fields[key] = contents(kind)
    return st.fixed_dictionaries({}, optional=fields)


def by_the_library(name: str, data: bytes) -> dict[str, Any]:
    """Return a message as the library of Protocol Buffers reads it, by the schema that recordings carry."""
    files = descriptor_pb2.FileDescriptorSet()
    files.ParseFromString(descriptor(name))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    found = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{name}"))()
    found.ParseFromString(data)
    return json_format.MessageToDict(found, preserving_proto_field_name=True, always_print_fields_with_no_presence=True)


def same(ours: Any, theirs: Any) -> bool:
    """Compare, whatever way the library's dictionaries write times, numbers and what is absent."""
    if isinstance(ours, dict) and set(ours) == {"seconds", "nanos"}:
        return isinstance(theirs, str)  # RFC 3339
    if isinstance(ours, dict):
        assert isinstance(theirs, dict)
        return all(same(value, theirs.get(key)) for key, value in ours.items() if value is not None)
    if isinstance(ours, list):
        return len(ours) == len(theirs) and all(map(same, ours, theirs))
    if isinstance(ours, float):
        return float(theirs) == ours
    return theirs == ours or (ours == 0 and theirs in ("ADD", "MATCHING_ID", "UNKNOWN_TYPE", None))


def trimmed(name: str, content: dict[str, Any]) -> dict[str, Any]:
    """Return a message's content with the times away, which have a range of their own in the library's words."""
    kinds = {key: kind for key, _, kind in MESSAGES[name]}
    found = {}
    for key, value in content.items():
        kind = kinds[key].removesuffix("[]")
        if kind.startswith("google."):
            continue
        inner = kind in MESSAGES
        found[key] = (
            ([trimmed(kind, one) for one in value] if isinstance(value, list) else trimmed(kind, value))
            if inner
            else value
        )
    return found


@pytest.mark.parametrize("name", ["FrameTransforms", "SceneUpdate"])
@given(st.data())
def test_messages_are_read_as_the_library_reads_them(name: str, data: st.DataObject) -> None:
    packed = encode(name, trimmed(name, data.draw(contents(name))))
    assert same(decode(name, packed), by_the_library(name, packed))


@given(st.sampled_from(["FrameTransforms", "SceneUpdate"]), st.binary(max_size=60), st.data())
def test_damaged_messages_are_an_error_and_nothing_else(name: str, noise: bytes, data: st.DataObject) -> None:
    packed = bytearray(encode(name, data.draw(contents(name))))
    for place in data.draw(st.lists(st.integers(0, max(0, len(packed) - 1)), max_size=3)):
        if packed:
            packed[place] ^= data.draw(st.integers(1, 255))
    for bytes_ in (bytes(packed), noise, bytes(packed[: len(packed) // 2])):
        try:
            assert set(decode(name, bytes_)) == {key for key, _, _ in MESSAGES[name]}
        except ValueError as error:
            assert str(error)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("rerun") / "a.mcap"
    engine, states = itouch.build(SCENES / "four_materials.xml"), {}
    engine.taps.append(lambda tick: states.update({tick: engine.state.tobytes()}) if tick % EVERY == 0 else None)
    with open_outputs(engine, Outputs(str(path), True, "", 0.0, False)):
        engine.run(8.5)
    engine.close()
    return engine, states, path


def test_the_scene_is_found_with_its_times(session: Any) -> None:
    engine, states, path = session
    compared, solids, state = 0, set(), engine.state.copy()
    for time, name, content in messages(read(path)):
        solids |= {entity["id"] for entity in content.get("entities", ()) if entity["cubes"]}
        tick = round(time / engine.model.period)
        if name != "FrameTransforms" or tick not in states:
            continue
        state.raw.data[:] = states[tick]
        found = {t["child_frame_id"]: t["translation"] for t in content["transforms"]}
        for index, one in enumerate(engine.model.objects):
            assert [found[f"object/{one}"][axis] for axis in "xyz"] == state["objects.pose"][index][:3].tolist()
        compared += 1
    assert compared > 150 and len(solids) >= 5


def test_a_recording_that_was_cut_says_what_to_do(session: Any, tmp_path: Path) -> None:
    data = session[2].read_bytes()
    for count in (len(data) * 2 // 3, len(data) - 1):  # inside its samples, and inside its last line
        (tmp_path / "cut.mcap").write_bytes(data[:count])
        cut = read(tmp_path / "cut.mcap")
        with pytest.raises(RecordingError, match="itouch-py recover") as raised:
            list(messages(cut))
        assert cut.losses[0] in str(raised.value)


class Spy:
    """Stands for a stream of Rerun: keeps what it is sent."""

    def __init__(self) -> None:
        self.sent: dict[str, list[tuple[Any, list[Any]]]] = {}
        self.said: list[str] = []

    def send_columns(self, entity: str, axes: list[Any], columns: list[Any]) -> None:
        times = axes[0].as_arrow_array().cast("int64").to_numpy() / 1e9
        self.sent.setdefault(entity, []).append((times, columns))

    def set_time(self, *_: Any, **__: Any) -> None:
        pass

    def log(self, entity: str, what: Any, **_: Any) -> None:
        if entity == "events":
            self.said += what.text.as_arrow_array().to_pylist()


@pytest.mark.long
def test_rerun_has_it_all_where_it_is(session: Any, tmp_path: Path) -> None:
    """Through Rerun's own package and its command: what is there, and each place to 1e-6 m."""
    need_package("rerun", extra="rerun")
    from itouch_tools.export import rerun_viewer as ours

    engine, states, path = session
    target = tmp_path / "a.rrd"
    done = program("export", str(path), "--rrd", str(target))
    assert done.returncode == 0, done.stderr
    listed = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", str(target)], capture_output=True, text=True
    )
    assert listed.returncode == 0, listed.stderr
    for entity in (
        "/world/object\\/aluminium",
        "/world/finger\\/hip",
        "/curves/N/arm",
        "/curves/degC/peltier",
        "/events",
    ):
        assert entity in listed.stdout, entity

    whole = target.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    failed = program("export", str(tmp_path / "cut.mcap"), "--rrd", str(target))
    assert failed.returncode == 2 and "itouch-py recover" in failed.stderr
    assert target.read_bytes() == whole and not list(tmp_path.glob("*.part"))  # what was there stays
    assert program("recover", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "mended.mcap")).returncode == 0
    assert program("export", str(tmp_path / "mended.mcap"), "--rrd", str(tmp_path / "b.rrd")).returncode == 0

    spy, state, compared = Spy(), engine.state.copy(), 0
    ours.Scene(spy).put(messages(read(path)))
    ((times, columns),) = spy.sent["world/finger\\/hip"]
    places = next(c for c in columns if "translation" in str(c.component_descriptor())).as_arrow_array()
    for time, place in zip(times, places.to_pylist(), strict=True):
        tick = round(time / engine.model.period)
        if tick in states:
            state.raw.data[:] = states[tick]
            assert np.abs(np.array(place[0]) - state["finger.hip"]).max() < 1e-6
            compared += 1
    assert compared > 150


@pytest.mark.long
def test_what_is_told_of_a_running_session_is_where_it_is() -> None:
    """Moment by moment: each place and each curve's number as State has it, and contacts as they come."""
    need_package("rerun", extra="rerun")
    from itouch_tools.viewer.live.published_states import Moment
    from itouch_tools.viewer.live.rerun import Shown

    engine, states, spy = itouch.build(SCENES / "first_touch.xml"), {}, Spy()
    shown = Shown(spy, engine.model, engine.state)
    for _ in range(60):
        moments = []
        for _ in range(8):
            engine.run(0.004)
            moments.append(Moment(int(engine.state["tick"]), 0, engine.state.copy()))
            states[moments[-1].tick] = moments[-1].state
        shown.show(moments)
    engine.close()
    compared = 0
    for times, columns in spy.sent["world/finger\\/hip"]:
        places = next(c for c in columns if "translation" in str(c.component_descriptor())).as_arrow_array()
        for time, place in zip(times, places.to_pylist(), strict=True):
            state = states[round(time / engine.model.period)]
            assert np.abs(np.array(place[0]) - state["finger.hip"]).max() < 1e-6
            compared += 1
    assert compared > 50
    rows = 0
    for times, columns in spy.sent["/curves/m/arm"]:
        for time, row in zip(times, columns[0].as_arrow_array().to_pylist(), strict=True):
            assert row[:3] == states[round(time / engine.model.period)]["arm.pose"][:3].tolist()
            rows += 1
    assert rows > 400
    assert [words.partition(":")[0] for words in spy.said] == ["NEAR", "BEGIN"]


@pytest.mark.long
def test_rerun_is_told_by_another_process(tmp_path: Path) -> None:
    """A session in real time, `view --rerun` beside it, and Rerun's own server, which keeps what it is sent."""
    import socket

    need_package("rerun", extra="rerun")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    kept, address = tmp_path / "live.rrd", f"rerun+http://127.0.0.1:{port}/proxy"
    server = subprocess.Popen([sys.executable, "-m", "rerun", "--port", str(port), "--save", str(kept)])
    try:
        with itouch.launch(SCENES / "first_touch.xml") as handle:
            words = [sys.executable, "-m", "itouch_tools.cli", "view", handle.name, "--rerun", "--to", address]
            view = subprocess.run(words, capture_output=True, text=True, timeout=600)  # until the session ends
        assert view.returncode == 0, view.stderr
    finally:
        server.terminate()
        server.wait(300)
    listed = subprocess.run([sys.executable, "-m", "rerun", "rrd", "print", str(kept)], capture_output=True, text=True)
    for entity in ("/world/finger\\/hip", "/world/object\\/", "/curves/N/arm"):
        assert entity in listed.stdout, entity
