"""Lab Streaming Layer: readings as streams, marks both ways.  Optional: ``pip install 'itouch-py[lsl]'``."""

from __future__ import annotations

import contextlib
import json
import os
import threading
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from itouch.recording.tracks import Track
from itouch.session.row_layout import replay_tracks
from itouch.session.session_error import SessionError

if TYPE_CHECKING:
    from itouch.session.session import Session

#: Greatest sampling rate [Hz] of each stream of numbers.
RATE = 250.0
#: Name of this program's stream of marks, and the type of the streams from which marks of other programs are taken.
MARKS, MARKER_TYPE = "itouch marks", "Markers"
_LOOK = 0.05
#: How long [s] finding the offset between two machines' clocks may take the first time.
_FIRST_LOOK = 2.0
#: How long [s] it may take later, when the offset is known: marks that wait behind it would come late.
_LOOK_AGAIN = 1e-3


class Streams:
    """Offers a stream for each device and one of marks, and takes marks from other programs' marker streams.

    Marks that come in are set between two ticks, and named after their stream; streams of this program are ignored.
    Their payload says when they happened: ``lsl_time`` by the clock of their own machine, ``correction_s`` the
    difference to this machine's clock, and ``tick`` the tick of that moment, which is earlier than the tick at which
    they arrive.  A mark whose correction can't be found comes without the latter two.
    """

    def __init__(self, session: Session, *, rate: float = RATE) -> None:
        self._session, self._lsl = session, _library()
        self._every = max(1, round(1.0 / (rate * session.model.period)))
        self._source = f"itouch-{os.getpid()}"
        self._outlets: list[tuple[Any, list[Any]]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="lsl marks", daemon=True)
        self._told = int(session.state["marks.count"])

    def __enter__(self) -> Streams:
        for track in replay_tracks(self._session.model, self._session.state):
            if track.name != "session":
                self._outlets.append((self._outlet(track), [self._session.state[c.field] for c in track.columns]))
        info = self._lsl.StreamInfo(MARKS, MARKER_TYPE, 1, 0.0, "string", self._source + "-marks")
        self._marks = self._lsl.StreamOutlet(info)
        self._session.taps.append(self._tap)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.taps.remove(self._tap)
        self._stop.set()
        self._thread.join(2.0)

    def _outlet(self, track: Track) -> Any:
        """Return the outlet for a device's channels, with their units."""
        labels = [
            (f"{track.name}.{label}", u) for c in track.columns for label, u in zip(c.labels, c.units, strict=True)
        ]
        rate = 1.0 / (self._every * self._session.model.period)
        name = f"itouch {track.name}"
        info = self._lsl.StreamInfo(name, "Haptics", len(labels), rate, "double64", f"{self._source}-{track.name}")
        channels = info.desc().append_child("channels")
        for label, unit in labels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", f"{track.name}.{label}")
            channel.append_child_value("unit", unit or "1")
        return self._lsl.StreamOutlet(info)

    def _tap(self, tick: int) -> None:
        if tick % self._every == 0:
            for outlet, views in self._outlets:
                outlet.push_sample(np.concatenate([np.atleast_1d(view).astype(np.float64) for view in views]))
        count = int(self._session.state["marks.count"])
        if count != self._told:
            for mark in self._session.marks[-(count - self._told) :]:
                self._marks.push_sample([json.dumps({"name": mark["name"], "payload": mark["payload"]})])
            self._told = count

    def _listen(self) -> None:
        """Take marks from the marker streams of other programs until the session ends."""
        resolver = self._lsl.ContinuousResolver(prop="type", value=MARKER_TYPE)
        inlets: dict[str, Any] = {}
        while not self._stop.wait(_LOOK):
            for info in resolver.results():
                key = str(info.uid())
                if key not in inlets and not str(info.source_id()).startswith("itouch-"):
                    inlet = self._lsl.StreamInlet(info, recover=False)
                    with contextlib.suppress(Exception):  # the first time this takes a while; then it is known
                        inlet.time_correction(_FIRST_LOOK)
                    inlets[key] = (str(info.name()), inlet)
            for name, inlet in inlets.values():
                with contextlib.suppress(Exception):  # a stream may end at any time
                    self._take(name, inlet)

    def _take(self, name: str, inlet: Any) -> None:
        while (pulled := inlet.pull_sample(timeout=0.0))[0] is not None:
            values, stamp = pulled
            when: dict[str, Any] = {"lsl_time": stamp}
            with contextlib.suppress(Exception):  # not known yet, or the stream has ended: the mark is set without it
                correction = float(inlet.time_correction(_LOOK_AGAIN))
                when |= {"correction_s": correction, "tick": self._tick_of(stamp + correction)}
            self._session.post_mark(name[:32] or "lsl", {"value": str(values[0])[:300], **when})

    def _tick_of(self, stamp: float) -> int:
        """Return the tick of the moment ``stamp`` [s] of this machine's LSL clock; true only in real time."""
        age = float(self._lsl.local_clock()) - stamp
        return max(0, self._session.ticks - round(age / self._session.model.period))


def _library() -> Any:
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:  # it raises RuntimeError where its binary library is missing
        raise SessionError(
            f"Lab Streaming Layer is not available ({error}); install it with `pip install 'itouch-py[lsl]'`"
        ) from error
    return pylsl
