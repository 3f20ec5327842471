"""A layout for Foxglove and Lichtblick that shows a recording: the scene in 3-D, a plot for each unit, the events.

The file is what these viewers write with *Export layout* and read with *Import from file*; it names topics and fields
of the recording's own schemas.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from itouch.recording.recording import Recording
from itouch.recording.tracks import Column, Track, identifiers
from itouch.recording.views import SCENE, SOLIDS, WORLD
from itouch.schema.durable import write_whole

#: Topic of the events.
EVENTS = "/log/events"
#: Most plots, and most lines in a plot.
PLOTS, LINES = 6, 9

#: The keys of a panel's title: formerly in both viewers, in Foxglove, in Lichtblick.
TITLES = ("title", "foxglovePanelTitle", "lichtblickPanelTitle")

Panel = dict[str, Any]


def export_layout(recording: Recording, target: str) -> list[str]:
    """Write the layout; return the file.

    Raises
    ------
    OSError
        If the file can't be written.
    """
    write_whole(target, (json.dumps(layout(recording), indent=1) + "\n").encode())
    return [target]


def layout(recording: Recording) -> dict[str, Any]:
    """Return the panels for a recording and their layout: the scene and its events left, the plots right."""
    panels: dict[str, Panel] = {
        "3D!scene": {
            "followTf": WORLD,
            "followMode": "follow-pose",
            "topics": {SOLIDS: {"visible": True}, SCENE: {"visible": True}},
            # the view is half a metre wide: the default axes of each frame, a metre long, would hide the solids
            "scene": {"backgroundColor": "#16181d",
                      "transforms": {"showLabel": False, "axisScale": 0.0, "lineWidth": 0.0}},
            "cameraState": {"distance": 0.5, "phi": 60.0, "thetaOffset": 30.0, "perspective": True,
                            "target": [0.0, 0.0, 0.0], "targetOffset": [0.0, 0.0, 0.0],
                            "targetOrientation": [0.0, 0.0, 0.0, 1.0], "fovy": 45.0, "near": 0.01, "far": 100.0},
            "publish": {"type": "point", "poseTopic": "/move_base_simple/goal", "pointTopic": "/clicked_point",
                        "poseEstimateTopic": "/initialpose", "poseEstimateXDeviation": 0.5,
                        "poseEstimateYDeviation": 0.5, "poseEstimateThetaDeviation": 0.26179939},
            "transforms": {}, "layers": {}, "imageMode": {},
        },
        "RawMessages!events": {"topicPath": EVENTS, "diffEnabled": False},
    }  # fmt: skip
    plots = []
    for unit, lines in _lines(recording).items():
        name = f"Plot!{identifiers([unit])[0]}"
        panels[name] = {
            **dict.fromkeys(TITLES, f"[{unit}]"),
            "paths": [{"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime"}
                      for path, label in lines],
            "showLegend": True, "legendDisplay": "left", "showPlotValuesInLegend": False, "showXAxisLabels": True,
            "showYAxisLabels": True, "sidebarDimension": 260, "isSynced": True, "xAxisVal": "timestamp",
        }  # fmt: skip
        plots.append(name)
    left = {"first": "3D!scene", "second": "RawMessages!events", "direction": "column", "splitPercentage": 75}
    whole = {"first": left, "second": _stacked(plots), "direction": "row", "splitPercentage": 55} if plots else left
    return {"configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1.0},
            "layout": whole}  # fmt: skip


def _lines(recording: Recording) -> dict[str, list[tuple[str, str]]]:
    """Return, for each unit, the paths and labels of what is plotted in it: readings, and commands as sent."""
    found: dict[str, list[tuple[str, str]]] = {}
    for track in recording.tracks.values():
        names = identifiers(["tick", "time", *(column.name for column in track.columns)])[2:]
        for name, column in zip(names, track.columns, strict=True):
            if not column.unit or column.name.startswith("command."):
                continue
            if column.unit in found or len(found) < PLOTS:
                lines = found.setdefault(column.unit, [])
                lines += list(_of_column(track, name, column))[: LINES - len(lines)]
    return found


def _of_column(track: Track, name: str, column: Column) -> Iterator[tuple[str, str]]:
    """Yield path and label of those numbers of a column that have the column's unit."""
    path = f"{track.topic}.{name}"
    if column.size == 0:
        yield path, f"{track.name}.{column.name}"
        return
    inner = [f".{part}" for part in column.parts] or [f"[{index}]" for index in range(column.size)]
    for part, label, unit in zip(inner, column.labels, column.units, strict=True):
        if unit == column.unit:
            yield path + part, f"{track.name}.{label}"


def _stacked(panels: list[str]) -> Any:
    """Return the layout of panels one below the other, all of the same height."""
    if len(panels) == 1:
        return panels[0]
    return {"first": panels[0], "second": _stacked(panels[1:]), "direction": "column",
            "splitPercentage": 100 / len(panels)}  # fmt: skip
