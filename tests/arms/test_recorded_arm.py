"""A recording as an arm: it reads the pose that was recorded, tick by tick, and says what a file does not have."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import itouch
from itouch.arms import Recorded, pose_table
from itouch.arms.pose_table import checked, example, from_csv
from itouch.arms.recorded_arm import Played, RecordedParams
from itouch.plugin import ParameterError, Role
from itouch.recording import read
from itouch.recording.tracks import Column, Track
from itouch.testing import DeviceTests
from itouch_tools.cli import main

SOURCE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="0.8 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices>{devices}</devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>{operator}</interaction>{record}</itouch>"""
OPERATOR = """<operator probe="finger"><motion><to pos="0 0 40 mm" in="0.1 s"/><to pos="0 0 26 mm" in="0.3 s" hold="0.2 s"/>
  <to pos="15 0 40 mm" in="0.3 s"/></motion></operator>"""


class TestRecorded(DeviceTests):
    device, name = Recorded, "recorded"


def recorded(attributes: str = "", *, operator: str = "", record: str = "") -> str:
    hardware = f'<r:hardware xmlns:r="urn:itouch:plugin:recorded" {attributes}/>'
    device = f'<device name="arm" plugin="recorded">{hardware}</device>'
    return SOURCE.format(devices=device, operator=operator, record=record)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of the arm's twin, recorded."""
    folder = tmp_path_factory.mktemp("recorded")
    path = folder / "source.xml"
    device = '<device name="arm" plugin="usb-arm"><mount pos="0 0 5 mm"/></device>'
    path.write_text(SOURCE.format(devices=device, operator=OPERATOR, record=""))
    assert main(["run", str(path), "--headless", "--pace", "fast", "--record", str(folder / "touch.mcap")]) == 0
    return folder / "touch.mcap"


def test_the_arm_goes_its_recorded_way_to_the_last_bit(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "touch.mcap").write_bytes(recording.read_bytes())
    path = tmp_path / "again.xml"
    path.write_text(recorded('file="touch.mcap" track="arm"').replace('<device name="arm" plugin="recorded">',
                    '<device name="arm" plugin="recorded"><mount pos="0 0 5 mm"/>'))  # fmt: skip
    was = read(str(recording))["arm"]
    session = itouch.build(path)
    assert session.scripted
    poses = []
    session.run(each=lambda: poses.append(session.state["arm.pose"].copy()))
    assert session.seconds == pytest.approx(was["time"][-1] - was["time"][0], abs=2e-3)
    np.testing.assert_array_equal(poses[: len(was["pose"])], was["pose"][: len(poses)])
    assert len(poses) >= len(was["pose"]) - 2
    assert [contact["object"] for contact in session.report()["contacts"]] == ["block"]
    assert session.report()["contacts"][0]["peak_force_N"] > 0.3


def test_a_session_keeps_the_file_and_goes_on_without_it(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "touch.mcap").write_bytes(recording.read_bytes())
    path = tmp_path / "again.xml"
    path.write_text(recorded('file="touch.mcap"'))
    session = itouch.build(path)
    session.run(0.3)
    session.save(tmp_path / "kept.itouch")
    (tmp_path / "touch.mcap").unlink()
    again = itouch.restore(tmp_path / "kept.itouch")
    session.run(0.3)
    again.run(0.3)
    assert session.state.tobytes() == again.state.tobytes()


def test_a_probes_place_and_an_exported_table_are_motions_too(recording: Path, tmp_path: Path) -> None:
    played = Recorded.bind(RecordedParams(file="x.mcap", track="finger"), lambda *_: recording.read_bytes())
    was = read(str(recording))["finger"]
    np.testing.assert_array_equal(played.poses[:, :3], was["hip"])
    for target, tables in ((tmp_path / "tables", ("arm.csv", "finger.csv")), (tmp_path / "all.csv", ("",))):
        assert main(["export", str(recording), "--csv", str(target)]) == 0
        for name in tables:
            data = (target / name if name else target).read_bytes()
            if not name:  # the whole table has the arm's pose and the finger's place: which one is not for us to say
                with pytest.raises(ParameterError, match="several columns of x"):
                    Recorded.bind(RecordedParams(file="all.csv"), lambda *_, data=data: data)
                continue
            table = Recorded.bind(RecordedParams(file=name), lambda *_, data=data: data)
            column = "pose" if name == "arm.csv" else "hip"
            truth = read(str(recording))[name[:-4]][column]
            np.testing.assert_allclose(table.poses[:, :3], truth[:, :3], atol=1e-15)


