"""A session recorded by the writing process: complete, plottable, and lost no more than it says."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from weakref import ref

import numpy as np
import pytest
from campaign import size, tell
from made import record
from shipped import SCENES

import itouch
from itouch.recording.ring import Ring, Shape
from itouch.session import recorder


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[itouch.Session, Path]:
    path = tmp_path_factory.mktemp("recorded") / "r.mcap"
    return record(path, "four_materials", 2.5), path


def test_the_replay_track_has_every_tick(recorded: tuple[itouch.Session, Path]) -> None:
    session, path = recorded
    recording = itouch.read(path)
    assert recording.whole, recording.losses
    assert recording.losses == ()
    assert np.array_equal(recording.ticks, np.arange(int(session.state["tick"])))
    for name, device in session.model.devices.items():
        track = recording[name]
        for channel in device.reads:
            assert np.array_equal(track[channel.name][-1], np.atleast_1d(session.state[f"{name}.{channel.name}"]))
        for channel in device.commands:
            assert np.array_equal(track[f"sent.{channel.name}"][-1], session.state[f"{name}.sent.{channel.name}"])
    assert recording.units["peltier.plate_temperature"] == "K"
    assert recording["arm.pose"].shape == (len(recording.ticks), 7)
    assert recording.scene.startswith("<?xml")
    assert recording.attachments["scene.xml"].decode() == recording.scene


def test_rows_are_the_state_of_their_ticks(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml", seed=4)
    session.record(tmp_path / "r.mcap")
    kept: list[bytes] = []
    session.taps.append(lambda tick: kept.append(session.state["arm.pose"].tobytes()))
    session.run(0.7)
    session.close()
    assert [row.tobytes() for row in itouch.read(tmp_path / "r.mcap")["arm.pose"]] == kept


def test_events_lifecycle_states_and_timing(recorded: tuple[itouch.Session, Path]) -> None:
    session, path = recorded
    recording = itouch.read(path)
    stated = session.state["events.count"].item()
    assert len(recording.events) == stated
    assert {event["kind"] for event in recording.events} <= {"NEAR", "BEGIN", "END"}
    assert {(row["device"], row["status"]) for row in recording.lifecycle} >= {("arm", "enabled"), ("table", "enabled")}
    assert [state["reason"] for state in recording.states] == ["start", "enable"]
    assert recording.timing[-1]["p50"] > 0.0


def test_state_every_ten_seconds(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(tmp_path / "r.mcap")
    session.run(21.0)
    session.close()
    ticks = [s["tick"] for s in itouch.read(tmp_path / "r.mcap").states if s["reason"] == "every"]
    assert len(ticks) == 2
    assert all(abs(tick - expected) <= 64 for tick, expected in zip(ticks, (10_000, 20_000), strict=True))


def test_an_independent_reader_plots_it(recorded: tuple[itouch.Session, Path]) -> None:
    """The library of the format reads it by its index, and Protocol Buffers decode the rows by the schema in it."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.reader import make_reader

    _, path = recorded
    recording = itouch.read(path)
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert {channel.topic for channel in summary.channels.values()} >= {"/arm", "/table", "/peltier", "/log/events"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"protobuf", "jsonschema"}
        seen, times = 0, []
        for schema, channel, message in reader.iter_messages(topics=["/arm", "/log/events"], log_time_order=True):
            times.append(message.log_time)
            assert schema is not None
            if channel.topic == "/log/events":
                assert json.loads(message.data)["probe"] == "finger"
                continue
            files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
            pool = descriptor_pool.DescriptorPool()
            for file in files.file:
                pool.Add(file)
            row = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString(message.data)
            expected = recording["arm"][seen]
            assert row.tick == expected["tick"]
            assert [row.pose.x, row.pose.qw] == [expected["pose"][0], expected["pose"][3]]
            assert row.sent_wrench.z == expected["sent.wrench"][2]
            assert row.status == expected["status"]
            seen += 1
            if seen > 40:
                break
        assert times == sorted(times)


def test_chosen_channels_at_their_rates(scenes: Path) -> None:
    path = scenes / "first_touch.xml"
    text = path.read_text(encoding="utf-8")
    more = '<record to="out/{scene}.mcap" channels="finger.normal finger.*force" rate="250 Hz"><channels of="tick" rate="10 Hz"/></record>'
    path.write_text(text.replace("</itouch>", more + "</itouch>"), encoding="utf-8")
    folder = os.getcwd()
    os.chdir(scenes)
    try:
        session = itouch.build(path)
        session.run(0.5)
        session.close()
        again = itouch.build(path)
        again.run(0.1)
        again.close()
        recording = itouch.read("out/first_touch.mcap")
        assert sorted(os.listdir("out")) == ["first_touch-2.mcap", "first_touch.mcap"]
    finally:
        os.chdir(folder)
    assert len(recording["chosen/finger/250Hz"]) == 125
    assert list(recording["chosen/session/10Hz"]["tick"]) == [0, 100, 200, 300, 400]
    assert recording["finger.normal"].shape == (125, 3)
    assert recording["finger.hip"].shape == (500, 3)
    assert itouch.write(session.scene).count("<record") == 1
    assert itouch.restore(_saved(session, scenes)).scene == session.scene


