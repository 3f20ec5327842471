"""``itouch-py recover FILE.mcap``: repair a damaged recording."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import recording_file

if TYPE_CHECKING:
    from itouch.recording.tracks import Track


def main(argv: Sequence[str]) -> int:
    """Write the longest valid prefix of a recording as a whole one, and say what is missing."""
    parser = Parser(prog="itouch-py recover", description=main.__doc__)
    parser.add_argument("recording", metavar="FILE.mcap", help="a recording that was cut or damaged")
    parser.add_argument(
        "-o",
        "--output",
        dest="to",
        type=recording_file,
        metavar="FILE.mcap",
        help="where to write; default: FILE-recovered.mcap",
    )
    options = parser.parse_args(argv)
    from itouch.schema.terminal import number_of

    source = Path(options.recording)
    target = options.to or str(source.with_name(f"{source.stem}-recovered.mcap"))
    with waiting(f"recovering {source}"):
        found = recover(str(source), target)
    print(f"{target}: {found.seconds:.3f} s in {number_of(found.chunks, 'chunk')}")
    for loss in found.losses:
        print(f"missing: {loss}")
    if not found.losses:
        print("nothing is missing")
    return 0


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
    from itouch.recording.reader import read_content
    from itouch.recording.recording_error import RecordingError
    from itouch.recording.sink import Sink
    from itouch.recording.writer import McapWriter
    from itouch.schema.durable import is_replaceable

    content = read_content(path, chunks=True)
    tracks: Sequence[Track] = list(content.tracks.values())
    period, start = float(content.session["period"]), int(content.session["start_ns"])
    place = os.path.realpath(target)  # a link to it stays one
    part = place + ".part"
    try:
        if not is_replaceable(target):
            raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
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
            os.replace(part, place)
        except BaseException:  # also of Ctrl-C: half a recording is of no use beside its damaged source
            with contextlib.suppress(OSError):
                os.unlink(part)
            raise
    except OSError as error:
        raise RecordingError(f"cannot write '{target}': {error.strerror or error}") from error
    ticks = [len(rows) for name, rows in content.rows.items() if content.tracks[name].replay]
    return Recovered(target, len(content.chunks), min(ticks, default=0) * period, tuple(content.losses))
