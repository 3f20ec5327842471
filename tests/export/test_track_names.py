"""Devices whose names differ only in what a file's name or a topic must not have: exports keep the data of each."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import program

import itouch
from itouch.recording import read
from itouch.session.outputs import Outputs, open_outputs

#: Two names that are one where only letters and digits are allowed, and two under which a folder has other tables.
NAMES = ("arm-1", "arm_1", "Arm-1", "faults", "columns")
SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices>{devices}</devices>
  <interaction>{probes}</interaction>
</itouch>"""
DEVICE = '<device name="{}" plugin="usb-arm"/>'
PROBE = """<probe name="finger{0}" radius="8 mm" pose-from="{1}"/>
  <operator probe="finger{0}"><motion><to pos="{0}0 0 50 mm" in="0.05 s"/></motion></operator>"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("names")
    scene, path = folder / "names.xml", folder / "names.mcap"
    probes = "".join(PROBE.format(place, name) for place, name in enumerate(NAMES))
    scene.write_text(SCENE.format(devices="".join(map(DEVICE.format, NAMES)), probes=probes), encoding="utf-8")
    engine = itouch.build(scene)
    with open_outputs(engine, Outputs(str(path), True, "", 0.0, False)):
        engine.run(0.05)
    engine.close()
    return read(path)


def exported(recording: Any, *options: str) -> list[Path]:
    """Export, and return the files of which the program says that it wrote them."""
    done = program("export", recording.path, *options, "--json")
    assert done.returncode == 0, done.stderr
    written = json.loads(done.stdout)["written"]
    assert len({name.casefold() for name in written}) == len(written)
    return [Path(name) for name in written]


def column(rows: list[str], index: int, separator: str) -> list[float]:
    return [float(row.split(separator)[index]) for row in rows]


def test_a_folder_of_tables_has_one_of_each_track(recorded: Any, tmp_path: Path) -> None:
    written = exported(recorded, "--csv", str(tmp_path))
    for name, path in zip(recorded.tracks, written, strict=False):
        head, *rows = path.read_text(encoding="utf-8").splitlines()
        if name in NAMES:
            place = head.split(",").index("pose.x [m]")
            assert column(rows, place, ",") == recorded[name]["pose"][:, 0].tolist()
    assert (tmp_path / "faults.csv").read_text(encoding="utf-8") == "tick,time\n"
    assert (tmp_path / "columns.csv").read_text(encoding="utf-8").startswith("column,unit,meaning\n")


def test_a_folder_of_parquet_has_a_table_of_each_track(recorded: Any, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    for name, path in zip(recorded.tracks, exported(recorded, "--parquet", str(tmp_path)), strict=True):
        if name in NAMES:
            assert parquet.read_table(path)["pose.x"].to_pylist() == recorded[name]["pose"][:, 0].tolist()


def test_a_bids_folder_has_a_table_and_a_motion_of_each_track(recorded: Any, tmp_path: Path) -> None:
    written = exported(recorded, "--bids", str(tmp_path))
    tables = [path for path in written if path.name.endswith("_physio.tsv.gz")]
    for name, path in zip(recorded.tracks, tables, strict=True):
        sidecar = json.loads(path.with_name(path.name.replace(".tsv.gz", ".json")).read_text(encoding="utf-8"))
        if name in NAMES:
            rows = gzip.decompress(path.read_bytes()).decode().splitlines()
            assert name in sidecar["Description"]
            assert column(rows, sidecar["Columns"].index("pose.x"), "\t") == recorded[name]["pose"][:, 0].tolist()
    motions = [json.loads(path.read_text(encoding="utf-8")) for path in written if path.name.endswith("_motion.json")]
    assert set(NAMES) <= {motion["TrackingSystemName"] for motion in motions}


def test_a_bag_has_a_topic_of_each_pose(recorded: Any, tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    exported(recorded, "--rosbag", str(tmp_path / "bag"))
    with highlevel.AnyReader([tmp_path / "bag"]) as reader:
        poses: dict[str, list[float]] = {}
        for line, _, data in reader.messages():
            if line.topic.endswith("/pose"):
                message = reader.deserialize(data, line.msgtype)
                poses.setdefault(line.topic, []).append(message.pose.position.x)
    assert sorted(poses.values()) == sorted(recorded[name]["pose"][:, 0].tolist() for name in NAMES)


def test_words_that_are_equal_are_told_apart_by_a_number_that_is_free() -> None:
    from itouch_tools.export.tables import distinct

    assert distinct(["a", "A", "a-2", "a"]) == ["a", "A-2", "a-2-2", "a-3"]
    assert distinct(["events", "a"], taken=["events"]) == ["events-2", "a"]
    assert np.unique(distinct(["x"] * 50, joint="_")).size == 50