def _saved(session: itouch.Session, folder: Path) -> Path:
    session.save(folder / "s.itouch")
    return folder / "s.itouch"


@pytest.mark.parametrize(
    ("attributes", "code"),
    [('to="x.mcap" channels="nothing.there"', "unknown-channel"), ('to="../x.mcap"', "bad-value"),
     ('to="/tmp/x.mcap"', "bad-value"), ('to="x.txt"', "bad-value"), ('to="x.mcap" channels="tick" rate="300 Hz"', "unknown-channel")],
)  # fmt: skip
def test_bad_attributes_of_a_record_are_refused(scenes: Path, attributes: str, code: str) -> None:
    path = scenes / "first_touch.xml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("</itouch>", f"<record {attributes}/></itouch>"), encoding="utf-8")
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(path).run(0.1)
    assert [problem.code for problem in caught.value.problems] == [code]
    assert caught.value.problems[0].place is not None


@pytest.mark.parametrize(
    ("channel", "said"),
    [
        ("events.table", "'events.table' cannot be chosen: it is a table"),
        ("marks.tab*", "'marks.table' cannot be chosen: it is a table"),
        ("Finger.Force", "did you mean 'finger.force'?"), ("finger.velocty", "did you mean 'finger.velocity'?"),
        ("fingr.*", "`itouch-py inspect SCENE` lists them"),
    ],
)  # fmt: skip
def test_a_channel_that_cannot_be_chosen_is_told_with_what_can(scenes: Path, channel: str, said: str) -> None:
    """A table is listed among the channels of the reference: that there is none of this name was not so."""
    path = scenes / "first_touch.xml"
    asked = f'<record to="x.mcap" channels="{channel}"/></itouch>'
    path.write_text(path.read_text(encoding="utf-8").replace("</itouch>", asked), encoding="utf-8")
    with pytest.raises(itouch.SceneError, match="unknown-channel") as caught:
        itouch.build(path).run(0.1)
    assert said in str(caught.value)


