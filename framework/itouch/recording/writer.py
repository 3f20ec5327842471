"""Writes MCAP files chunk by chunk; each chunk is complete in itself, so that a file may be cut off anywhere.

Source of the format: the MCAP specification; records are made by the library ``mcap``, except messages and their
indexes, which are made as whole arrays.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from itouch.recording.codec import Codec
from itouch.recording.protobuf import descriptor, header, schema_name
from itouch.recording.tracks import Track
from itouch.recording.views import TOPICS, schema

MAGIC = b"\x89MCAP0\r\n"
PROFILE, LIBRARY = "itouch", "itouch-py"
#: Compression level of Zstandard, from 1, the fastest, to 22.
LEVEL = 1
#: Topics with JSON messages, and the properties of their schemas: see the reference of the format.  A list of numbers
#: is ``number[]``.  Nested lists (histograms) are left out: Foxglove and Lichtblick would refuse the whole topic.
LETTERS: dict[str, dict[str, Any]] = {
    "/log/session": {},
    "/log/state": {"tick": "integer", "time": "number", "reason": "string", "npy": "string"},
    "/log/events": {"tick": "integer", "time": "number", "kind": "string", "probe": "string", "object": "string",
                "point": "number[]", "normal": "number[]", "distance": "number", "speed": "number",
                "tangential_velocity": "number[]", "penetration": "number", "force": "number", "area": "number"},
    "/log/marks": {"tick": "integer", "time": "number", "name": "string", "payload": "string"},
    "/log/left_out": {"tick": "integer", "time": "number", "seconds": "number", "running": "integer"},
    "/log/faults": {"tick": "integer", "time": "number", "device": "string", "trip": "string", "cause": "string"},
    "/log/lifecycle": {"tick": "integer", "time": "number", "device": "string", "status": "string"},
    "/log/timing": {"tick": "integer", "time": "number", "p50": "number", "p99": "number", "max": "number",
                "overruns": "integer", "lost": "integer", "waiting": "integer"},
    "/log/report": {"tick": "integer", "time": "number", "report": "object"},
}  # fmt: skip


class Output(Protocol):
    """The file that is written to."""

    size: int

    def write(self, data: bytes) -> None:
        """Append whole records, or raise OSError."""

    def sync(self) -> None:
        """Wait until everything is on the disk."""


def json_schema(name: str, properties: Mapping[str, str]) -> bytes:
    """Return the JSON schema of a topic's messages."""
    body: dict[str, Any] = {key: {"type": kind} for key, kind in properties.items()}
    for key, kind in properties.items():
        if kind.endswith("[]"):
            body[key] = {"type": "array", "items": {"type": kind.removesuffix("[]")}}
    return json.dumps({"title": name, "type": "object", "properties": body}).encode()


