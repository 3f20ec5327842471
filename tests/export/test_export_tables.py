"""Tables of exports: columns with their units, the messages of ROS for them, panels of a layout."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.recording.tracks import Column, Track
from itouch_tools.export import bids, foxglove, tables
from itouch_tools.export.contacts import ContactSpan
from itouch_tools.export.ros_messages import type_of

TRACK = Track("arm", 2, True, (
    Column("arm.force", "force", "f8", 3, "N", "what it pushes with"), Column("arm.plate", "plate", "f8", 0, "K"),
))  # fmt: skip


class Kept:
    """A recording of one track."""

    def __init__(self) -> None:
        self.tracks, self.period = {"arm": TRACK}, 1e-3
        self.rows = np.zeros(2, TRACK.dtype)
        self.rows["time"], self.rows["tick"], self.rows["plate"] = [0.5, 0.502], [500, 502], 300.15

    def __getitem__(self, name: str) -> Any:
        return self.rows


def test_a_physio_table_of_bids_has_degrees_celsius_and_says_so(tmp_path: Path) -> None:
    recording: Any = Kept()
    table = tmp_path / "arm.tsv.gz"
    assert bids._continuous(recording, "arm", str(tmp_path / "arm"), "touch") == [
        str(tmp_path / "arm.json"),
        str(table),
    ]
    sidecar = json.loads((tmp_path / "arm.json").read_text(encoding="utf-8"))
    assert (sidecar["SamplingFrequency"], sidecar["StartTime"]) == (500.0, 0.5)
    assert sidecar["plate"] == {"Units": "degC"}
    assert sidecar["force.x"] == {"Units": "N", "Description": "what it pushes with"}
    rows = [line.split("\t") for line in gzip.decompress(table.read_bytes()).decode().splitlines()]
    assert [float(row[sidecar["Columns"].index("plate")]) for row in rows] == pytest.approx([27.0, 27.0])


@pytest.mark.parametrize(
    ("unit", "size", "kind"),
    [
        ("m", 7, "geometry_msgs/msg/PoseStamped"), ("m", 3, "geometry_msgs/msg/PointStamped"), ("m", 0, ""),
        ("N", 6, "geometry_msgs/msg/WrenchStamped"), ("N", 3, "geometry_msgs/msg/WrenchStamped"),
        ("K", 0, "sensor_msgs/msg/Temperature"), ("K", 1, "sensor_msgs/msg/Temperature"),
        ("W/m^2", 0, "std_msgs/msg/Float64"), ("A", 1, ""),
    ],
)  # fmt: skip
def test_numbers_have_the_message_of_ros_that_is_meant_for_them(unit: str, size: int, kind: str) -> None:
    assert type_of(Column("a.b", "b", "f8", size, unit)) == kind
    assert type_of(Column("a.b", "b", "i8", size, unit)) == ""


def test_panels_share_the_height() -> None:
    assert foxglove._stacked(["a"]) == "a"
    assert foxglove._stacked(["a", "b", "c"]) == {
        "first": "a", "direction": "column", "splitPercentage": pytest.approx(100 / 3),
        "second": {"first": "b", "second": "c", "direction": "column", "splitPercentage": 50.0},
    }  # fmt: skip


def test_a_folder_has_a_table_of_each_track_under_its_name(tmp_path: Path) -> None:
    recording: Any = Kept()
    other = Track("pen", 2, True, (Column("pen.pose", "pose", "f8", 3, "m"),))
    rows = {"arm": recording.rows, "pen": np.zeros(2, other.dtype)}
    recording = SimpleNamespace(
        tracks={"arm": TRACK, "pen": other}, period=1e-3, events=[], marks=[], faults=[], __getitem__=rows.get
    )
    kind = type("Two", (), {"__getitem__": lambda self, name: rows[name], **vars(recording)})
    written = tables.export_csv(kind(), str(tmp_path / "out"))  # type: ignore[arg-type]
    assert [Path(path).name for path in written] == [
        "arm.csv", "pen.csv", "events.csv", "marks.csv", "faults.csv", "columns.csv",
    ]  # fmt: skip
    heads = {path: Path(path).read_text(encoding="utf-8").partition("\n")[0] for path in written[:2]}
    assert [("force.x [N]" in head, "pose.x [m]" in head) for head in heads.values()] == [(True, False), (False, True)]
    assert [len(Path(path).read_text(encoding="utf-8").splitlines()) for path in written[:2]] == [3, 3]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, ""), (1.5, "1.5"), ("plain", "plain"), ('a "b"', '"a ""b"""'), ("a, b", '"a, b"'), ("a\nb", '"a\nb"'),
        ([1.0, 2.5], "1.0 2.5"), ([], ""), ({"code": 7}, '"{""code"": 7}"'), ([[1], [2]], '"[[1], [2]]"'),
        ([1, {"a": None}], '"[1, {""a"": null}]"'),
    ],
)  # fmt: skip
def test_a_cell_is_text_numbers_in_a_row_or_json(value: object, text: str) -> None:
    """Programs in any language read the payloads of marks, and a list of numbers as it stands."""
    assert tables._quoted(value) == text


def test_events_of_bids_are_in_the_order_of_their_time_whatever_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spans = [ContactSpan("thumb", "block", 0.25, None), ContactSpan("index", "block", 0.125, 0.5)]
    monkeypatch.setattr(bids, "contacts_of", lambda recording: spans)
    recording: Any = SimpleNamespace(
        marks=[{"time": 0.375, "name": "go", "payload": "now"}, {"time": 0.0, "name": "begin", "payload": ""}],
        faults=[{"time": 0.3125, "cause": "lost\tits cable", "device": "arm"}],
    )
    bids._events(recording, str(tmp_path / "x"), "touch")
    rows = [line.split("\t") for line in (tmp_path / "x.tsv").read_text(encoding="utf-8").splitlines()]
    assert rows == [
        ["onset", "duration", "trial_type", "value", "source"],
        ["0.0", "0.0", "mark", "begin", "n/a"],
        ["0.125", "0.375", "contact", "block", "index"],
        ["0.25", "n/a", "contact", "block", "thumb"],
        ["0.3125", "0.0", "fault", "lost its cable", "arm"],
        ["0.375", "0.0", "mark", "go now", "n/a"],
    ]
