"""Reads the longest valid prefix of a recording: only complete chunks with correct checksums are believed.

Nothing is taken from the index at the end, nor from a record that no checksum covers; the sequence numbers of the
messages reveal whether a chunk between two others is missing.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from itouch.platforms import why_unread
from itouch.recording.codec import HEAD, Codec
from itouch.recording.recording_error import RecordingError
from itouch.recording.tracks import Track, load_track
from itouch.recording.writer import LETTERS, MAGIC
from itouch.schema.regular_files import open_regular

#: Largest chunk, unpacked, and largest content of all rows together [bytes].
MAX_CHUNK, MAX_CONTENT = 64 << 20, 4 << 30
#: Largest file with a motion that a scene may name [bytes], as the path of a hand or of an arm.
MAX_MOTION = 256 << 20
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _ATTACHMENT, _DATA_END = 1, 2, 3, 4, 5, 6, 9, 15
#: Records in the data section that are skipped: a header, indexes and metadata.
_PASSED = (_HEADER, 7, 12)


#: Rows by track, and letters: topic, tick, JSON.
Chunk = tuple[dict[str, NDArray[Any]], list[tuple[str, int, bytes]]]


class DamageError(ValueError):
    """From here on the file cannot be believed."""


@dataclass(slots=True)
class Content:
    """What was read: ``rows`` by track, ``letters`` by topic (JSON messages with their ticks), and what is missing."""

    path: str
    size: int
    session: dict[str, Any] = field(default_factory=dict)
    tracks: dict[str, Track] = field(default_factory=dict)
    rows: dict[str, NDArray[Any]] = field(default_factory=dict)
    letters: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    whole: bool = False
    losses: list[str] = field(default_factory=list)
    good: int = 0
    chunks: list[Chunk] = field(default_factory=list)


def unread(content: Content, what: str) -> tuple[str, str] | None:
    """Return what is wrong and what to do if it may be the damage of a recording that something is missing in it."""
    if content.whole:
        return None
    sentence = f"'{content.path}' is damaged or was cut, and {what} can be read of it: {content.losses[0]}"
    return sentence, f"take a whole copy; `itouch-py recover {content.path}` writes what can be read, and says what not"


class _RowBuffer:
    """A table that grows at its end; hours of rows take their memory about once, not twice."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self._rows, self._count = np.empty(1024, dtype), 0

    def add(self, table: NDArray[Any]) -> None:
        """Append copies of rows (n,) with the buffer's dtype."""
        needed = self._count + len(table)
        if needed > len(self._rows):
            grown = np.empty(max(needed, 2 * len(self._rows)), self._rows.dtype)
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown
        self._rows[self._count : needed] = table
        self._count = needed

    @property
    def rows(self) -> NDArray[Any]:
        """All rows; memory reserved beyond them was never touched and is not in use."""
        return self._rows[: self._count]


def read_content(path: str, *, chunks: bool = False) -> Content:
    """Read a recording as far as it is valid; ``chunks``: also keep the chunks, to write them again.

    Raises
    ------
    RecordingError
        If it cannot be opened, or is not a recording of this program.
    """
    try:
        size = os.path.getsize(path)
        with open_regular(path) as stream:
            data = stream.read()
    except OSError as error:
        raise RecordingError(f"cannot read '{path}': {why_unread(error)}") from error
    return parse(path, data, size, chunks=chunks)


def parse(path: str, data: bytes, size: int, *, chunks: bool = False) -> Content:
    """Read a recording from memory; see ``read_content``."""
    content = Content(path, size)
    if data[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"'{path}' is not a recording: it does not begin as an MCAP file")
    parser = _Parser(content, chunks)
    try:
        for opcode, body, end in _records(data):
            if opcode == _DATA_END:
                _check_end(data, body, end)
                content.good, content.whole = end, True
                break
            parser.take(opcode, body)
            content.good = end
    except DamageError as damage:
        content.losses.append(f"{damage}; {size - content.good} of {size} bytes are not read")
    if content.whole and not data.endswith(MAGIC):
        content.losses.append("the index at its end is damaged; no sample is missing")
    if not content.session:
        raise RecordingError(f"'{path}' holds no readable session{': ' + content.losses[0] if content.losses else ''}")
    parser.finish()
    return content


