"""The commands that keep, look at and give out sessions, as a user calls them."""

from __future__ import annotations

import csv
import gzip
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from program import program
from shipped import SCENES

import itouch
from itouch.session.recorder import Recorder
from itouch_tools.cli import main
from itouch_tools.export import bids, tables


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    words = [str(SCENES / "first_touch.xml"), "--headless", "--for", "1.5s", "--seed", "4"]
    words += ["--record", str(folder / "r.mcap"), "--save", str(folder / "s.itouch"), "--save-every", "0.4s"]
    assert main(words) == 0
    return folder


def test_a_session_goes_on_from_its_snapshot_and_from_its_xml(kept: Path, tmp_path: Path) -> None:
    assert main(["export", str(kept / "s.itouch"), "--xml", str(tmp_path / "s.xml")]) == 0
    ends = []
    for name, path in (("a", kept / "s.itouch"), ("b", tmp_path / "s.xml")):
        saved = tmp_path / f"{name}.itouch"
        assert main([str(path), "--headless", "--for", "0.5s", "--save", str(saved)]) == 0
        ends.append(itouch.restore(saved).state.tobytes())
    assert ends[0] == ends[1]
    straight = itouch.build(SCENES / "first_touch.xml", seed=4)
    straight.run(2.0)
    assert ends[0] == straight.state.tobytes()
    assert main(["check", str(tmp_path / "s.xml")]) == 0
    assert main(["export", str(tmp_path / "s.xml"), "--itouch", str(tmp_path / "c.itouch")]) == 0
    assert itouch.restore(tmp_path / "c.itouch").state == itouch.restore(kept / "s.itouch").state


@pytest.mark.parametrize("name", ["r.mcap", "s.itouch"])
def test_inspect_tells_the_facts_of_a_recording_and_a_session(
    kept: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(kept / name)]) == 0
    text = capsys.readouterr().out
    assert "first_touch.xml" in text
    assert main(["inspect", str(kept / name), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["seconds"] == 1.5
    assert facts["seed"] == 4
    if name == "r.mcap":
        assert {"track": "arm", "channel": "pose", "size": 7, "unit": "m", "rate_hz": 1000.0, "samples": 1500} in facts[
            "channels"
        ]
        assert facts["contacts"][0]["object"] == "block"
        assert facts["whole"]


def test_inspect_of_a_scene_tells_whose_each_fact_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(SCENES / "four_materials.xml")]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    said = "devices arm (plugin usb-arm, twin True), table (plugin xyz-table, twin True), peltier (plugin thermal, twin"
    assert any(line.startswith(said) for line in lines)
    assert any("heat (plugin thermal), flux-control (plugin thermal, commands peltier.current)" in one for one in lines)


def test_inspect_of_a_scene_lists_what_can_be_recorded(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(SCENES / "four_materials.xml"), "--json"]) == 0
    channels = {row["channel"]: row for row in json.loads(capsys.readouterr().out)["channels"]}
    assert channels["peltier.plate_temperature"]["unit"] == "K"
    assert channels["heat.desired"]["unit"] == "W/m^2"
    assert not [row for row in channels.values() if "](" in row["meaning"]], "links of the documentation, raw"
    assert {channels[name]["unit"] for name in ("finger.memory", "finger.result")} == {"mixed"}


