"""Recordings for tests: small ones, made by a session or straight by the writer."""

from __future__ import annotations

import base64
import io
import zlib
from pathlib import Path

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from shipped import SCENES

import itouch
from itouch.recording.chunking import message
from itouch.recording.spec import Spec
from itouch.recording.tracks import Column, Track
from itouch.recording.writer import McapWriter


def record(path: Path, scene: str = "first_touch", seconds: float = 1.0, *, seed: int = 1) -> itouch.Session:
    """Record a run of a shipped scene; the session is closed."""
    session = itouch.build(SCENES / f"{scene}.xml", seed=seed)
    session.record(path)
    session.run(seconds)
    session.close()
    return session


class Memory:
    """An output that keeps what was written, and where each write ended."""

    def __init__(self) -> None:
        self.data, self.size, self.ends = bytearray(), 0, []

    ends: list[int]

    def write(self, data: bytes) -> None:
        self.data += data
        self.size = len(self.data)
        self.ends.append(self.size)

    def sync(self) -> None:
        """Nothing to wait for."""


def track(columns: int = 6, *, every: int = 1, name: str = "probe") -> Track:
    made = [Column(f"{name}.c{i}", f"c{i}", "f8", (0, 3, 7)[i % 3], "m") for i in range(columns)]
    return Track(name, every, True, tuple(made))


def rows_of(one: Track, begin: int, count: int) -> NDArray[np.void]:
    """Rows of numbers that don't shrink when they are packed."""
    generator = np.random.default_rng(begin)
    table = np.zeros(count, one.dtype)
    table["tick"] = (begin + np.arange(count)) * one.every
    table["time"] = table["tick"] * 1e-3
    for column in one.columns:
        table[column.name] = generator.standard_normal(table[column.name].shape)
    return table


def written(chunks: int = 30, rows: int = 20, *, finish: bool = True) -> tuple[bytes, list[int], NDArray[np.void]]:
    """A recording made by the writer: its bytes, the ends of its writes, and its rows."""
    one, out = track(), Memory()
    spec = Spec((one,), {}, {}, 1e-3, 1_700_000_000_000_000_000, {"manifest": {}, "layout": []}, {})
    writer = McapWriter(out, (one,), start_ns=spec.start_ns, period=spec.period)
    writer.start({"scene.xml": ("application/xml", b"<itouch/>")})
    stream = io.BytesIO()
    npy.write_array(stream, np.zeros(1, [("tick", "i8")]), allow_pickle=False)
    state = base64.b64encode(zlib.compress(stream.getvalue())).decode()
    first = [("/log/session", 0, spec.first_message()), ("/log/state", 0, message(0, 1e-3, reason="start", npy=state))]
    writer.chunk({}, first)
    table = rows_of(one, 0, chunks * rows)
    for index in range(chunks):
        part = table[index * rows : (index + 1) * rows]
        letters = [
            ("/log/marks", int(part["tick"][0]), message(int(part["tick"][0]), 1e-3, name="m", payload=str(index)))
        ]
        writer.chunk({one.name: part}, letters)
    if finish:
        writer.finish()
    return bytes(out.data), out.ends, table
