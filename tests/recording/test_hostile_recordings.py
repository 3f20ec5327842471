"""Hostile recordings: clear errors in bounded time and memory; nothing is run, nothing is written elsewhere."""

from __future__ import annotations

import json
import random
import resource
import struct
import zlib
from pathlib import Path

import pytest
import zstandard
from campaign import size, tell
from made import written

import itouch
from itouch.recording.reader import parse
from itouch.recording.writer import MAGIC
from itouch_tools.export.bids import export_bids
from itouch_tools.export.tables import export_csv

DATA, ENDS, _ = written(chunks=6)


def chunk(data: bytes, *, said: int | None = None, kind: bytes = b"zstd", packed: bytes | None = None) -> bytes:
    body = zstandard.compress(data) if packed is None else packed
    said = len(data) if said is None else said
    head = struct.pack("<QQQII", 0, 0, said, zlib.crc32(data), len(kind)) + kind + struct.pack("<Q", len(body))
    return struct.pack("<BQ", 6, len(head) + len(body)) + head + body


def text_message(channel: int, text: bytes) -> bytes:
    return struct.pack("<BQHIQQ", 5, 22 + len(text), channel, 0, 0, 0) + text


def channel_record(number: int, topic: bytes) -> bytes:
    body = struct.pack("<HHI", number, 0, len(topic)) + topic + struct.pack("<I", 4) + b"json" + struct.pack("<I", 0)
    return struct.pack("<BQ", 4, len(body)) + body


def session_chunk(session: object) -> bytes:
    data = channel_record(9, b"/log/session") + text_message(9, json.dumps(session).encode())
    return MAGIC + chunk(data)


GOOD = {"format": "1.0", "period": 1e-3, "start_ns": 0, "tracks": []}
TRACK = {"name": "a", "every": 1, "replay": True, "columns": [["a.x", "x", "f8", 0, "m"]]}

HOSTILE = {
    "unknown version": session_chunk({**GOOD, "format": "7.0"}),
    "no version": session_chunk({"period": 1e-3}),
    "a list": session_chunk([1, 2]),
    "a period of nothing": session_chunk({**GOOD, "period": 0.0}),
    "a period that is no number": session_chunk({**GOOD, "period": "x"}),
    "huge track": session_chunk({**GOOD, "tracks": [{**TRACK, "columns": [["a", "x", "f8", 1 << 40, ""]]}]}),
    "negative size": session_chunk({**GOOD, "tracks": [{**TRACK, "columns": [["a", "x", "f8", -5, ""]]}]}),
    "object column": session_chunk({**GOOD, "tracks": [{**TRACK, "columns": [["a", "x", "O", 1, ""]]}]}),
    "columns twice": session_chunk({**GOOD, "tracks": [{**TRACK, "columns": TRACK["columns"] * 2}]}),
    "tracks twice": session_chunk({**GOOD, "tracks": [TRACK, TRACK]}),
    "deep": MAGIC + chunk(channel_record(9, b"/log/session") + text_message(9, b"[" * 200_000)),
    "bomb that says so": MAGIC + chunk(b"", said=1 << 50, packed=zstandard.compress(bytes(1 << 20))),
    "bomb that lies": MAGIC + chunk(b"x", said=1, packed=zstandard.compress(bytes(80 << 20))),
    "window": MAGIC + chunk(b"x", packed=bytes.fromhex("28b52ffd00ff") + bytes(40)),
    "unknown packing": MAGIC + chunk(b"x", kind=b"xz"),
    "record of 2^63 bytes": MAGIC + struct.pack("<BQ", 6, 1 << 63),
    "many empty records": MAGIC + struct.pack("<BQ", 1, 0) * 200_000,
    "only a schema": MAGIC + chunk(struct.pack("<BQ", 3, 0)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_recording_is_refused_in_bounded_memory(name: str, tmp_path: Path) -> None:
    path = tmp_path / "h.mcap"
    path.write_bytes(HOSTILE[name])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(itouch.RecordingError, match=r"h\.mcap"):
        itouch.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 << 10


@pytest.mark.campaign
def test_mutated_recordings() -> None:
    generator, refused = random.Random(11), 0
    for number in range(size(300, 10_000)):
        broken = bytearray(DATA)
        for _ in range(generator.randint(1, 8)):
            where = generator.randrange(len(broken))
            kind = generator.randrange(4)
            if kind == 0:
                broken[where] = generator.randrange(256)
            elif kind == 1:
                del broken[where : where + generator.randint(1, 60)]
            elif kind == 2:
                broken[where:where] = generator.randbytes(generator.randint(1, 60))
            else:
                other = generator.randrange(len(broken))
                broken[where : where + 16] = broken[other : other + 16]
        try:
            content = parse(f"x{number}", bytes(broken), len(broken))
        except itouch.RecordingError:
            refused += 1
            continue
        assert len(content.rows["probe"]) % 20 == 0
    tell(f"mutated recordings: {refused} refused, the others read as far as they are right, no crash")


def test_names_of_tracks_do_not_leave_the_folder(tmp_path: Path) -> None:
    evil = {**GOOD, "tracks": [{**TRACK, "name": "../../evil"}, {**TRACK, "name": "/etc/evil"}], "manifest": {}}
    path = tmp_path / "h.mcap"
    path.write_bytes(session_chunk(evil))
    recording = itouch.read(path)
    target = tmp_path / "in" / "out"
    target.mkdir(parents=True)
    for written_file in (*export_csv(recording, str(target)), *export_bids(recording, str(target))):
        assert Path(written_file).resolve().is_relative_to(target)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["h.mcap", "in"]
    assert sorted(p.name for p in (tmp_path / "in").iterdir()) == ["out"]