class McapWriter:
    """Writes tracks and letters: call ``start``, any number of ``chunk``, and ``finish``."""

    def __init__(self, output: Output, tracks: Sequence[Track], *, start_ns: int, period: float) -> None:
        self.output, self.start_ns, self.period = output, start_ns, period
        self.codecs = {track.name: Codec(track, index) for index, track in enumerate(tracks, start=1)}
        self.letters = {topic: len(tracks) + index for index, topic in enumerate((*LETTERS, *TOPICS), start=1)}
        self.rows = dict.fromkeys(self.codecs, 0)
        self._said = dict.fromkeys(self.letters, 0)
        self._schemas, self._channels = _catalogue(tracks, self.letters)
        self._chunks: list[records.ChunkIndex] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._times = [0xFFFFFFFFFFFFFFFF, 0]
        self._crc = 0
        self._packer = zstandard.ZstdCompressor(level=LEVEL)

    def _put(self, data: bytes) -> None:
        self.output.write(data)
        self._crc = zlib.crc32(data, self._crc)

    def start(self, attachments: Mapping[str, tuple[str, bytes]]) -> None:
        """Write the head of the file, and the attachments: name -> (media type, content)."""
        builder = RecordBuilder()
        records.Header(PROFILE, LIBRARY).write(builder)
        self._put(MAGIC + _taken(builder))
        for name, (kind, data) in attachments.items():
            at = self.output.size
            made = records.Attachment(self.start_ns, self.start_ns, name, kind, data)
            made.write(builder)
            written = _taken(builder)
            self._put(written)
            self._attachments.append(
                records.AttachmentIndex(
                    offset=at, length=len(written), create_time=self.start_ns, log_time=self.start_ns,
                    data_size=len(data), name=name, media_type=kind,
                )
            )  # fmt: skip

    def time_of(self, tick: int) -> int:
        """Return the time of a tick [ns since 1970]: start of the recording plus session time."""
        return self.start_ns + max(0, round(tick * self.period * 1e9))

    def chunk(self, rows: Mapping[str, NDArray[Any]], letters: Sequence[tuple[str, int, bytes]]) -> None:
        """Write rows (with each track's dtype) and letters (topic, tick, bytes) as one chunk.

        Raises
        ------
        OSError
            If the chunk could not be written; the file then ends before it.
        """
        parts: list[bytes] = [] if self._chunks else [self._head()]
        size, index, span = sum(map(len, parts)), _Index(), _Span()
        for name, table in rows.items():
            if len(table):
                codec = self.codecs[name]
                log = np.uint64(self.start_ns) + np.rint(table["tick"] * (self.period * 1e9)).astype(np.uint64)
                parts.append(codec.encode(table, self.rows[name], log))
                index.block(codec.channel, log, size, codec.length)
                span.add(int(log.min()), int(log.max()))
                size += len(parts[-1])
        said = dict(self._said)
        for topic, tick, data in letters:
            log_ns = self.time_of(tick)
            parts.append(self._letter(topic, said[topic], data, log_ns))
            said[topic] += 1
            index.one(self.letters[topic], log_ns, size)
            span.add(log_ns, log_ns)
            size += len(parts[-1])
        if index.counts:
            self._write_chunk(b"".join(parts), index, span)
            for name, table in rows.items():
                self.rows[name] += len(table)
            self._said = said

    def _letter(self, topic: str, sequence: int, data: bytes, log_ns: int) -> bytes:
        head = bytearray(header(self.letters[topic], len(data)))
        struct.pack_into("<IQQ", head, 11, sequence & 0xFFFFFFFF, log_ns, log_ns)
        return bytes(head) + data

    def _head(self) -> bytes:
        builder = RecordBuilder()
        for record in (*self._schemas, *self._channels):
            record.write(builder)
        return _taken(builder)

    def _write_chunk(self, data: bytes, index: _Index, span: _Span) -> None:
        packed = self._packer.compress(data)
        builder = RecordBuilder()
        records.Chunk("zstd", packed, span.last, span.first, zlib.crc32(data), len(data)).write(builder)
        chunk = _taken(builder)
        indexes, offsets = index.records(self.output.size + len(chunk))
        at = self.output.size
        self._put(chunk + indexes)
        self._chunks.append(
            records.ChunkIndex(
                chunk_length=len(chunk), chunk_start_offset=at, compression="zstd", compressed_size=len(packed),
                message_end_time=span.last, message_index_length=len(indexes), message_index_offsets=offsets,
                message_start_time=span.first, uncompressed_size=len(data),
            )
        )  # fmt: skip
        self._times = [min(self._times[0], span.first), max(self._times[1], span.last)]

    def finish(self) -> None:
        """Write the end of the data and the summary, by which readers find everything quickly."""
        builder = RecordBuilder()
        records.DataEnd(self._crc).write(builder)
        self.output.write(_taken(builder))
        start = self.output.size
        groups: list[tuple[int, Sequence[records.McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels), (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks), (Opcode.ATTACHMENT_INDEX, self._attachments),
        ]  # fmt: skip
        offsets = []
        for opcode, listed in groups:
            begin = builder.count
            for record in listed:
                record.write(builder)
            if builder.count > begin:
                offsets.append(records.SummaryOffset(opcode, start + begin, builder.count - begin))
        place = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = _taken(builder)
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, place), zlib.crc32(summary))
        records.Footer(start, place, crc).write(builder)
        self.output.write(summary + _taken(builder) + MAGIC)
        self.output.sync()

    def _statistics(self) -> records.Statistics:
        counts = {codec.channel: self.rows[name] for name, codec in self.codecs.items()}
        counts |= {self.letters[topic]: count for topic, count in self._said.items()}
        total = sum(counts.values())
        return records.Statistics(
            attachment_count=len(self._attachments), channel_count=len(self._channels),
            channel_message_counts={key: count for key, count in counts.items() if count},
            chunk_count=len(self._chunks), message_count=total, message_end_time=self._times[1],
            message_start_time=self._times[0] if total else 0, metadata_count=0, schema_count=len(self._schemas),
        )  # fmt: skip


def _taken(builder: RecordBuilder) -> bytes:
    """Return the bytes built so far, and empty the builder."""
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class _Span:
    """First and last time of a chunk."""

    def __init__(self) -> None:
        self.first, self.last = 0xFFFFFFFFFFFFFFFF, 0

    def add(self, first: int, last: int) -> None:
        self.first, self.last = min(self.first, first), max(self.last, last)


class _Index:
    """The places of a chunk's messages, by channel."""

    def __init__(self) -> None:
        self.counts = 0
        self._entries: dict[int, list[NDArray[np.uint64]]] = {}

    def block(self, channel: int, log: NDArray[np.uint64], begin: int, length: int) -> None:
        """Add consecutive messages of equal length."""
        places = np.uint64(begin) + np.arange(len(log), dtype=np.uint64) * np.uint64(length)
        self._entries.setdefault(channel, []).append(np.stack((log, places), axis=1))
        self.counts += len(log)

    def one(self, channel: int, log: int, begin: int) -> None:
        """Add one message."""
        self._entries.setdefault(channel, []).append(np.array([[log, begin]], np.uint64))
        self.counts += 1

    def records(self, at: int) -> tuple[bytes, dict[int, int]]:
        """Return the index records, which begin at offset ``at`` in the file, and the offset of each."""
        out, offsets = bytearray(), {}
        for channel, tables in self._entries.items():
            data = np.concatenate(tables).tobytes()
            offsets[channel] = at + len(out)
            out += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data
        return bytes(out), offsets


def _catalogue(
    tracks: Sequence[Track], letters: Mapping[str, int]
) -> tuple[list[records.Schema], list[records.Channel]]:
    schemas, channels = [], []
    for number, track in enumerate(tracks, start=1):
        schemas.append(records.Schema(number, descriptor(track), "protobuf", schema_name(track)))
        units = {column.name: column.unit for column in track.columns if column.unit}
        metadata = {"units": json.dumps(units), "every": str(track.every), "replay": "yes" if track.replay else "no"}
        metadata["meanings"] = json.dumps({column.name: column.doc for column in track.columns if column.doc})
        channels.append(records.Channel(number, track.topic, "protobuf", metadata, number))
    for topic, number in letters.items():
        if topic in TOPICS:
            name, described = schema(topic)
            schemas.append(records.Schema(number, described, "protobuf", name))
            channels.append(records.Channel(number, topic, "protobuf", {}, number))
            continue
        name = "itouch." + topic.removeprefix("/log/")
        schemas.append(records.Schema(number, json_schema(name, LETTERS[topic]), "jsonschema", name))
        channels.append(records.Channel(number, topic, "json", {}, number))
    return schemas, channels