def _records(data: bytes) -> Iterator[tuple[int, memoryview, int]]:
    """Yield opcode, body and end of every record.

    Raises
    ------
    DamageError
        Where the file ends in the middle of one.
    """
    at, view = len(MAGIC), memoryview(data)
    while True:
        if at + 9 > len(data):
            raise DamageError(
                "the file ends without an end of its data: it is still being written, it was cut, or its "
                "writer was killed"
            )
        opcode, length = struct.unpack_from("<BQ", data, at)
        if length > len(data) - at - 9:
            raise DamageError(f"the file ends inside a record that begins at byte {at}")
        yield opcode, view[at + 9 : at + 9 + length], at + 9 + length
        at += 9 + length


def _check_end(data: bytes, body: memoryview, end: int) -> None:
    """Check that the record of the end of data is valid, and that nothing before it is missing or altered."""
    if len(body) != 4:
        raise DamageError("the record that ends the data is not valid")
    (crc,) = struct.unpack("<I", body)
    if zlib.crc32(memoryview(data)[: end - 13]) != crc:
        raise DamageError("the checksum of all the data does not match: something in it is missing or altered")


class _Parser:
    def __init__(self, content: Content, chunks: bool) -> None:
        self.content, self._keep = content, chunks
        self._codecs: dict[int, Codec] = {}
        self._topics: dict[int, str] = {}
        self._growing: dict[str, _RowBuffer] = {}
        self._next: dict[int, int] = {}
        self._total = 0

    def take(self, opcode: int, body: memoryview) -> None:
        """Take one record of the data.

        Raises
        ------
        DamageError
            If it cannot be believed.
        """
        if opcode == _CHUNK:
            self._chunk(body)
        elif opcode == _ATTACHMENT:
            self._attachment(body)
        elif opcode not in _PASSED:
            raise DamageError(f"a record of kind {opcode} does not belong among the data")

    def _attachment(self, body: memoryview) -> None:
        try:
            data = bytes(body)
            (crc,) = struct.unpack("<I", data[-4:])
            if zlib.crc32(data[:-4]) != crc:
                raise ValueError("its checksum does not match")
            at = 16
            (length,) = struct.unpack_from("<I", data, at)
            name = data[at + 4 : at + 4 + length].decode()
            at += 4 + length
            at += 4 + struct.unpack_from("<I", data, at)[0]
            (size,) = struct.unpack_from("<Q", data, at)
            self.content.attachments[name] = data[at + 8 : at + 8 + size]
        except (ValueError, struct.error) as error:
            self.content.losses.append(f"an attachment is damaged ({error}); no sample is missing")

    def _chunk(self, body: memoryview) -> None:
        data = _unpacked(body)
        try:
            self._messages(data)
        except (ValueError, KeyError, TypeError, AttributeError, struct.error, RecursionError) as error:
            raise DamageError(f"a chunk makes no sense: {error}") from error

    def _messages(self, data: bytes) -> None:
        """Take the records of a chunk; all of them, or none."""
        view, at = memoryview(data), 0
        rows: list[tuple[str, NDArray[Any]]] = []
        letters: list[tuple[str, dict[str, Any], bytes]] = []
        following = dict(self._next)
        while at < len(data):
            opcode, length = struct.unpack_from("<BQ", data, at)
            end = at + 9 + length
            if end > len(data):
                raise ValueError("a record is longer than its chunk")
            if opcode == _MESSAGE:
                channel, sequence = struct.unpack_from("<HI", data, at + 9)
                codec = self._codecs.get(channel)
                count = codec.count(view[at:]) if codec is not None else 1
                if count == 0:
                    raise ValueError("a message has another length than its track says")
                _check_sequence(following, channel, sequence, count)
                if codec is not None:
                    rows.append((codec.track.name, self._rows(codec, view[at:], count)))
                    end = at + count * codec.length
                elif (topic := self._topics.get(channel)) is not None:
                    text = bytes(view[at + HEAD : end])
                    letters.append((topic, self._letter(topic, text), text))
            elif opcode == _CHANNEL:
                self._channel(bytes(view[at + 9 : end]))
            elif opcode != _SCHEMA:
                raise ValueError(f"a record of kind {opcode} does not belong into a chunk")
            at = end
        self._next = following
        for name, table in rows:
            self._growing[name].add(table)
        for topic, letter, _ in letters:
            if topic != "/log/session":
                self.content.letters.setdefault(topic, []).append(letter)
        if self._keep:
            kept = [(topic, int(letter.get("tick", 0)), text) for topic, letter, text in letters]
            self.content.chunks.append((dict(rows), kept))

    def _rows(self, codec: Codec, data: memoryview, count: int) -> NDArray[Any]:
        rows, sequence = codec.decode(data, count)
        if count > 1 and (np.diff(sequence) != 1).any():
            raise ValueError("messages are missing")
        self._total += rows.nbytes
        if self._total > MAX_CONTENT:
            raise RecordingError(f"'{self.content.path}' holds more than {MAX_CONTENT >> 30} GiB of rows")
        return rows

    def _letter(self, topic: str, data: bytes) -> dict[str, Any]:
        found = json.loads(data)
        if not isinstance(found, dict):
            raise ValueError(f"a message of '{topic}' is not a JSON object")
        if topic != "/log/session":
            found["tick"], found["time"] = int(found["tick"]), float(found["time"])
        elif not self.content.session:
            self._begin(found)
        return found

    def _begin(self, session: dict[str, Any]) -> None:
        """Read the tracks from the first message; channels are numbered in their order."""
        if str(session["format"]).split(".")[0] != "1":
            raise RecordingError(
                f"'{self.content.path}' has recording format {str(session['format'])[:20]}; this program reads 1.x"
            )
        tracks = [load_track(track) for track in session["tracks"]]
        period, start = float(session["period"]), int(session["start_ns"])
        if not (1e-6 <= period <= 1.0 and 0 <= start < 1 << 63):
            raise ValueError(f"a period of {period!r} s is impossible")
        if len({track.name for track in tracks}) < len(tracks):
            raise ValueError("two tracks have one name")
        self.content.session = session
        self.content.tracks = {track.name: track for track in tracks}
        self._codecs = {index: Codec(track, index) for index, track in enumerate(tracks, start=1)}
        self._growing = {track.name: _RowBuffer(track.dtype) for track in tracks}

    def _channel(self, data: bytes) -> None:
        number, _, length = struct.unpack_from("<HHI", data, 0)
        topic = data[8 : 8 + length].decode()
        if topic in LETTERS:
            self._topics[number] = topic

    def finish(self) -> None:
        """Put the rows into the content."""
        self.content.rows = {name: growing.rows for name, growing in self._growing.items()}


