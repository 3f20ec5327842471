"""The layout for viewers names topics and fields that the recording has."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool
from mcap.reader import make_reader
from shipped import SCENES

import itouch
from itouch.recording import views
from itouch_tools.cli import main
from itouch_tools.export import foxglove


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return a recording and its layout, as the command writes it."""
    folder = tmp_path_factory.mktemp("layout")
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(folder / "r.mcap")
    session.run(0.3)
    session.close()
    assert main(["export", str(folder / "r.mcap"), "--layout", str(folder / "r.json")]) == 0
    return folder / "r.mcap", json.loads((folder / "r.json").read_text(encoding="utf-8"))


def test_every_path_is_a_number_of_the_recording(written: tuple[Path, dict[str, Any]]) -> None:
    path, layout = written
    with open(path, "rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    paths = [
        line["value"]
        for name, panel in layout["configById"].items()
        if name.startswith("Plot!")
        for line in panel["paths"]
    ]
    assert len(paths) == len(set(paths)) > 10
    for one in paths:
        topic, *names = re.findall(r"/[\w/-]+|(?<=\.)\w+|\[\d+\]", one)
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schemas[topic].data).file:
            pool.Add(file)
        message = pool.FindMessageTypeByName(schemas[topic].name)
        field = None
        for name in names:
            if name.startswith("["):
                assert field is not None
                continue
            assert name in message.fields_by_name, one
            field = message.fields_by_name[name]
            message = field.message_type or message
        assert field is not None and field.message_type is None, f"{one} is no number"
    assert {views.SCENE, foxglove.EVENTS, views.TRANSFORMS} <= set(schemas)


def test_every_panel_stands_once_and_plots_have_one_unit(written: tuple[Path, dict[str, Any]]) -> None:
    _, layout = written

    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])
    titles = [panel["title"] for name, panel in layout["configById"].items() if name.startswith("Plot!")]
    assert {"[N]", "[m]"} <= set(titles) and len(titles) <= foxglove.PLOTS
    newtons = layout["configById"]["Plot!N"]["paths"]
    assert {line["label"] for line in newtons} >= {"arm.sent.wrench.x", "finger.force.z"}
    assert not any(".rx" in line["value"] for line in newtons)  # torques have another unit
    assert "[]" not in titles, "what has no unit is no curve"
    lines = [
        line for name, panel in layout["configById"].items() if name.startswith("Plot!") for line in panel["paths"]
    ]
    assert not [line["label"] for line in lines if ".command." in line["label"]], "of commands what was sent is plotted"
    assert all(
        len(panel["paths"]) <= foxglove.LINES
        for name, panel in layout["configById"].items()
        if name.startswith("Plot!")
    )


#: What Lichtblick 1.2x asks of the settings of the panels used here: field -> what it is, for those that have no default
#: in their type.  Source: `PlotConfig`, `PlotPath` (panels/Plot/config.ts), `RendererConfig` and `FollowMode`
#: (panels/ThreeDeeRender/IRenderer.ts), the types of panels (panels/index.ts) and PANEL_TITLE_CONFIG_KEY, read 2026-11.
PANELS = {
    "Plot": {"paths": list, "showLegend": bool, "legendDisplay": ("floating", "top", "left", "none"),
             "showPlotValuesInLegend": bool, "showXAxisLabels": bool, "showYAxisLabels": bool, "isSynced": bool,
             "xAxisVal": ("timestamp", "index", "custom", "currentCustom"), "sidebarDimension": (int, float),
             "lichtblickPanelTitle": str, "foxglovePanelTitle": str, "title": str},
    "3D": {"cameraState": dict, "followTf": str, "followMode": ("follow-pose", "follow-position", "follow-none"),
           "scene": dict, "publish": dict, "transforms": dict, "topics": dict, "layers": dict, "imageMode": dict},
    "RawMessages": {"topicPath": str, "diffEnabled": bool},
}  # fmt: skip
PATH = {"value": str, "enabled": bool, "label": str, "timestampMethod": ("receiveTime", "headerStamp")}


def fits(content: dict[str, Any], fields: dict[str, Any]) -> bool:
    """Say whether all fields are there and of their kind, and no other ones."""

    def right(value: Any, kind: Any) -> bool:
        words = isinstance(kind, tuple) and isinstance(kind[0], str)
        return value in kind if words else isinstance(value, kind)

    return content.keys() == fields.keys() and all(right(content[name], kind) for name, kind in fields.items())


def test_panels_are_those_that_lichtblick_knows_with_all_their_settings(written: tuple[Path, dict[str, Any]]) -> None:
    _, layout = written
    assert {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"} == layout.keys()
    for name, panel in layout["configById"].items():
        assert fits(panel, PANELS[name.partition("!")[0]]), (name, panel)
        assert all(fits(path, PATH) for path in panel.get("paths", ()))
    camera = layout["configById"]["3D!scene"]["cameraState"]
    assert camera.keys() == {"distance", "phi", "thetaOffset", "perspective", "target", "targetOffset",
                             "targetOrientation", "fovy", "near", "far"}  # fmt: skip


def test_all_topics_of_the_scene_are_shown_and_no_axes_hide_them(written: tuple[Path, dict[str, Any]]) -> None:
    scene = written[1]["configById"]["3D!scene"]
    assert all(scene["topics"][topic]["visible"] for topic in (views.SOLIDS, views.SCENE))
    assert scene["scene"]["transforms"]["axisScale"] == 0.0


def test_viewers_can_parse_every_schema_of_the_events(written: tuple[Path, dict[str, Any]]) -> None:
    """Lichtblick and Foxglove refuse a topic with lists whose items are not said, or are lists themselves."""
    with open(written[0], "rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = [schema for schema in summary.schemas.values() if schema.encoding == "jsonschema"]
    for schema in schemas:
        said = json.loads(schema.data)
        assert said["type"] == "object"
        for name, field in said["properties"].items():
            kind = field["items"]["type"] if field["type"] == "array" else field["type"]
            assert kind in {"number", "integer", "string", "boolean", "object"}, f"{schema.name}.{name}"
    (events,) = (json.loads(schema.data) for schema in schemas if schema.name == "itouch.events")
    assert events["properties"]["point"] == {"type": "array", "items": {"type": "number"}}


def test_a_plot_shows_its_legend_and_its_axes(written: tuple[Path, dict[str, Any]]) -> None:
    plots = [panel for name, panel in written[1]["configById"].items() if name.startswith("Plot!")]
    assert plots
    for panel in plots:
        assert panel["showLegend"] is panel["showXAxisLabels"] is panel["showYAxisLabels"] is panel["isSynced"] is True
        assert all(line["enabled"] and line["label"] for line in panel["paths"])
