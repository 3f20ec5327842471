"""A recording as a bag of ROS 2: poses, points, wrenches, temperatures and heat fluxes as its standard messages.

A topic for each column that is one of these, ``/TRACK/COLUMN``; ``/tf`` holds the frames of the 3-D scene, ``/events``,
``/marks`` and ``/faults`` JSON texts.  Times are those of the recording: its begin and the time of the tick.  The
package ``rosbags`` writes it, without ROS; ``itouch-py[ros]`` asks for it.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from itouch.recording.recording import Recording
from itouch.recording.rerun import messages
from itouch.recording.tracks import Column, Track, identifier
from itouch.recording.views import WORLD

#: Kelvin at 0 degC: ``sensor_msgs/Temperature`` is in degC.
_ICE: Final = 273.15
#: Of the format: that of ROS 2 since Iron; Humble reads 8.
_VERSION: Final = 9

Row = Sequence[float]


def export_rosbag(recording: Recording, target: str) -> list[str]:
    """Write the folder of a bag; return it.

    Raises
    ------
    ValueError
        If there is something at the target, or nothing in the recording that ROS has a message for.
    RecordingError
        If the messages of the 3-D scene can't be read.
    OSError
        If it can't be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    place = Path(target)
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise ValueError(f"'{target}' is there already; name a folder that is empty or new")
    topics = {f"{_topic(track.name)}{_topic(column.name)}": (track, column)
              for track in recording.tracks.values() for column in track.columns if _type(column)}  # fmt: skip
    if not topics:
        raise ValueError(f"'{recording.path}' has no pose, wrench, temperature or heat flux")
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=".rosbag-") as folder:
        bag = Path(folder, place.name)  # the bag's file is named after its folder
        with Writer(bag, version=_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            _fill(writer, recording, topics)
        if place.exists():
            place.rmdir()
        shutil.move(bag, place)
    return [target]


def _fill(writer: Any, recording: Recording, topics: dict[str, tuple[Track, Column]]) -> None:
    from rosbags.typesys import Stores, get_typestore

    ros = _Ros(get_typestore(Stores.ROS2_JAZZY), int(recording.session.get("start_ns", 0)))
    frames = {transform["child_frame_id"] for _, _, content in messages(recording)
              for transform in content.get("transforms", ())}  # fmt: skip
    for topic, (track, column) in topics.items():
        own = f"device/{track.name}"
        rows = recording[track.name]
        times, values = rows["time"], np.asarray(rows[column.name], np.float64).reshape(len(rows), -1)
        kind, make = _type(column), ros.maker(column, own if own in frames else WORLD)
        _write(writer, topic, kind, ros, zip(times.tolist(), map(make, times.tolist(), values.tolist()), strict=True))
    _write(writer, "/tf", "tf2_msgs/msg/TFMessage", ros, ros.frames(recording))
    for name in ("events", "marks", "faults"):
        said = (
            (float(entry["time"]), ros.make("std_msgs/msg/String", data=json.dumps(entry)))
            for entry in getattr(recording, name)
        )
        _write(writer, f"/{name}", "std_msgs/msg/String", ros, said)


def _write(writer: Any, topic: str, kind: str, ros: _Ros, found: Iterable[tuple[float, Any]]) -> None:
    line = writer.add_connection(topic, kind, typestore=ros.store)
    for time, message in found:
        writer.write(line, ros.nanoseconds(time), ros.store.serialize_cdr(message, kind))


def _topic(name: str) -> str:
    """Return a name as parts of a topic: letters, digits and underscores between slashes."""
    return "".join(f"/{identifier(part).replace('__', '_')}" for part in name.split("."))


def _type(column: Column) -> str:
    """Return the message that a column's numbers are, or nothing."""
    if column.kind != "f8":
        return ""
    kinds = {
        ("m", 7): "geometry_msgs/msg/PoseStamped", ("m", 3): "geometry_msgs/msg/PointStamped",
        ("N", 6): "geometry_msgs/msg/WrenchStamped", ("N", 3): "geometry_msgs/msg/WrenchStamped",
        ("K", 1): "sensor_msgs/msg/Temperature", ("W/m^2", 1): "std_msgs/msg/Float64",
    }  # fmt: skip
    return kinds.get((column.unit, max(1, column.size)), "")


class _Ros:
    """Makes messages of a store of types, stamped from a begin [ns]."""

    def __init__(self, store: Any, start: int) -> None:
        self.store, self._start = store, start

    def nanoseconds(self, time: float) -> int:
        """Return when something was, by the clock of the recording's begin."""
        return self._start + round(time * 1e9)

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message."""
        return self.store.types[kind](**fields)

    def header(self, time: float, frame: str) -> Any:
        """Return the head of a stamped message."""
        seconds, rest = divmod(self.nanoseconds(time), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def maker(self, column: Column, frame: str) -> Callable[[float, Row], Any]:
        """Return what makes the message of a row of a column."""
        kind = _type(column)

        def made(time: float, row: Row) -> Any:
            if kind == "std_msgs/msg/Float64":
                return self.make(kind, data=row[0])
            head = self.header(time, frame)
            if kind == "sensor_msgs/msg/Temperature":
                return self.make(kind, header=head, temperature=row[0] - _ICE, variance=0.0)
            if kind == "geometry_msgs/msg/PointStamped":
                return self.make(kind, header=head, point=self._three("Point", row))
            if kind == "geometry_msgs/msg/PoseStamped":
                pose = self.make("geometry_msgs/msg/Pose", position=self._three("Point", row),
                                 orientation=self._turn(row[3:]))  # fmt: skip
                return self.make(kind, header=head, pose=pose)
            wrench = self.make("geometry_msgs/msg/Wrench", force=self._three("Vector3", row),
                               torque=self._three("Vector3", row[3:] or (0.0, 0.0, 0.0)))  # fmt: skip
            return self.make(kind, header=head, wrench=wrench)

        return made

    def _three(self, name: str, row: Row) -> Any:
        return self.make(f"geometry_msgs/msg/{name}", x=row[0], y=row[1], z=row[2])

    def _turn(self, row: Row) -> Any:
        return self.make("geometry_msgs/msg/Quaternion", w=row[0], x=row[1], y=row[2], z=row[3])

    def frames(self, recording: Recording) -> Iterator[tuple[float, Any]]:
        """Yield the frames of the 3-D scene, as often as they are told."""
        for time, name, content in messages(recording):
            if name != "FrameTransforms":
                continue
            found = []
            for one in content["transforms"]:
                place, turn = one["translation"] or {}, one["rotation"] or {"w": 1.0}
                moved = self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self._three("Vector3", [place.get(axis, 0.0) for axis in "xyz"]),
                    rotation=self._turn([turn.get(axis, 0.0) for axis in "wxyz"]),
                )
                found.append(self.make(
                    "geometry_msgs/msg/TransformStamped", header=self.header(time, one["parent_frame_id"]),
                    child_frame_id=one["child_frame_id"], transform=moved,
                ))  # fmt: skip
            yield time, self.make("tf2_msgs/msg/TFMessage", transforms=found)
