"""Makes a complete recording from a damaged one: its longest valid prefix, with the index that readers need."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

from itouch.recording.errors import RecordingError
from itouch.recording.reader import read_content
from itouch.recording.sink import Sink
from itouch.recording.tracks import Track
from itouch.recording.writer import McapWriter


@dataclass(frozen=True, slots=True)
class Recovered:
    """The result: the file written, its chunks, its duration [s], and what is missing."""

    path: str
    chunks: int
    seconds: float
    losses: tuple[str, ...]


def recover(path: str, target: str) -> Recovered:
    """Write the longest valid prefix of a recording into another file.

    Raises
    ------
    RecordingError
        If nothing of it can be read, or the target cannot be written.
    """
    content = read_content(path, chunks=True)
    tracks: Sequence[Track] = list(content.tracks.values())
    period, start = float(content.session["period"]), int(content.session["start_ns"])
    part = target + ".part"
    try:
        sink = Sink(part)
        try:
            writer = McapWriter(sink, tracks, start_ns=start, period=period)
            writer.start({n: ("application/octet-stream", d) for n, d in content.attachments.items()})
            for rows, letters in content.chunks:
                writer.chunk(rows, letters)
            writer.finish()
        finally:
            sink.close()
        os.replace(part, target)
    except OSError as error:
        raise RecordingError(f"cannot write '{target}': {error.strerror or error}") from error
    ticks = [len(rows) for name, rows in content.rows.items() if content.tracks[name].replay]
    return Recovered(target, len(content.chunks), min(ticks, default=0) * period, tuple(content.losses))
