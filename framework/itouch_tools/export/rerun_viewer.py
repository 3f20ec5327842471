"""A recording for Rerun: its 3-D scene, its channels as curves by unit, its events as text.

Rerun's own reader of MCAP shows the tracks only as columns; here they appear as what they mean.  The extra
``itouch-py[rerun]`` installs Rerun's package.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from numpy.typing import NDArray

from itouch.plugin import poses
from itouch.recording.recording import Recording
from itouch.recording.recording_error import RecordingError
from itouch.recording.tracks import Track
from itouch.recording.views import TOPICS, WORLD
from itouch.recording.wellknown import decode
from itouch.schema.diagnostics import reason
from itouch_tools.export.tables import columns_in

#: Name of the time axis, and most panels of curves.
TIME, PANELS = "time", 6

Marks = dict[tuple[str, str], list[tuple[float, dict[str, Any] | None]]]


def export_rrd(recording: Recording, target: str) -> list[str]:
    """Write a recording as a file of Rerun, with its layout; return the file.

    Raises
    ------
    OSError
        If the file can't be written.
    RecordingError
        If the messages of its 3-D scene can't be read.
    """
    import rerun as rr

    partial = Path(f"{target}.part")  # what is at the target stays until the new file is complete
    partial.touch()  # for a place that can't be written, this raises the system's own error
    stream = rr.RecordingStream("itouch-py", recording_id=Path(recording.path).stem)
    try:
        with stream:
            stream.save(partial, default_blueprint=blueprint(recording.tracks.values()))
            Scene(stream).put(messages(recording))
            _curves(stream, recording)
            _texts(stream, recording)
            stream.flush()
        stream.disconnect()
        partial.replace(target)
    finally:
        stream.disconnect()
        partial.unlink(missing_ok=True)
    return [target]


def messages(recording: Recording) -> Iterator[tuple[float, str, dict[str, Any]]]:
    """Yield the messages that hold the 3-D scene: time [s], name of the schema, and content.

    Raises
    ------
    RecordingError
        If the file was cut or damaged: ``itouch-py recover`` repairs it.
    """
    start = int(recording.session.get("start_ns", 0))
    try:
        with open(recording.path, "rb") as file:
            for _, channel, message in make_reader(file).iter_messages(topics=list(TOPICS)):
                name = TOPICS[channel.topic]
                yield (message.log_time - start) / 1e9, name, decode(name, message.data)
    except (McapError, ValueError, EOFError) as error:
        # where the file was cut, what the reader of its index stumbled over says nothing
        why = recording.losses[0] if recording.losses else reason(error)
        raise RecordingError(
            f"the 3-D scene of '{recording.path}' can't be read ({why}); make it whole with `itouch-py recover`"
        ) from error


class Scene:
    """Puts the messages of the 3-D scene into a stream of Rerun, as they come."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._parents: dict[str, str] = {}
        self._where: dict[str, str] = {}
        self._kinds: dict[tuple[str, str], dict[str, Any]] = {}

    def put(self, told: Iterable[tuple[float, str, dict[str, Any]]]) -> None:
        """Put messages: time [s], name of the schema, content."""
        import rerun as rr

        moves: dict[str, list[tuple[float, list[float]]]] = defaultdict(list)
        marks: Marks = defaultdict(list)
        for time, name, content in told:
            if name == "FrameTransforms":
                for transform in content["transforms"]:
                    self._parents[transform["child_frame_id"]] = transform["parent_frame_id"]
                    moves[transform["child_frame_id"]].append((time, _numbers(transform)))
            else:
                self._entities(time, content, marks)
        for frame, found in moves.items():
            numbers = np.array([pose for _, pose in found])
            self._stream.send_columns(
                _path(frame, self._parents), [rr.TimeColumn(TIME, duration=[time for time, _ in found])],
                [*rr.Transform3D.columns(translation=numbers[:, :3], quaternion=numbers[:, [4, 5, 6, 3]])],
            )  # fmt: skip
        for (frame, name), listed in marks.items():
            kind = next(entity for entity in (*(e for _, e in listed), self._kinds.get((frame, name))) if entity)
            first = self._kinds.setdefault((frame, name), kind) is kind
            _marks(self._stream, f"{_path(frame, self._parents)}/{_part(name)}", listed, kind, first=first)

    def _entities(self, time: float, content: dict[str, Any], marks: Marks) -> None:
        for entity in content["entities"]:
            self._where[entity["id"]] = entity["frame_id"]
            if entity["arrows"] or entity["texts"]:
                marks[entity["frame_id"], entity["id"]].append((time, entity))
            else:
                path = f"{_path(entity['frame_id'], self._parents)}/{_part(entity['id'])}"
                _solid(self._stream, path, entity)
        for gone in content["deletions"]:
            if gone["id"] in self._where:
                marks[self._where[gone["id"]], gone["id"]].append((time, None))


