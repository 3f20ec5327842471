"""Converts messages of a track to and from arrays, a whole block at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.recording.protobuf import header, template
from itouch.recording.tracks import Track

#: Bytes of a message record before its payload: opcode, length, channel, sequence, log and publish time.
HEAD = 31
_TIMES = [("sequence", "<u4", 11), ("log", "<u8", 15), ("publish", "<u8", 23)]


class Codec:
    """Encodes and decodes the message records of one track under one channel number."""

    def __init__(self, track: Track, channel: int) -> None:
        payload, layout = template(track)
        self.track, self.channel = track, channel
        self._template = np.frombuffer(header(channel, len(payload)) + payload, np.uint8)
        self.length = len(self._template)
        names, formats, offsets = [], [], []
        for name, kind, offset in _TIMES:
            names.append(name)
            formats.append(kind)
            offsets.append(offset)
        self._places: list[tuple[str, str, int]] = []
        for index, field in enumerate(layout):
            names.append(f"n{index}")
            formats.append(f"<{field.kind}" if field.count == 1 else f"({field.count},)<{field.kind}")
            offsets.append(HEAD + field.offset)
            self._places.append((f"n{index}", field.column, field.component if field.count == 1 else -1))
        self._scalars = {"tick", "time"} | {column.name for column in track.columns if column.size == 0}
        self._dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": self.length})
        self._fixed = self._constant_bytes()

    def _constant_bytes(self) -> NDArray[np.bool_]:
        """Return a mask of the bytes that are the same in every message."""
        mask = np.ones(self.length, np.bool_)
        for kind, offset in (self._dtype.fields or {}).values():  # type: ignore[misc]
            mask[offset : offset + kind.itemsize] = False
        return mask

    def encode(self, rows: NDArray[Any], sequence: int, log: NDArray[np.uint64]) -> bytes:
        """Return the message records of rows with the track's dtype; ``log`` has their times [ns].

        ``rows`` and ``log`` (n,); numbers in the units of the track's columns.
        """
        out = np.tile(self._template, len(rows)).view(self._dtype)
        out["sequence"] = (sequence + np.arange(len(rows))) & 0xFFFFFFFF
        out["log"] = out["publish"] = log
        for place, column, component in self._places:
            values = rows[column]
            out[place] = values if component < 0 or column in self._scalars else values[:, component]
        return out.tobytes()

    def count(self, data: memoryview) -> int:
        """Return how many consecutive records of this track there are at the start of ``data``."""
        most = len(data) // self.length
        if most == 0:
            return 0
        table = np.frombuffer(data, np.uint8, most * self.length).reshape(most, self.length)
        same = (table[:, :11] == self._template[:11]).all(axis=1)
        return most if same.all() else int(np.argmin(same))

    def decode(self, data: memoryview, count: int) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """Return ``count`` rows and their sequence numbers.

        Raises
        ------
        ValueError
            If a record does not have the layout of the track.
        """
        table = np.frombuffer(data, np.uint8, count * self.length).reshape(count, self.length)
        if not (table[:, self._fixed] == self._template[self._fixed]).all():
            raise ValueError(f"a message of '{self.track.name}' is not laid out as its track says")
        view = np.frombuffer(data, self._dtype, count)
        rows = np.zeros(count, self.track.dtype)
        for place, column, component in self._places:
            if component < 0 or column in self._scalars:
                rows[column] = view[place]
            else:
                rows[column][:, component] = view[place]
        return rows, view["sequence"].copy()