def test_csv_has_units_and_degrees_celsius(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "four_materials.xml")
    session.record(tmp_path / "r.mcap")
    session.run(0.05)
    session.close()
    assert (
        main(
            [
                "export",
                str(tmp_path / "r.mcap"),
                "--csv",
                str(tmp_path / "all.csv"),
                "--parquet",
                str(tmp_path / "p.parquet"),
            ]
        )
        == 0
    )
    with open(tmp_path / "all.csv", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert len(rows) == 51
    head = rows[0]
    recording = itouch.read(tmp_path / "r.mcap")
    column = head.index("peltier.plate_temperature [degC]")
    kelvin = recording["peltier.plate_temperature"][:, 0]
    assert [float(row[column]) for row in rows[1:]] == (kelvin - 273.15).tolist()
    assert "arm.sent.wrench.x [N]" in head
    assert "arm.sent.wrench.rx [N*m]" in head
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(tmp_path / "p.parquet")
    assert table["peltier.plate_temperature"].to_pylist() == kelvin.tolist()
    assert table.schema.field("arm.pose.x").metadata == {b"unit": b"m"}
    assert main(["export", str(tmp_path / "r.mcap"), "--parquet", str(tmp_path / "each")]) == 0
    assert {path.stem for path in (tmp_path / "each").iterdir()} == set(recording.tracks)
    each = pyarrow.parquet.read_table(tmp_path / "each" / "peltier.parquet")
    assert each["plate_temperature"].to_pylist() == kelvin.tolist()
    frame = recording.pandas("peltier")
    assert frame.index.name == "time"
    assert frame["plate_temperature"].tolist() == kelvin.tolist()


def test_one_table_has_the_channels_that_a_scene_chose_at_servo_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = '<record to="r.mcap" channels="finger.velocity"><channels of="arm.felt" rate="250 Hz"/></record></itouch>'
    scene = (SCENES / "first_touch.xml").read_text(encoding="utf-8").replace("</itouch>", chosen)
    (tmp_path / "s.xml").write_text(scene, encoding="utf-8")
    made = [str(tmp_path / "s.xml"), "--headless", "--for", "0.3s", "--record", str(tmp_path / "r.mcap")]
    assert main(made) == 0
    words = ["--csv", str(tmp_path / "r.csv"), "--parquet", str(tmp_path / "r.parquet")]
    assert main(["export", str(tmp_path / "r.mcap"), *words]) == 0
    told = capsys.readouterr().err
    assert "other rates: chosen/arm/250Hz.felt; " in told
    assert "velocity" not in told
    speed = itouch.read(tmp_path / "r.mcap")["chosen/finger/1000Hz"]["velocity"]
    assert np.ptp(speed[:, 2]) > 0.01
    with open(tmp_path / "r.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["chosen/finger/1000Hz.velocity.z [m/s]"]) for row in rows] == speed[:, 2].tolist()
    said = (tmp_path / "r.columns.csv").read_text(encoding="utf-8")
    assert 'chosen/finger/1000Hz.velocity.z,m/s,"its velocity' in said
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(tmp_path / "r.parquet")
    assert table["chosen/finger/1000Hz.velocity.x"].to_pylist() == speed[:, 0].tolist()


@pytest.mark.parametrize("words", [["--csv", "t.csv"], ["--csv", "t"], ["--parquet", "t.parquet"], ["--bids", "t"]])
def test_an_export_that_is_interrupted_leaves_the_tables_of_the_one_before(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    """Half a table looks like a whole one of a shorter recording."""
    import pyarrow.parquet

    monkeypatch.chdir(tmp_path)
    command = ["export", str(kept / "r.mcap"), *words]
    assert main(command) == 0

    def found() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def lines(*_: object) -> Iterator[str]:
        yield "0.0,0\n"
        raise KeyboardInterrupt

    def write_table(_: object, path: str) -> None:
        Path(path).write_bytes(b"PAR1")
        raise KeyboardInterrupt

    before = found()
    for module in (tables, bids):
        monkeypatch.setattr(module, "lines", lines)
    monkeypatch.setattr(pyarrow.parquet, "write_table", write_table)
    assert main(command) == 130
    assert found() == before


@pytest.mark.parametrize("option", [["--seed", "5"], ["--twin", "all"]])
def test_a_session_has_its_own_seed_and_devices(
    kept: Path, option: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(kept / "s.itouch"), "--headless", *option]) == 2
    assert "own" in capsys.readouterr().err


def test_going_on_from_a_recording_says_where_the_contacts_before_are(
    kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(kept / "r.mcap"), "--headless", "--pace", "fast", "--for", "10ms", "--no-record"]) == 0
    assert "contacts before it stand in the recording" in capsys.readouterr().err


def test_a_trace_of_twins_is_told_to_be_empty(tmp_path: Path) -> None:
    words = (
        "run",
        SCENES / "first_touch.xml",
        "--headless",
        "--pace",
        "fast",
        "--for",
        "10ms",
        "--no-record",
        "--trace",
    )
    assert "nothing goes over a wire" in program(*words, tmp_path / "wire.txt").stderr


def test_bids_has_a_sidecar_with_every_unit(kept: Path, tmp_path: Path) -> None:
    assert main(["export", str(kept / "r.mcap"), "--bids", str(tmp_path), "--subject", "07", "--task", "touch"]) == 0
    stem = tmp_path / "sub-07" / "beh" / "sub-07_task-touch"
    sidecar = json.loads(Path(f"{stem}_recording-arm_physio.json").read_text(encoding="utf-8"))
    with gzip.open(f"{stem}_recording-arm_physio.tsv.gz", "rt") as stream:
        rows = [line.rstrip("\n").split("\t") for line in stream]
    assert sidecar["SamplingFrequency"] == 1000.0
    assert all(len(row) == len(sidecar["Columns"]) for row in rows)
    assert {sidecar[name]["Units"] for name in sidecar["Columns"]} >= {"m", "N", "s"}
    pose = [float(row[sidecar["Columns"].index("pose.z")]) for row in rows]
    assert np.array_equal(pose, itouch.read(kept / "r.mcap")["arm.pose"][:, 2])
    events = Path(f"{stem}_events.tsv").read_text(encoding="utf-8").splitlines()
    assert events[0].split("\t") == ["onset", "duration", "trial_type", "value", "source"]
    assert any(line.split("\t")[2:] == ["contact", "block", "finger"] for line in events)
    described = json.loads((tmp_path / "dataset_description.json").read_text(encoding="utf-8"))
    assert described["Authors"] and (tmp_path / "README").is_file()
    packed = Path(f"{stem}_recording-arm_physio.tsv.gz").read_bytes()
    assert packed[3] == 0  # no flag says that a file's name follows


def test_bids_has_the_poses_as_motion(kept: Path, tmp_path: Path) -> None:
    words = ["--bids", str(tmp_path), "--task", "touch", "--author", "A. Lab", "--author", "B. Lab"]
    assert main(["export", str(kept / "r.mcap"), *words]) == 0
    described = json.loads((tmp_path / "dataset_description.json").read_text(encoding="utf-8"))
    assert described["Authors"] == ["A. Lab", "B. Lab"]
    stem = str(tmp_path / "sub-01" / "motion" / "sub-01_task-touch_tracksys-arm")
    channels = [line.split("\t") for line in Path(f"{stem}_channels.tsv").read_text(encoding="utf-8").splitlines()]
    assert channels[0][:5] == ["name", "component", "type", "tracked_point", "units"]
    assert [row[1] for row in channels[1:8]] == ["x", "y", "z", "quat_w", "quat_x", "quat_y", "quat_z"]
    rows = np.loadtxt(f"{stem}_motion.tsv", delimiter="\t")
    assert np.array_equal(rows[:, :7], itouch.read(kept / "r.mcap")["arm.pose"])
    sidecar = json.loads(Path(f"{stem}_motion.json").read_text(encoding="utf-8"))
    assert sidecar["SpatialAxes"] == "n/a"  # where the device's own axes point, its mount in the scene says
    world = json.loads(Path(f"{stem}_motion.json".replace("-arm_", "-finger_")).read_text(encoding="utf-8"))
    assert world["SpatialAxes"] == "RAS"
    assert "world" in world["Description"]
    assert (sidecar["RecordingType"], sidecar["EpochLength"]) == ("continuous", 0)  # no epochs, as BIDS has it
    assert (
        sidecar["SamplingFrequency"] == 1000.0 and sidecar["MotionChannelCount"] == len(channels) - 1 == rows.shape[1]
    )


def test_the_official_validator_of_bids_has_nothing_to_say(kept: Path, tmp_path: Path) -> None:
    pytest.importorskip("bids_validator_deno", reason="pip install -e '.[bids]'")
    import subprocess
    import sys

    assert main(["export", str(kept / "r.mcap"), "--bids", str(tmp_path)]) == 0
    program = Path(sys.executable).with_name("bids-validator-deno")
    done = subprocess.run([str(program), str(tmp_path), "--json"], capture_output=True, text=True, check=False)
    found = json.loads(done.stdout)["issues"]["issues"]
    assert [issue["code"] for issue in found] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [(["export", "{r}"], "say what to write"),
     (["export", "{r}", "--xml", "x.xml"], "is not a session"), (["export", "{s}", "--csv"], "say what to write a session as"),
     (["export", "{r}", "--bids", "{d}", "--subject", "0 7"], "letters and digits"),
     (["export", "{r}", "--csv", "/nowhere/at/all.csv"], "there is no folder '/nowhere/at'"),
     (["inspect", "none.mcap"], "cannot read 'none.mcap'"), (["recover", "none.mcap"], "cannot read 'none.mcap'"),
     (["run", "{x}", "--save-every", "1s"], "--save-every needs --save"),
     (["run", "{x}", "--record", "/dev/full", "--headless"], "No space left on device"),
     (["run", "{x}", "--record", "{d}/a.mcap", "--no-record"], "exclude one another")],
)  # fmt: skip
def test_commands_that_cannot_work_say_why_in_one_message(
    words: list[str], said: str, kept: Path, tmp_path: Path
) -> None:
    names = {"r": kept / "r.mcap", "s": kept / "s.itouch", "x": SCENES / "first_touch.xml", "d": tmp_path}
    done = program(*(word.format(**names) for word in words))
    assert done.returncode == 2 and said in done.stderr


