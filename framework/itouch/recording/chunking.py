"""Puts rows and messages of a ring together into a chunk with a bounded number of rows; `process` says how often."""

from __future__ import annotations

import base64
import io
import json
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from itouch.recording.ring import ControlWord, Ring
from itouch.recording.spec import Spec
from itouch.recording.views import Drawing
from itouch.recording.writer import McapWriter, Output

#: Kinds of letter (a message in the ring): the specification, a JSON message of a topic, a whole State.
SPEC, MESSAGE, STATE = 1, 2, 3
#: Greatest number of rows in a chunk.
MOST_ROWS = 4096
#: Words for the status of a device, by its number.
STATUSES = ("closed", "open", "enabled", "fault")

Letter = tuple[str, int, bytes]


class ChunkBuilder:
    """Writes one recording; each ``step`` writes what is in the ring."""

    def __init__(self, ring: Ring, spec: Spec, output: Output, dtype: np.dtype[Any]) -> None:
        self.ring, self.spec, self._dtype = ring, spec, dtype
        self.writer = McapWriter(output, spec.tracks, start_ns=spec.start_ns, period=spec.period)
        self._picks = {track.name: spec.row_dtype(track, ring.shape.row) for track in spec.tracks}
        self._status_of: dict[str, int] = {}
        self._output = output
        self._drawing = Drawing(spec.view, spec.places, period=spec.period, start_ns=spec.start_ns)

    def begin(self) -> None:
        """Write the head of the file, with the first State, which is posted right after the specification."""
        self.writer.start(self.spec.attachments)
        self.writer.chunk({}, [("/log/session", 0, self.spec.first_message()), *self._letters()])
        self._tell()

    def step(self, *, most: int = MOST_ROWS) -> int:
        """Write the rows (at most ``most``) and letters in the ring as one chunk; return the number of rows."""
        letters = self._letters()
        ticks, rows = self._rows(most)
        tables = {track.name: self._table(track.name, ticks, rows) for track in self.spec.tracks}
        letters += self._lifecycle(ticks, rows)
        letters += self._drawing.messages(ticks, rows)
        if len(ticks) or letters:
            self.writer.chunk(tables, letters)
            self._tell()
        return len(ticks)

    def _tell(self) -> None:
        self.ring.words[ControlWord.ROWS_WRITTEN] = self.ring.words[ControlWord.ROWS_OUT]
        self.ring.words[ControlWord.BYTES_WRITTEN] = self._output.size

    def _rows(self, most: int) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Take rows out of the ring as copies: ticks (n,) and bytes (n, row)."""
        ring, shape = self.ring, self.ring.shape
        begin = ring.words[ControlWord.ROWS_OUT]
        count = min(most, ring.words[ControlWord.ROWS_IN] - begin)
        places = (begin + np.arange(count)) % shape.rows
        ticks = np.frombuffer(ring.ticks, np.int64)[places]
        rows = np.frombuffer(ring.rows, np.uint8).reshape(shape.rows, shape.row)[places]
        ring.words[ControlWord.ROWS_OUT] = begin + count
        return ticks, rows

    def _table(self, name: str, ticks: NDArray[np.int64], rows: NDArray[np.uint8]) -> NDArray[Any]:
        """Return the rows of a track that are due at its rate."""
        track = next(track for track in self.spec.tracks if track.name == name)
        due = ticks % track.every == 0
        picked = rows[due].view(self._picks[name]).reshape(-1)
        table = np.zeros(len(picked), track.dtype)
        table["tick"] = ticks[due]
        table["time"] = table["tick"] * self.spec.period
        for column in track.columns:
            table[column.name] = picked[column.name]
        return table

    def _letters(self) -> list[Letter]:
        found: list[Letter] = []
        while (letter := self.ring.take()) is not None:
            kind, data = letter
            tick = int.from_bytes(data[:8], "little", signed=True)
            if kind == STATE:
                reason, _, body = data[8:].partition(b"\n")
                found.append(("/log/state", tick, self.state_message(tick, reason.decode(), body)))
            elif kind == MESSAGE:
                topic, _, body = data[8:].partition(b"\n")
                found.append((topic.decode(), tick, body))
        return found

    def state_message(self, tick: int, reason: str, body: bytes) -> bytes:
        """Return the message of a whole State."""
        stream = io.BytesIO()
        npy.write_array(stream, np.frombuffer(body, self._dtype), allow_pickle=False)
        packed = base64.b64encode(zlib.compress(stream.getvalue(), 1)).decode()
        return message(tick, self.spec.period, reason=reason, npy=packed)

    def _lifecycle(self, ticks: NDArray[np.int64], rows: NDArray[np.uint8]) -> list[Letter]:
        """Return a message for every change of a device's status."""
        found: list[Letter] = []
        for device, place in self.spec.statuses.items():
            values = rows[:, place : place + 8].copy().view(np.int64).reshape(-1)
            before = np.concatenate(([self._status_of.get(device, -1)], values[:-1])) if len(values) else values
            for index in np.flatnonzero(values != before):
                tick, value = int(ticks[index]), int(values[index])
                status = STATUSES[value] if 0 <= value < len(STATUSES) else str(value)
                found.append(("/log/lifecycle", tick, message(tick, self.spec.period, device=device, status=status)))
            if len(values):
                self._status_of[device] = int(values[-1])
        return found

    def drain(self, *, more: Callable[[], bool] = lambda: False) -> None:
        """Write everything that is left, and the end of the file."""
        while self.step() or more():
            pass
        self.writer.finish()
        self._tell()


def message(tick: int, period: float, **content: Any) -> bytes:
    """Return a JSON message with its tick and time [s]."""
    return json.dumps({"tick": tick, "time": tick * period, **content}).encode()