def _numbers(pose: dict[str, Any]) -> list[float]:
    """Return the position x y z and the orientation w x y z of a transform or a pose."""
    place = pose.get("translation") or pose.get("position") or {}
    turn = pose.get("rotation") or pose.get("orientation") or {"w": 1.0}
    return [*(place.get(axis, 0.0) for axis in "xyz"), *(turn.get(axis, 0.0) for axis in "wxyz")]


def _path(frame: str, parents: dict[str, str]) -> str:
    """Return a frame's path in the tree of entities: below its parent, down from the world."""
    parts, seen = [frame], {frame}
    while (above := parents.get(parts[-1], WORLD)) != WORLD and above not in seen:
        parts.append(above)
        seen.add(above)
    inner = [_part(part) for part in reversed(parts) if part != WORLD]
    return "/".join([WORLD, *inner])


def _part(name: str) -> str:
    import rerun as rr

    return str(rr.escape_entity_path_part(name))


def _colour(shape: dict[str, Any]) -> list[int]:
    colour = shape["color"] or {"r": 0.8, "g": 0.8, "b": 0.8, "a": 1.0}
    return [round(255 * min(1.0, max(0.0, colour[part]))) for part in "rgba"]


def _solid(stream: Any, path: str, entity: dict[str, Any]) -> None:
    """Log a solid, which does not change within its frame."""
    import rerun as rr

    for shape in (*entity["cubes"], *entity["spheres"], *entity["cylinders"], *entity["triangles"]):
        pose, colour = _numbers(shape["pose"] or {}), _colour(shape)
        place: dict[str, Any] = {"centers": [pose[:3]], "quaternions": [[*pose[4:], pose[3]]], "colors": [colour]}
        if shape in entity["triangles"]:
            points = np.array([[point[axis] for axis in "xyz"] for point in shape["points"]]).reshape(-1, 3)
            placed = np.array([poses.transform(np.array(pose), point) for point in points]).reshape(-1, 3)
            corners = np.array(shape["indices"], np.uint32).reshape(-1, 3)
            stream.log(path, rr.Mesh3D(vertex_positions=placed, triangle_indices=corners, albedo_factor=colour,
                                       vertex_normals=_normals(placed, corners)), static=True)  # fmt: skip
            continue
        half = [0.5 * shape["size"][axis] for axis in "xyz"]
        solid = rr.components.FillMode.Solid
        if shape in entity["cubes"]:
            made: Any = rr.Boxes3D(half_sizes=[half], fill_mode=solid, **place)
        elif shape in entity["spheres"]:
            made = rr.Ellipsoids3D(half_sizes=[half], fill_mode=solid, **place)
        else:
            made = rr.Cylinders3D(lengths=[2 * half[2]], radii=[half[0]], fill_mode=solid, **place)
        stream.log(path, made, static=True)


