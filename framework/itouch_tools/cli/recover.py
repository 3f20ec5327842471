"""``itouch-py recover FILE.mcap``: repair a damaged recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import recording_file


def main(argv: Sequence[str]) -> int:
    """Write the longest valid prefix of a recording as a whole one, and say what is missing."""
    parser = Parser(prog="itouch-py recover", description=main.__doc__)
    parser.add_argument("recording", metavar="FILE.mcap", help="a recording that was cut or damaged")
    parser.add_argument(
        "-o",
        "--output",
        "--to",
        dest="to",
        type=recording_file,
        metavar="FILE.mcap",
        help="where to write; default: FILE-recovered.mcap",
    )
    options = parser.parse_args(argv)
    from itouch.recording.recover import recover
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
