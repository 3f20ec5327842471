"""Messages of ROS 2 for columns of numbers and for frames: which type is for which column, and how they are made.

Poses, points, wrenches, temperatures and heat fluxes become standard messages; the package `rosbags` knows their types
and serializes them, without an installation of ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any, Final

from itouch.recording.tracks import Column, Track, identifier
from itouch.recording.views import WORLD
from itouch_tools.export.tables import distinct

#: Kelvin at 0 degC: ``sensor_msgs/Temperature`` is in degC.
_ICE: Final = 273.15
#: Message types of the frames of the 3-D scene, and of events, marks and faults, which are texts in JSON.
FRAMES, TEXT = "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"

Row = Sequence[float]


def store() -> Any:
    """Return the store of message types, those of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def topic_of(name: str) -> str:
    """Return a name as part of a topic: letters, digits and underscores after slashes."""
    return "".join(f"/{identifier(part).replace('__', '_')}" for part in name.split("."))


def topics_of(tracks: Iterable[Track]) -> dict[str, tuple[Track, Column]]:
    """Return the topics of tracks: by its name, the track and the column of which each tells.

    Names that differ only in what a topic must not have, such as ``arm-1`` and ``arm_1``, are told apart by a number.
    """
    listed = list(tracks)
    found: dict[str, tuple[Track, Column]] = {}
    for track, above in zip(listed, distinct([topic_of(track.name) for track in listed], joint="_"), strict=True):
        columns = [column for column in track.columns if type_of(column)]
        below = distinct([topic_of(column.name) for column in columns], joint="_")
        found |= {above + name: (track, column) for name, column in zip(below, columns, strict=True)}
    return found


def type_of(column: Column) -> str:
    """Return the type of message for a column's numbers; empty: there is none."""
    if column.kind != "f8":
        return ""
    kinds = {
        ("m", 7): "geometry_msgs/msg/PoseStamped", ("m", 3): "geometry_msgs/msg/PointStamped",
        ("N", 6): "geometry_msgs/msg/WrenchStamped", ("N", 3): "geometry_msgs/msg/WrenchStamped",
        ("K", 1): "sensor_msgs/msg/Temperature", ("W/m^2", 1): "std_msgs/msg/Float64",
    }  # fmt: skip
    return kinds.get((column.unit, max(1, column.size)), "")


def frame_of(column: Column, frames: Container[str]) -> str:
    """Return the frame of a column's poses, points and wrenches: of what a device has, its own, else the world.

    ``frames`` are those of the 3-D scene.  The field of State says whose a column is, at whatever rate it is recorded.
    """
    own = f"device/{column.field.partition('.')[0]}"
    return own if own in frames else WORLD


class Messages:
    """Makes messages of a store of types; their stamps count from ``start`` [ns]."""

    def __init__(self, store: Any, start: int) -> None:
        self.store, self._start = store, start

    def at(self, start: int) -> None:
        """Let stamps count from another start [ns]."""
        self._start = start

    def nanoseconds(self, time: float) -> int:
        """Return the stamp [ns] of a time [s] since the start."""
        return self._start + round(time * 1e9)

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message."""
        return self.store.types[kind](**fields)

    def header(self, time: float, frame: str) -> Any:
        """Return the header of a stamped message."""
        seconds, rest = divmod(self.nanoseconds(time), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def maker(self, column: Column, frame: str) -> Callable[[float, Row], Any]:
        """Return the function that makes a message from a time [s] and a row of a column."""
        kind = type_of(column)

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

    def frames(self, time: float, transforms: Iterable[Mapping[str, Any]]) -> Any:
        """Return the message of frames of the 3-D scene, given as contents of ``foxglove.FrameTransform``."""
        found = []
        for one in transforms:
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
        return self.make(FRAMES, transforms=found)