def _check_sequence(following: dict[int, int], channel: int, sequence: int, count: int) -> None:
    if sequence != following.get(channel, 0) & 0xFFFFFFFF:
        raise ValueError("messages before it are missing")
    following[channel] = sequence + count


def _unpacked(body: memoryview) -> bytes:
    """Return the content of a chunk, checked by its checksum.

    Raises
    ------
    DamageError
        If the checksum does not match, or the chunk is too large or cannot be unpacked.
    """
    try:
        _, _, size, crc, length = struct.unpack_from("<QQQII", body, 0)
        kind = bytes(body[32 : 32 + length])
        (packed,) = struct.unpack_from("<Q", body, 32 + length)
        data = body[40 + length : 40 + length + packed]
    except struct.error as error:
        raise DamageError("a chunk is too short") from error
    if size > MAX_CHUNK or len(data) != packed:
        raise DamageError(f"a chunk says that it holds {size} bytes")
    try:
        if kind == b"zstd":
            if zstandard.frame_content_size(data) not in (size, -1):
                raise DamageError("a chunk does not hold what it says")
            plain = zstandard.ZstdDecompressor(max_window_size=1 << 27).decompress(data, max_output_size=size or 1)
        elif kind == b"":
            plain = bytes(data)
        else:
            raise DamageError("a chunk is packed in an unknown way")
    except (zstandard.ZstdError, MemoryError) as error:
        raise DamageError("a chunk can't be unpacked") from error
    if len(plain) != size or zlib.crc32(plain) != crc:
        raise DamageError("the checksum of a chunk does not match")
    return plain
