"""A running session in Rerun: its 3-D scene, its curves, its contacts and marks, as a recording shows them.

Rerun is another process, started by us or running already; ours only reads what the session publishes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.recording.tracks import Track
from itouch.recording.views import TOPICS, Drawing
from itouch.recording.wellknown import decode
from itouch.servo import Link
from itouch.session.row_layout import replay_tracks
from itouch.session.viewer_geometry import view_of
from itouch.world import Model
from itouch_tools.export.rerun_viewer import Scene, blueprint, curves, happened
from itouch_tools.viewer.live.published_states import Moment, Moments, NewEvents

#: Rate [Hz] of the curves' rows, and the time [s] whose rows are sent together; the scene's rate is that of recordings.
RATE: Final = 250.0
TOGETHER: Final = 0.1


class Shown:
    """A session as it is shown in a stream of Rerun."""

    def __init__(self, stream: Any, model: Model, state: Record) -> None:
        self._stream, self._period = stream, model.period
        self.tracks = replay_tracks(model, state)
        self._new_events, self._scene = NewEvents(model, state), Scene(stream)
        places = {name: offset for name, (_, offset, *_) in (state.dtype.fields or {}).items()}
        step = max(1, round(1.0 / (RATE * model.period)))
        self._drawing = Drawing(view_of(model, state), places, period=model.period, start_ns=0, step=step)
        self._waiting: list[Moment] = []
        self._begun = False

    def show(self, moments: Sequence[Moment]) -> None:
        """Show moments, oldest first: the scene and the events at once, the curves several rows at a time."""
        if not moments:
            return
        ticks, rows = np.array([moment.tick for moment in moments]), np.stack([m.state.raw for m in moments])
        told = self._drawing.messages(ticks, rows)
        self._scene.put((tick * self._period, TOPICS[topic], decode(TOPICS[topic], data)) for topic, tick, data in told)
        state = moments[-1].state
        happened(self._stream, self._new_events.events(state), self._new_events.marks(state))
        self._waiting += moments
        if (self._waiting[-1].tick - self._waiting[0].tick) * self._period >= TOGETHER:
            for track in self.tracks:
                curves(self._stream, track, self._rows(track), first=not self._begun)
            self._waiting, self._begun = [], True

    def _rows(self, track: Track) -> NDArray[Any]:
        """Return the waiting moments as rows (n,) of a track."""
        rows = np.zeros(len(self._waiting), track.dtype)
        rows["tick"] = [moment.tick for moment in self._waiting]
        rows["time"] = rows["tick"] * self._period
        for column in track.columns:
            rows[column.name] = [moment.state[column.field] for moment in self._waiting]
        return rows


def show(link: Link, address: str, told: Callable[[], None], looks: Callable[[], bool]) -> int:
    """Show a session in the Rerun at an address until one of them ends; return how many moments were passed over.

    Parameters
    ----------
    link
        The session; it is only read.
    address
        Address of Rerun's server, such as ``rerun+http://127.0.0.1:9876/proxy``.
    told
        Called once when showing begins.
    looks
        Called again and again; returns whether Rerun is still there.
    """
    import rerun as rr

    stream = rr.RecordingStream("itouch-py", recording_id=link.name)
    shown = Shown(stream, Model.of(link.scene(), Catalog()), link.state)
    stream.connect_grpc(address, default_blueprint=blueprint(shown.tracks))
    moments = Moments(link, RATE, waiting=round(RATE))
    told()
    for listed in moments.take():
        shown.show(listed)
        if not looks():
            break
    stream.flush()
    stream.disconnect()
    return moments.passed
