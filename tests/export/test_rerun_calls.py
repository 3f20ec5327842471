"""What Rerun is told of frames, solids and curves, without Rerun: a stand-in keeps what it is called with."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.recording.tracks import Column, Track
from itouch_tools.export import rerun_viewer as ours


class Stream:
    """Keeps what is sent by entity."""

    def __init__(self) -> None:
        self.sent: dict[str, list[Any]] = {}

    def send_columns(self, entity: str, axes: list[Any], columns: list[Any]) -> None:
        self.sent.setdefault(entity, []).append((axes[0]["duration"], columns))

    def log(self, entity: str, what: Any, **_: Any) -> None:
        self.sent.setdefault(entity, []).append(what)


class Parts(list[Any]):
    """Columns that are handed on as they are, with the lengths of their parts."""

    def partition(self, lengths: list[int]) -> list[Any]:
        return [self, lengths]


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> Stream:
    def taken(**given: Any) -> dict[str, Any]:
        return given

    rerun = SimpleNamespace(
        escape_entity_path_part=lambda part: part, TimeColumn=lambda name, **given: given,
        Transform3D=SimpleNamespace(columns=lambda **given: [given]),
        Cylinders3D=taken, Boxes3D=taken, Ellipsoids3D=taken,
        components=SimpleNamespace(FillMode=SimpleNamespace(Solid="solid")),
        SeriesLines=SimpleNamespace(from_fields=lambda names: names),
        Points3D=SimpleNamespace(from_fields=taken, columns=lambda labels: [labels]),
        Arrows3D=SimpleNamespace(from_fields=taken, columns=lambda vectors: [vectors]),
        Scalars=SimpleNamespace(columns=lambda scalars: Parts(scalars.tolist())),
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    return Stream()


def turned() -> dict[str, Any]:
    return {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.9}


def test_a_frame_stands_below_its_parent_with_its_orientation(stream: Stream) -> None:
    told = {"child_frame_id": "plate", "parent_frame_id": "table", "rotation": turned(),
            "translation": {"x": 1.0, "y": 2.0, "z": 3.0}}  # fmt: skip
    ours.Scene(stream).put([(0.5, "FrameTransforms", {"transforms": [told]})])
    ((times, (found,)),) = stream.sent["world/table/plate"]
    assert times == [0.5]
    assert found["translation"].tolist() == [[1.0, 2.0, 3.0]]
    assert found["quaternion"].tolist() == [[0.1, 0.2, 0.3, 0.9]]  # Rerun has the real part last


@pytest.mark.parametrize(
    ("kind", "form"),
    [
        ("cubes", {"half_sizes": [[0.01, 0.02, 0.03]]}),
        ("spheres", {"half_sizes": [[0.01, 0.02, 0.03]]}),
        ("cylinders", {"lengths": [0.06], "radii": [0.01]}),
    ],
)
def test_a_solid_has_its_size_place_and_colour(stream: Stream, kind: str, form: dict[str, Any]) -> None:
    pose = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": turned()}
    shape = {"pose": pose, "size": {"x": 0.02, "y": 0.04, "z": 0.06}, "color": {"r": 1.0, "g": 0.5, "b": 0.0, "a": 1.0}}
    entity: dict[str, Any] = {"id": "it", "frame_id": "world", "arrows": [], "texts": [], "triangles": []}
    entity |= {"cubes": [], "spheres": [], "cylinders": []} | {kind: [shape]}
    ours.Scene(stream).put([(0.0, "SceneUpdate", {"entities": [entity], "deletions": []})])
    where = {"centers": [[1.0, 2.0, 3.0]], "quaternions": [[0.1, 0.2, 0.3, 0.9]], "colors": [[255, 128, 0, 255]]}
    assert stream.sent == {"world/it": [form | where | {"fill_mode": "solid"}]}


@pytest.mark.parametrize(
    ("kind", "mark", "shown"),
    [
        ("texts", {"text": "27.0 °C", "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.012}}}, ["27.0 °C", ""]),
        ("arrows", {"pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}},
                    "shaft_length": 0.03, "head_length": 0.01, "color": {"r": 1.0, "g": 0.5, "b": 0.0, "a": 1.0}},
         [[0.04, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    ],
)  # fmt: skip
def test_what_comes_and_goes_is_shown_while_it_is_there(
    stream: Stream, kind: str, mark: dict[str, Any], shown: list[Any]
) -> None:
    entity = {"id": "it", "frame_id": "world", "arrows": [], "texts": []} | {kind: [mark]}
    ours.Scene(stream).put([
        (0.0, "SceneUpdate", {"entities": [entity], "deletions": []}),
        (0.5, "SceneUpdate", {"entities": [], "deletions": [{"id": "it"}]}),
    ])  # fmt: skip
    assert stream.sent["world/it"][-1] == ([0.0, 0.5], [shown])
    if kind == "texts":
        assert stream.sent["world/it"][0]["positions"] == [[0.0, 0.0, 0.012]]


def test_curves_go_by_unit_with_temperatures_in_degrees_celsius(stream: Stream) -> None:
    track = Track("arm", 1, True, (Column("arm.f", "force", "f8", 3, "N"), Column("arm.t", "plate", "f8", 0, "K")))
    rows = np.zeros(2, track.dtype)
    rows["time"], rows["force"], rows["plate"] = [0.0, 0.1], [[1, 2, 3], [4, 5, 6]], 300.15
    ours.curves(stream, track, rows, first=True)
    names, (times, (values, lengths)) = stream.sent["/curves/N/arm"]
    assert len(names) == 3 and all(name.startswith("arm.force.") and name.endswith("[N]") for name in names)
    assert (times.tolist(), values, lengths) == ([0.0, 0.1], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [3, 3])
    assert stream.sent["/curves/degC/arm"][1][1][0] == pytest.approx([27.0, 27.0])
    ours.curves(stream, track, rows[:0], first=False)  # a track without rows has no curves
    assert all(len(sent) == 2 for sent in stream.sent.values())


def test_what_has_no_orientation_stands_upright() -> None:
    upright = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert ours._numbers({}) == upright
    assert ours._numbers({"position": {"x": 2.0}}) == [2.0, *upright[1:]]
    assert ours._numbers({"translation": {"z": 3.0}, "rotation": {"x": 1.0}}) == [0.0, 0.0, 3.0, 0.0, 1.0, 0.0, 0.0]