def test_marks_are_in_state_and_recording(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(tmp_path / "r.mcap")
    session.run(0.1)
    session.mark("trial", {"number": 3, "material": "wood"})
    session.run(0.1)
    for number in range(20):
        session.mark(f"m{number}")
    session.close()
    session.save(tmp_path / "s.itouch")
    assert [mark["name"] for mark in itouch.restore(tmp_path / "s.itouch").marks] == [f"m{n}" for n in range(12, 20)]
    marks = itouch.read(tmp_path / "r.mcap").marks
    assert marks[0] == {"tick": 100, "time": 0.1, "name": "trial", "payload": '{"number":3,"material":"wood"}'}
    assert len(marks) == 21
    for name, payload in (("", None), ("x" * 33, None), ("a\nb", None), ("a", {"x": "y" * 600}), ("a", {1j})):
        with pytest.raises(ValueError, match="mark"):
            session.mark(name, payload)


def test_nothing_is_lost_on_the_virtual_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ring of 64 rows, and a writing process that is slower than the loop: the loop waits."""
    monkeypatch.setattr("itouch.session.recorder.ROWS", 64)
    session = itouch.build(SCENES / "first_touch.xml")
    recorder = session.record(tmp_path / "r.mcap")
    session.run(2.0)
    session.close()
    assert recorder.lost == 0
    assert itouch.read(tmp_path / "r.mcap").whole


def test_a_recording_that_is_still_written_can_be_read_and_is_not_called_cut(tmp_path: Path) -> None:
    """A file that is looked into during the session was said to be cut, or its writer to be killed."""
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(tmp_path / "r.mcap")
    losses: tuple[str, ...] = ()
    for _ in range(600):  # what has been written by now may end anywhere
        session.run(0.1)
        try:
            losses = itouch.read(tmp_path / "r.mcap").losses
        except itouch.RecordingError:
            continue
        if any("without an end of its data" in loss for loss in losses):
            break
    session.close()
    assert any("it is still being written" in loss for loss in losses)
    assert itouch.read(tmp_path / "r.mcap").losses == ()


def test_what_is_lost_in_real_time_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The writing process is held; a full ring drops samples, says how many, and the loop does not wait."""
    monkeypatch.setattr("itouch.session.recorder.ROWS", 64)
    session = itouch.build(SCENES / "first_touch.xml")
    recorder = session.record(tmp_path / "r.mcap")
    session.run(0.05)
    session.clock = itouch.WallClock()
    os.kill(recorder.process_id, signal.SIGSTOP)
    for _ in range(500):
        session.tick()
    os.kill(recorder.process_id, signal.SIGCONT)
    time.sleep(0.3)
    for _ in range(20):
        session.tick()
    session.close()
    recording = itouch.read(tmp_path / "r.mcap")
    assert recorder.lost == recording.lost > 300
    assert recording.losses == (f"{recorder.lost} samples were lost while recording",)
    ticks = recording.ticks
    rows = recording["arm"]
    assert np.array_equal(rows["tick"], ticks)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
@pytest.mark.parametrize("real", [False, True])
def test_marks_are_lost_in_real_time_alone(real: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More of them come than there is room for, while the writing process is held until the loop waits for it."""
    monkeypatch.setattr(recorder, "LETTERS", 1 << 12)
    session = itouch.build(SCENES / "first_touch.xml")
    recording = session.record(tmp_path / "r.mcap")
    session.run(0.05)
    if real:
        session.clock = itouch.WallClock()
    waits = list[float]()

    def wait(seconds: float) -> None:
        waits.append(seconds)
        os.kill(recording.process_id, signal.SIGCONT)
        time.sleep(seconds)

    monkeypatch.setattr(recorder, "time", SimpleNamespace(sleep=wait, monotonic=time.monotonic))
    os.kill(recording.process_id, signal.SIGSTOP)
    for number in range(2000):
        session.mark(f"m{number}", {"why": "x" * 480})
    found = (recording.lost > 0, waits == [])
    os.kill(recording.process_id, signal.SIGCONT)
    session.close()
    assert found == (real, real)
    assert (len(itouch.read(tmp_path / "r.mcap").marks) < 2000) == real


def test_a_full_disk_stops_recording_and_the_session_goes_on(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    with pytest.raises(itouch.RecordingError, match=r"cannot write '/dev/full': No space left on device"):
        session.record("/dev/full")
    session.run(0.2)
    assert int(session.state["tick"]) == 200


def test_the_death_of_the_writing_process_is_a_fault(scenes: Path, tmp_path: Path) -> None:
    for policy, ticks in (("go-on", 1000), ("stop", 300)):
        path = scenes / "first_touch.xml"
        text = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
        element = f'<record to="{policy}.mcap" on-failure="{policy}"/>'
        path.write_text(text.replace("</itouch>", element + "</itouch>"), encoding="utf-8")
        session = itouch.build(path)
        recorder = session.record(tmp_path / f"{policy}.mcap")
        session.run(0.3)
        deadline = time.monotonic() + 300.0
        while len(itouch.read(tmp_path / f"{policy}.mcap").ticks) < 50 and time.monotonic() < deadline:
            time.sleep(0.01)
        os.kill(recorder.process_id, signal.SIGKILL)
        recorder._process.wait()
        session.run(0.7)
        fault = session.report()["faults"][0]
        assert fault["trip"] == "recording"
        assert f"{policy}.mcap" in fault["cause"]
        assert (int(session.state["tick"]) == 1000) == (policy == "go-on")
        assert int(session.state["tick"]) >= ticks
        session.close()
        assert len(itouch.read(tmp_path / f"{policy}.mcap").ticks) >= 50


KILLED = """
import itouch, os, sys
session = itouch.build(sys.argv[1])
session.clock = itouch.WallClock()
session.record(sys.argv[2])
clock = os.open(sys.argv[3], os.O_WRONLY | os.O_CREAT)
def each():
    os.pwrite(clock, b"%010d" % int(session.state["tick"]), 0)
session.run(30.0, each=each)
"""


@pytest.mark.punctual
@pytest.mark.campaign
@pytest.mark.parametrize("victim", ["session", "recorder"])
def test_kill_loses_at_most_a_quarter_of_a_second(victim: str, tmp_path: Path) -> None:
    """kill -9 of the session's process, or of the one that writes, while it runs in real time."""
    worst = 0.0
    for number in range(size(1, 50)):
        path, clock = tmp_path / f"k{number}.mcap", tmp_path / "tick"
        clock.unlink(missing_ok=True)
        running = subprocess.Popen(
            [sys.executable, "-c", KILLED, str(SCENES / "first_touch.xml"), str(path), str(clock)],
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            deadline = time.monotonic() + 300.0
            while not (clock.exists() and clock.read_bytes() and int(clock.read_bytes()) > 300 + 37 * number):
                assert running.poll() is None
                assert time.monotonic() < deadline
                time.sleep(0.01)
            if victim == "recorder":
                child = int(_children(running.pid)[0])
                os.kill(child, signal.SIGKILL)
                at = int(clock.read_bytes())
                time.sleep(0.1)
            else:
                at = int(clock.read_bytes())
        finally:
            running.kill()
            running.wait()
        if victim == "session":  # the process that writes sees that it is alone, writes what it has, and ends
            deadline = time.monotonic() + 300.0
            while not itouch.read(path).whole and time.monotonic() < deadline:
                time.sleep(0.05)
        ticks = itouch.read(path).ticks
        worst = max(worst, (at - ticks[-1]) * 1e-3)
        assert np.array_equal(ticks, np.arange(ticks[-1] + 1))
        assert ticks[-1] >= at - 250
    tell(f"kill -9 of the {victim}: at most {worst * 1e3:.0f} ms lost")


def _children(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()


def test_ring_letters_wrap_and_refuse() -> None:
    ring = Ring.create(Shape(8, 16, 256))
    generator = np.random.default_rng(1)
    sent, got = [], []
    for number in range(500):
        data = generator.bytes(int(generator.integers(0, 90)))
        if ring.post(number % 7, data):
            sent.append((number % 7, data))
        if generator.random() < 0.5:
            letter = ring.take()
            got += [letter] if letter is not None else []
    while (letter := ring.take()) is not None:
        got.append(letter)
    assert got == sent
    assert len(sent) > 200
    assert not ring.post(1, bytes(300))
    ring.close()


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
def test_a_run_that_is_asked_to_end_does_not_wait_for_a_writing_process_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the virtual clock the loop waits for room in the ring; a disk may hang for hours, and Ctrl-C did nothing."""
    monkeypatch.setattr(recorder, "_ENOUGH", 0.5)
    session = itouch.build(SCENES / "first_touch.xml")
    writer = session.record(tmp_path / "r.mcap").process_id
    ended = threading.Event()
    let_go = list[bool]()

    def ask() -> None:
        before = -1.0
        while session.seconds > before or before < 5.0:  # until the ring is full
            before = session.seconds
            time.sleep(0.5)
        session.stop()
        let_go.append(not ended.wait(60.0))
        os.kill(writer, signal.SIGCONT)

    os.kill(writer, signal.SIGSTOP)
    asking = threading.Thread(target=ask)
    asking.start()
    session.run(3000.0)
    ended.set()
    asking.join()
    assert let_go == [False]
    session.close()
    assert itouch.read(tmp_path / "r.mcap").whole
    assert session.seconds < 100.0


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_while_the_loop_waits_for_room_loses_no_tick(
    presses: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A notebook raises it in the midst of the wait, in which a fast simulation spends most of its time."""
    session, waits = itouch.build(SCENES / "first_touch.xml"), list[float]()
    recording = session.record(tmp_path / "r.mcap")

    def wait(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) <= presses:
            raise KeyboardInterrupt
        os.kill(recording.process_id, signal.SIGCONT)
        time.sleep(seconds)

    monkeypatch.setattr(recorder, "time", SimpleNamespace(sleep=wait, monotonic=time.monotonic))
    os.kill(recording.process_id, signal.SIGSTOP)
    with pytest.raises(KeyboardInterrupt):
        session.run(20.0)
    assert session.ticks == recorder.ROWS + 1
    session.run(1.0)
    session.close()
    lost = presses - 1  # somebody who presses it again wants no more to be waited for
    read = itouch.read(tmp_path / "r.mcap")
    assert len(waits) > presses and recording.lost == lost
    assert np.array_equal(read.ticks, np.delete(np.arange(session.ticks), recorder.ROWS if lost else []))


def test_a_recording_that_has_ended_leaves_nothing_for_a_garbage_collection(tmp_path: Path) -> None:
    """In real time there is none while a session runs: each recording kept its ring, 6 MB, and a file descriptor."""
    session, enabled = itouch.build(SCENES / "first_touch.xml"), gc.isenabled()
    gc.disable()
    try:
        recording = ref(session.record(tmp_path / "r.mcap"))
        session.run(0.5)
        session.end_recording()
        assert recording() is None
    finally:
        if enabled:
            gc.enable()
    session.close()


def test_a_report_that_is_larger_than_the_ring_is_left_out_of_the_recording(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    fault = {"device": "arm", "tick": 0, "time_s": 0.0, "trip": "not-a-number", "cause": "x" * 1000, "scene": None}
    session.statistics.faults.extend([dict(fault) for _ in range(5000)])  # as after a campaign of re-armed trips
    session.record(tmp_path / "r.mcap")
    session.run(0.5)
    session.close()
    recording = itouch.read(tmp_path / "r.mcap")
    assert recording.whole and len(recording.ticks) == 500
    assert not recording.report
