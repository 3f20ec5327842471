"""A running session as topics of ROS 2, without an installation of ROS: over Zenoh, which ROS speaks with `rmw_zenoh`.

The topics are those of `itouch-py export --rosbag`.  The package `zenoh-ros2-sdk` makes publishers that ROS discovers;
it would fetch message definitions from the internet, so they and their hashes are given to it, from `rosbags`.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.recording.tracks import Column
from itouch.recording.views import Drawing
from itouch.schema import ItouchError
from itouch.servo import Link
from itouch.session.row_layout import replay_tracks
from itouch.session.viewer_geometry import view_of
from itouch.world import Model
from itouch_tools.export.ros_messages import FRAMES, TEXT, Messages, frame_of, store, topics_of, type_of
from itouch_tools.viewer.live.published_states import Moment, Moments, NewEvents

#: Rate [Hz] at which topics are published, by default.
RATE: Final = 100.0
#: How long [s] a router may take to answer when it is looked for.
_LOOK = 1.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where topics are published: the Zenoh router, and the domain of ROS."""

    host: str = "127.0.0.1"
    port: int = 7447
    domain: int = 0

    @property
    def answers(self) -> bool:
        """Whether something listens there."""
        try:
            socket.create_connection((self.host, self.port), _LOOK).close()
        except OSError:
            return False
        return True


class Topics:
    """The topics of one session, each with its publisher."""

    def __init__(self, model: Model, state: Record, place: Place) -> None:
        self._place, self._store = place, store()
        self._make = Messages(self._store, 0)
        self._new_events = NewEvents(model, state)
        view = view_of(model, state)
        places = {name: offset for name, (_, offset, *_) in (state.dtype.fields or {}).items()}
        self._drawing = Drawing(view, places, period=model.period, start_ns=0)
        frames = {frame.name for frame in view.frames}
        self._lines: list[tuple[Any, Column, Callable[[float, Any], Any]]] = []
        self._all: list[Any] = []
        for topic, (_, column) in topics_of(replay_tracks(model, state)).items():
            line = self._publisher(topic, type_of(column))
            self._lines.append((line, column, self._make.maker(column, frame_of(column, frames))))
        self._frames = self._publisher("/tf", FRAMES)
        self._events, self._marks = self._publisher("/events", TEXT), self._publisher("/marks", TEXT)
        if not self._lines:
            raise ItouchError("the session has no pose, wrench, temperature or heat flux that ROS has a message for")

    @property
    def names(self) -> list[str]:
        """Names of the topics."""
        return [str(line.topic) for line in self._all]

    def _publisher(self, topic: str, kind: str) -> Any:
        publishers, quality = library()
        line = publishers(
            topic, kind, msg_definition=self._store.generate_msgdef(kind, ros_version=2)[0],
            type_hash=self._store.hash_rihs01(kind), node_name=f"itouch{topic.replace('/', '_')}", qos=quality,
            domain_id=self._place.domain, router_ip=self._place.host, router_port=self._place.port,
        )  # fmt: skip
        self._all.append(line)
        return line

    def tell(self, moment: Moment) -> None:
        """Publish a moment on every topic, and the events and marks since the last one."""
        state = moment.state
        self._make.at(moment.wall_ns)
        for line, column, make in self._lines:
            line.publish(**_fields(make(0.0, np.ravel(state[column.field]).tolist())))
        self._frames.publish(**_fields(self._make.frames(0.0, self._drawing.transforms(state.raw, {}))))
        for line, listed in (
            (self._events, self._new_events.events(state)),
            (self._marks, self._new_events.marks(state)),
        ):
            for entry in listed:
                line.publish(data=json.dumps(entry))

    def close(self) -> None:
        """Take the topics away."""
        for line in self._all:
            line.close()
        self._all[0].session_mgr.close()


def library() -> tuple[Any, Any]:
    """Return the library's class of publishers, and the quality of service: a slow subscriber holds nobody up."""
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # otherwise its import fails where there is no git
    from zenoh_ros2_sdk.publisher import ROS2Publisher
    from zenoh_ros2_sdk.qos import QosProfile, QosReliability

    return ROS2Publisher, QosProfile(reliability=QosReliability.BEST_EFFORT)


def _fields(message: Any) -> dict[str, Any]:
    return {name: getattr(message, name) for name in message.__dataclass_fields__ if not name.startswith("__")}


def tell(link: Link, place: Place, rate: float, told: Callable[[list[str]], None]) -> int:
    """Publish a session to ROS 2 until it ends; return how many moments were passed over.

    Parameters
    ----------
    link
        The session; it is only read.
    place, rate
        Where topics are published, and at which rate [Hz].
    told
        Called with the names of the topics when they have been created.
    """
    topics = Topics(Model.of(link.scene(), Catalog()), link.state, place)
    moments = Moments(link, rate)
    try:
        told(topics.names)
        for listed in moments.take():
            for moment in listed:
                topics.tell(moment)
    finally:
        topics.close()
    return moments.passed


__all__ = ["RATE", "Place", "Topics", "tell"]