def test_without_a_file_it_is_an_example_that_touches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "example.xml"
    path.write_text(recorded())
    out = tmp_path / "report.json"
    assert main(["run", str(path), "--headless", "--report", str(out)]) == 0
    report = json.loads(out.read_text())
    assert report["simulated_s"] == pytest.approx(4.0, abs=2e-3)
    assert [contact["object"] for contact in report["contacts"]] == ["block"]


def test_repeating_it_begins_anew_and_otherwise_it_rests() -> None:
    times, poses = checked(np.array([5.0, 6.0, 7.0]), np.array([(0.0, 0, 0), (0.1, 0, 0), (0.0, 0, 0)]))
    for repeat, places in ((False, [0.0, 0.05, 0.1, 0.0, 0.0]), (True, [0.0, 0.05, 0.1, 0.05, 0.1])):
        played = Played(RecordedParams(repeat=repeat), times, poses)
        assert [played.at(t)[0] for t in (0.0, 0.5, 1.0, 2.5, 5.0)] == pytest.approx(places)
        assert played.duration == (0.0 if repeat else 2.0)


def test_turns_are_read_if_they_are_asked_for() -> None:
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    rows = np.array([(0, 0, 0, 1, 0, 0, 0), (0, 0, 0, *(-2 * np.array(quarter)))])
    times, poses = checked(np.array([0.0, 1.0]), rows)
    sensed = Played(RecordedParams(rotations="sensed"), times, poses)
    eighth = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))
    assert sensed.at(0.5)[3:] == pytest.approx(eighth)  # the short way
    assert Recorded.channels(sensed.params)[0][0].locked == ()
    locked = Played(RecordedParams(), times, poses)
    assert locked.at(0.5)[3:] == [1.0, 0.0, 0.0, 0.0]
    assert Recorded.channels(locked)[0][0].locked == (3, 4, 5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no rows"),
        ("t,x,y,z\n", "0 rows"),
        ("t,x,y,z\n0,0,0,0\n", "1 rows"),
        ("t,x,y\n0,0,0\n1,0,0\n", "no column named z"),
        ("0,0,0\n1,0,0\n", "4 columns"),
        ("t,x,y,z\n0,0,0,0\n0,0,0,0\n", "time does not rise after row 1"),
        ("t,x,y,z\n0,0,0,0\n1,nan,0,0\n", "row 2 holds"),
        ("t,x,y,z\n0,0,0,0\n1,up,0,0\n", "row 2 is not 4 numbers"),
        ("t,x,y,z\n0,0,0,0\n1,0,0\n", "row 2 is not 4 numbers"),
        ("t,x,y,z,qw,qx\n0,0,0,0,1,0\n1,0,0,0,1,0\n", "only qw, qx"),
        ("t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0,0,0,0,0\n", "quaternion of row 2 is zero"),
        ("t [s],x [inch],y,z\n0,0,0,0\n1,0,0,0\n", "unit of column 'x .inch.'"),
        ("t,x,y,z,x\n0,0,0,0,0\n1,0,0,0,0\n", "several columns of x"),
    ],
)
def test_a_table_that_is_no_motion_is_told_at_its_place(
    text: str, words: str, write: Callable[[str, str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    write("way.csv", text)
    path = write("scene.xml", recorded('file="way.csv"'))
    assert main(["check", str(path)]) == 2
    error = capsys.readouterr()
    assert "way.csv" in error.out + error.err
    with pytest.raises(ParameterError, match=words):
        Recorded.bind(RecordedParams(file="way.csv"), lambda *_: text.encode())


def test_units_and_comments_of_a_table() -> None:
    text = "# a comment\ntime [ms],pose.x [mm],pose.y [mm],pose.z [m],other\n10,1,2,0.003,9\n30,2,3,0.004,9\n"
    times, poses = from_csv(text.encode())
    assert times == pytest.approx([0.0, 0.02])
    np.testing.assert_allclose(poses[:, :3], [(1e-3, 2e-3, 3e-3), (2e-3, 3e-3, 4e-3)])


def test_what_a_recording_does_not_have_is_named_with_what_it_has(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "touch.mcap").write_bytes(recording.read_bytes())
    (tmp_path / "other.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(50))
    path = tmp_path / "scene.xml"
    for attributes, words in (
        ('file="touch.mcap" track="amr"', "'amr'.*'arm'"),
        ('file="nowhere.mcap"', "nowhere.mcap"),
        ('file="../touch.mcap"', "touch.mcap"),
        ('file="other.mcap"', "other.mcap"),
    ):
        path.write_text(recorded(attributes))
        assert main(["check", str(path)]) == 2
        shown = capsys.readouterr()
        text = " ".join((shown.out + shown.err).split())
        assert "scene.xml:4" in text, text
        import re

        assert re.search(words, text), text


def test_an_operator_with_a_way_of_his_own_is_refused(write: Callable[[str, str], Path]) -> None:
    path = write("scene.xml", recorded(operator=OPERATOR))
    with pytest.raises(itouch.SceneError, match="its operator has a motion too"):
        itouch.build(path)
    still = write("still.xml", recorded(operator='<operator probe="finger" skin-temperature="30 degC"/>'))
    session = itouch.build(still)
    session.run(0.1)
    assert session.state["arm.pose"][2] == pytest.approx(0.05)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300) | st.text(max_size=300).map(str.encode))
def test_no_table_makes_anything_but_a_motion_or_an_error(data: bytes) -> None:
    try:
        times, poses = from_csv(data)
    except ValueError:
        return
    assert len(times) == len(poses) >= 2
    assert np.isfinite(poses).all()


@settings(max_examples=60, deadline=None)
@given(st.floats(-1.0, 20.0), st.booleans())
def test_at_any_time_it_is_between_its_samples(time: float, repeat: bool) -> None:
    times, poses = example()
    at = Played(RecordedParams(repeat=repeat), times, poses).at(time)
    assert np.isfinite(at).all()
    low, high = poses.min(axis=0), poses.max(axis=0)
    assert (np.array(at) >= low - 1e-12).all() and (np.array(at) <= high + 1e-12).all()


def test_a_column_without_a_unit_is_in_metres_and_seconds() -> None:
    times, poses = from_csv(b"t,x,y,z\n0,0.01,0,0\n0.5,0.02,0,0.03\n")
    assert times == [0.0, 0.5]
    assert poses[:, :3].tolist() == [[0.01, 0.0, 0.0], [0.02, 0.0, 0.03]]


def test_the_example_comes_back_to_its_height_after_four_seconds() -> None:
    times, poses = example()
    assert times[-1] == pytest.approx(4.0) and len(poses) == len(times)
    assert poses[0, 2] == poses[-1, 2] == pytest.approx(0.05)
    assert poses[:, 2].min() == pytest.approx(0.02) and poses[-1, 0] == pytest.approx(0.02)


def test_every_pose_has_a_whole_orientation_whether_one_was_recorded_or_not() -> None:
    """The example lasts as long as its text says."""
    times, rng = np.arange(5) * 0.1, np.random.default_rng(4)
    for width in (3, 7):
        told, poses = checked(times, rng.normal(size=(5, width)))
        assert len(told) == len(poses) == 5
        assert np.linalg.norm(np.asarray(poses)[:, 3:], axis=1) == pytest.approx(1.0)
    assert (np.asarray(checked(times, np.zeros((5, 3)))[1])[:, 3:] == [1.0, 0.0, 0.0, 0.0]).all()
    assert example()[0][0] == 0.0 and example()[0][-1] == pytest.approx(4.0)


def test_of_what_a_device_has_recorded_its_pose_is_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its commands are as wide, and stand first."""
    sent, pose = (
        Column("arm.goal", "goal", "f8", 7, "m"),
        Column("arm.pose", "pose", "f8", 7, "m", role=Role.TRACKED_POSE),
    )
    heat = Column("pad.plate", "plate", "f8", 7, "K", role=Role.SKIN_CONTACT_TEMPERATURE)
    tracks = {"arm": Track("arm", 1, True, (sent, pose)), "pad": Track("pad", 1, True, (heat,))}
    rows = {name: np.zeros(3, track.dtype) for name, track in tracks.items()}
    rows["arm"]["time"] = rows["pad"]["time"] = 0.0, 0.1, 0.2
    rows["arm"]["goal"], rows["pad"]["plate"] = 9.0, 300.0
    rows["arm"]["pose"] = [(0.01 * k, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0) for k in range(3)]
    monkeypatch.setattr(pose_table, "parse", lambda *words: SimpleNamespace(tracks=tracks, rows=rows))
    monkeypatch.setattr(pose_table, "unread", lambda *words: ())
    times, poses = pose_table.from_recording("touch.mcap", b"", "")
    assert times == [0.0, 0.1, 0.2]
    assert poses.tolist() == rows["arm"]["pose"].tolist()
    with pytest.raises(ParameterError, match="no pose of 'pad'.*'arm'"):
        pose_table.from_recording("touch.mcap", b"", "pad")