def _normals(points: NDArray[np.float64], corners: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Return the normals of a mesh at its points, shape (n, 3): means of the triangles there, weighted by area."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    found = np.zeros_like(points)
    for k in range(3):
        np.add.at(found, corners[:, k], across)
    size = np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(found / np.where(size > 0.0, size, 1.0))


def _marks(stream: Any, path: str, listed: list[tuple[float, dict[str, Any] | None]], kinds: dict[str, Any], *,
           first: bool) -> None:  # fmt: skip
    """Log what comes and goes, by the kind of its entity: forces as arrows, temperatures as words."""
    import rerun as rr

    axis = rr.TimeColumn(TIME, duration=[time for time, _ in listed])
    if kinds["arrows"]:
        vectors = [[0.0] * 3 if entity is None else _vector(entity["arrows"][0]) for _, entity in listed]
        if first:
            stream.log(path, rr.Arrows3D.from_fields(colors=[_colour(kinds["arrows"][0])], radii=[0.0012]), static=True)
        stream.send_columns(path, [axis], [*rr.Arrows3D.columns(vectors=vectors)])
        return
    words = ["" if entity is None else entity["texts"][0]["text"] for _, entity in listed]
    place = _numbers(kinds["texts"][0]["pose"] or {})[:3]
    if first:
        stream.log(path, rr.Points3D.from_fields(positions=[place], radii=[0.0], show_labels=True), static=True)
    stream.send_columns(path, [axis], [*rr.Points3D.columns(labels=words)])


def _vector(arrow: dict[str, Any]) -> list[float]:
    """Return the vector from an arrow's start to its end; the schema's arrows point along the x axis of their pose."""
    length = arrow["shaft_length"] + arrow["head_length"]
    pose = np.array(_numbers(arrow["pose"] or {}))
    return np.asarray(poses.transform(pose, np.array([length, 0.0, 0.0])) - pose[:3]).tolist()  # type: ignore[no-any-return]


def _curves(stream: Any, recording: Recording) -> None:
    for track in recording.tracks.values():
        curves(stream, track, recording[track.name], first=True)


def curves(stream: Any, track: Track, rows: NDArray[Any], *, first: bool) -> None:
    """Log rows (n,) of a track as curves by unit; with ``first`` also the names of the curves."""
    import rerun as rr

    columns = columns_in(rows, track, celsius=True)
    times = np.asarray(columns["time"][1], np.float64)
    units = list(dict.fromkeys(unit for label, (unit, _) in columns.items() if label not in ("time", "tick")))
    for unit in units if len(times) else ():
        found = {label: values for label, (u, values) in columns.items() if u == unit and label not in ("time", "tick")}
        path = f"/curves/{_part(unit or '1')}/{_part(track.name)}"
        if first:
            names = [f"{track.name}.{label}" + (f" [{unit}]" if unit else "") for label in found]
            stream.log(path, rr.SeriesLines.from_fields(names=names), static=True)
        table = np.column_stack([np.asarray(values, np.float64) for values in found.values()])
        each = rr.Scalars.columns(scalars=table.reshape(-1)).partition([len(found)] * len(table))
        stream.send_columns(path, [rr.TimeColumn(TIME, duration=times)], [*each])


def _texts(stream: Any, recording: Recording) -> None:
    happened(stream, recording.events, recording.marks)
    for fault in recording.faults:
        _say(stream, fault["time"], "ERROR", f"fault: {fault['device']}: {fault['cause']}")


def happened(stream: Any, events: Iterable[dict[str, Any]], marks: Iterable[dict[str, Any]]) -> None:
    """Log contact events and marks as text."""
    for event in events:
        _say(stream, event["time"], "INFO", f"{event['kind']}: {event['probe']} on {event['object']}")
    for mark in marks:
        _say(stream, mark["time"], "INFO", f"mark {mark['name']} {mark.get('payload') or ''}".strip())


def _say(stream: Any, time: float, level: str, words: str) -> None:
    import rerun as rr

    stream.set_time(TIME, duration=float(time))
    stream.log("events", rr.TextLog(words, level=level))


def blueprint(tracks: Iterable[Track]) -> Any:
    """Return the layout: the scene and the events left, a panel of curves for each unit right."""
    import rerun.blueprint as rrb

    units = list(dict.fromkeys(
        column.unit for track in tracks for column in track.columns
        if column.unit and not column.name.startswith("command.")
    ))[:PANELS]  # fmt: skip
    shown = [{"K": "degC"}.get(unit, unit) for unit in units]
    legend = rrb.PlotLegend(visible=False)  # it would hide the curves, whose names are shown at the mouse anyway
    panels = [
        rrb.TimeSeriesView(origin=f"/curves/{_part(unit)}", name=f"[{unit}]", plot_legend=legend) for unit in shown
    ]
    events = rrb.TextLogView(origin="/events", name="events")
    scene = rrb.Vertical(rrb.Spatial3DView(origin=f"/{WORLD}", name="scene"), events, row_shares=[3, 1])
    whole = rrb.Horizontal(scene, rrb.Vertical(*panels), column_shares=[3, 2]) if panels else scene
    return rrb.Blueprint(whole, collapse_panels=True)