@pytest.mark.parametrize("name", ["a.session", "b.mcap", "c.xml", "d"])
def test_a_saved_session_is_known_by_its_content(
    kept: Path, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(kept / "s.itouch", name)
    done = program(name, "--headless", "--for", "10ms", "--save", name)
    assert done.returncode == 0, done.stderr
    facts = json.loads(program("inspect", name, "--json").stdout)
    assert (facts["kind"], facts["seconds"]) == ("session", 1.51)
    assert program("export", name, "--xml", "document").returncode == 0
    assert program("document", "--headless", "--for", "10ms", "--save", "e.itouch").returncode == 0
    assert itouch.restore("e.itouch").seconds == pytest.approx(1.52)


@pytest.mark.parametrize("words", [["check", "{}"], ["safety-report", "{}"], ["study", "check", "{}"]])
@pytest.mark.parametrize(
    ("name", "said"),
    [("s.itouch", "is a saved session, not an XML document"), ("r.mcap", "is a recording, not an XML document")],
)
def test_what_is_stored_and_no_scene_is_told_with_what_takes_it(
    kept: Path, words: list[str], name: str, said: str, tmp_path: Path
) -> None:
    shutil.copy(kept / name, tmp_path)
    done = program(*(word.format(name) for word in words), cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr and f"`itouch-py inspect {name}`" in done.stderr and "not-a-scene" in done.stderr


def test_a_batch_of_a_saved_session_is_told_what_takes_it(kept: Path) -> None:
    with pytest.raises(itouch.SceneError, match="is a saved session(.|\n)*itouch.restore"):
        itouch.batch(kept / "s.itouch", seeds=[1], until=0.01)


def test_check_finds_channels_that_there_are_not(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scenes / "first_touch.xml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("</itouch>", '<record to="x.mcap" channels="fingr.hip"/></itouch>'), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert "no channel is named 'fingr.hip'" in capsys.readouterr().err


def test_an_interrupted_run_leaves_a_whole_recording(tmp_path: Path) -> None:
    import signal
    import time

    words = [sys.executable, "-m", "itouch_tools.cli", str(SCENES / "first_touch.xml"), "--headless", "--pace", "real"]
    running = subprocess.Popen([*words, "--for", "60s", "--record", str(tmp_path / "r.mcap")], stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)  # fmt: skip
    deadline = time.monotonic() + 300.0
    while not ((tmp_path / "r.mcap").exists() and (tmp_path / "r.mcap").stat().st_size > 30_000):
        assert running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    running.wait(300)
    recording = itouch.read(tmp_path / "r.mcap")
    assert recording.whole, recording.losses
    assert len(recording.ticks) > 100


def test_a_run_in_real_time_reports_though_it_could_not_be_saved(tmp_path: Path) -> None:
    saved = tmp_path / f"{'n' * 249}.itouch"  # a longer name than a file may have, with what it is called meanwhile
    words = [str(SCENES / "first_touch.xml"), "--headless", "--pace", "real", "--for", "0.3s", "--save", str(saved)]
    done = program("run", *words, "--report", str(tmp_path / "r.json"))
    assert done.returncode == 2
    assert "cannot save" in done.stderr
    assert "0 faults" in done.stdout
    assert json.loads((tmp_path / "r.json").read_text())["simulated_s"] == pytest.approx(0.3)


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights on Windows")
def test_what_is_recovered_goes_where_a_link_points_and_nothing_is_left_of_what_fails(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "disk").mkdir()
    link = tmp_path / "whole.mcap"
    link.symlink_to("disk/w.mcap")
    words = ["recover", str(kept / "r.mcap"), "-o", str(link)]

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("itouch.recording.writer.McapWriter.finish", fail)
        assert main(words) == 2
    assert capsys.readouterr().err.splitlines()[-1] == f"cannot write '{link}': No space left on device"
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["disk", "whole.mcap"]
    assert main(words) == 0
    assert link.is_symlink() and itouch.read(link).whole
    link.unlink()
    link.symlink_to("/dev/null")
    assert main(words) == 2
    assert "it is a pipe or a device, not a file" in capsys.readouterr().err
    assert link.is_symlink() and Path("/dev/null").is_char_device()


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs a disk that is always full")
def test_of_report_and_session_each_that_cannot_be_written_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    words = [str(SCENES / "first_touch.xml"), "--headless", "--for", "10ms", "--quiet"]
    assert main([*words, "--report", "/dev/full", "--save", "/dev/full"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert told[-2:] == [f"cannot {what} '/dev/full': No space left on device" for what in ("write", "save")]


def test_a_recording_that_cannot_be_finished_takes_neither_report_nor_session_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record, report, saved = (tmp_path / name for name in ("r.mcap", "r.json", "s.itouch"))
    finish = Recorder.close

    def gone(recorder: Recorder) -> None:
        record.unlink()  # as by another program, in the last moment
        finish(recorder)

    monkeypatch.setattr(Recorder, "close", gone)
    words = [str(SCENES / "first_touch.xml"), "--headless", "--for", "1s", "--record", str(record)]
    assert main([*words, "--report", str(report), "--save", str(saved)]) == 2
    written = json.loads(report.read_text())
    assert written["simulated_s"] == 1.0
    assert [(fault["trip"], str(record) in fault["cause"]) for fault in written["faults"]] == [("recording", True)]
    assert itouch.restore(saved).seconds == 1.0
    assert f"cannot write '{record}': " in capsys.readouterr().err.splitlines()[-1]


def test_a_folder_that_is_removed_during_a_run_loses_neither_report_nor_session(tmp_path: Path) -> None:
    report, saved = tmp_path / "o" / "r.json", tmp_path / "o" / "s.itouch"
    report.parent.mkdir()
    words = [sys.executable, "-m", "itouch_tools.cli", str(SCENES / "first_touch.xml"), "--headless", "--for", "1e6s"]
    words += ["--report", str(report), "--save", str(saved)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert b"finger" in process.stdout.readline()  # it has touched: the run is under way
        shutil.rmtree(report.parent)
        process.send_signal(signal.SIGINT)
        assert process.communicate()[1].endswith(b"stopped by SIGINT; the devices are safe\n")
    assert process.returncode == 130
    assert "ended_by" not in json.loads(report.read_text())
    assert itouch.restore(saved).seconds > 0.0
