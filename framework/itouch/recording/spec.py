"""What the writing process is told at the start: tracks, the places of their columns in a row, and the session."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from itouch.recording.tracks import Track, load_track
from itouch.recording.views import View

#: Version of the recording format.
FORMAT = "1.0"


@dataclass(frozen=True, slots=True)
class Spec:
    """A recording before its first row.

    ``places`` has the byte at which each field of State begins in a row of the ring; ``session`` has what a replay
    needs: manifest, layout, scene and bases, as plain data; ``view`` has what 3-D viewers draw.
    """

    tracks: tuple[Track, ...]
    places: Mapping[str, int]
    statuses: Mapping[str, int]
    period: float
    start_ns: int
    session: Mapping[str, Any]
    attachments: Mapping[str, tuple[str, bytes]]
    view: View = View()

    def dump(self) -> bytes:
        """Return it as JSON."""
        return json.dumps(
            {
                "tracks": [track.dump() for track in self.tracks],
                "places": dict(self.places),
                "statuses": dict(self.statuses),
                "period": self.period,
                "start_ns": self.start_ns,
                "session": dict(self.session),
                "attachments": {n: [k, base64.b64encode(d).decode()] for n, (k, d) in self.attachments.items()},
                "view": self.view.dump(),
            }
        ).encode()

    @classmethod
    def load(cls, data: bytes) -> Spec:
        """Return it from JSON."""
        found = json.loads(data)
        return cls(
            tuple(load_track(track) for track in found["tracks"]),
            found["places"],
            found["statuses"],
            found["period"],
            found["start_ns"],
            found["session"],
            {name: (kind, base64.b64decode(text)) for name, (kind, text) in found["attachments"].items()},
            View.load(found["view"]),
        )

    def row_dtype(self, track: Track, size: int) -> np.dtype[Any]:
        """Return the dtype that picks a track's columns out of rows of ``size`` bytes."""
        names = [column.name for column in track.columns]
        formats = ["<" + c.kind if c.size == 0 else f"({c.size},)<{c.kind}" for c in track.columns]
        offsets = [self.places[column.field] for column in track.columns]
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    def first_message(self) -> bytes:
        """Return the first message of the file, with which the file alone suffices to be read and replayed."""
        tracks = [track.dump() for track in self.tracks]
        body = {"format": FORMAT, "period": self.period, "start_ns": self.start_ns, "tracks": tracks}
        return json.dumps({**body, **self.session}).encode()


def columns_of(tracks: Sequence[Track]) -> list[tuple[str, int]]:
    """Return every field that the tracks need, with its size in bytes."""
    return list({c.field: (c.field, 8 * max(1, c.size)) for track in tracks for c in track.columns}.values())
