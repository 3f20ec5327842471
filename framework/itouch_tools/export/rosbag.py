"""A recording as a bag of ROS 2: poses, points, wrenches, temperatures and heat fluxes as standard messages.

Each column that is one of these has a topic, ``/TRACK/COLUMN``; ``/tf`` holds the frames of the 3-D scene, ``/events``,
``/marks`` and ``/faults`` texts in JSON.  Times are those of the recording: its start plus the time of the tick.  The
package ``rosbags`` writes the bag, without an installation of ROS; the extra ``itouch-py[ros]`` installs it.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from itouch.recording.recording import Recording
from itouch.recording.tracks import Column, Track
from itouch_tools.export.rerun_viewer import messages
from itouch_tools.export.ros_messages import FRAMES, TEXT, Messages, frame_of, store, topics_of, type_of

#: Version of the format: that of ROS 2 since Iron; Humble reads 8.
_VERSION: Final = 9


def export_rosbag(recording: Recording, target: str) -> list[str]:
    """Write the folder of a bag; return it.

    Raises
    ------
    ValueError
        If the target exists and is not an empty folder, or if ROS has a message for nothing in the recording.
    RecordingError
        If the messages of the 3-D scene can't be read.
    OSError
        If the bag can't be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    place = Path(target)
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise ValueError(f"'{target}' is there already; name a folder that is empty or new")
    topics = topics_of(recording.tracks.values())
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
    ros = Messages(store(), int(recording.session.get("start_ns", 0)))
    frames = {transform["child_frame_id"] for _, _, content in messages(recording)
              for transform in content.get("transforms", ())}  # fmt: skip
    for topic, (track, column) in topics.items():
        rows = recording[track.name]
        times, values = rows["time"], np.asarray(rows[column.name], np.float64).reshape(len(rows), -1)
        kind, make = type_of(column), ros.maker(column, frame_of(column, frames))
        _write(writer, topic, kind, ros, zip(times.tolist(), map(make, times.tolist(), values.tolist()), strict=True))
    told = ((time, ros.frames(time, content["transforms"])) for time, name, content in messages(recording)
            if name == "FrameTransforms")  # fmt: skip
    _write(writer, "/tf", FRAMES, ros, told)
    for name in ("events", "marks", "faults"):
        said = ((float(entry["time"]), ros.make(TEXT, data=json.dumps(entry))) for entry in getattr(recording, name))
        _write(writer, f"/{name}", TEXT, ros, said)


def _write(writer: Any, topic: str, kind: str, ros: Messages, found: Iterable[tuple[float, Any]]) -> None:
    line = writer.add_connection(topic, kind, typestore=ros.store)
    for time, message in found:
        writer.write(line, ros.nanoseconds(time), ros.store.serialize_cdr(message, kind))
