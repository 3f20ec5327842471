"""``itouch-py export FILE``: a session as one XML document, a recording as tables."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.schema import ItouchError
from itouch.schema.extras import need
from itouch.schema.regular_files import stored_kind
from itouch.schema.terminal import did, note
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser, add_json, as_json
from itouch_tools.cli.output_files import Output, output_file, output_folder, session_file

if TYPE_CHECKING:
    from itouch.recording import Recording


def main(argv: Sequence[str]) -> int:
    """Write a session as XML, or a recording as tables."""
    options = _parser().parse_args(argv)
    _chosen(options)
    try:
        with waiting(f"exporting {options.file}"):
            written = _session(options) if _is_session(options.file) else _recording(options)
    except OSError as error:
        outputs = (options.xml, options.itouch, options.csv, options.parquet, options.bids, options.layout, options.rrd,
                   options.rosbag)  # fmt: skip
        name = error.filename or next((output for output in outputs if output), options.file)
        raise ItouchError(f"cannot write '{name}': {error.strerror or error}") from error
    except ValueError as error:
        raise ItouchError(str(error)) from error
    if options.json:
        print(as_json({"file": options.file, "written": written}))
        return 0
    for path in written:
        did(f"wrote {path}")
    return 0


def _chosen(options: argparse.Namespace) -> None:
    """Take ``--output`` for the option that its ending names, and check for needed packages before the work begins."""
    if options.output:
        ending = Path(options.output).suffix.lower().lstrip(".")
        kinds = ("xml", "itouch", "csv", "parquet", "rrd")
        if ending not in kinds:
            endings = ", ".join(f".{kind}" for kind in kinds)
            raise ItouchError(f"-o '{options.output}': its ending says what to write: {endings}; a folder takes --csv, "
                              "--parquet or --bids")  # fmt: skip
        if getattr(options, ending):
            raise ItouchError(f"-o '{options.output}' and --{ending} ask for the same: omit one")
        setattr(options, ending, options.output)
    if options.parquet is not None:
        need("tables", "--parquet")
    if options.rrd:
        need("rerun", "--rrd")
    if options.rosbag:
        need("ros", "--rosbag")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="itouch-py export", description=main.__doc__)
    parser.add_argument("file", metavar="FILE", help="a session (.itouch, or its .xml) or a recording (.mcap)")
    parser.add_argument("-o", "--output", type=Output(kind="ending"), metavar="FILE",
                        help="write what its ending says: .csv, .parquet, .rrd, .xml, .itouch")  # fmt: skip
    parser.add_argument("--xml", type=Output(kind="document"), metavar="FILE.xml",
                        help="the whole session as one XML document")  # fmt: skip
    parser.add_argument(
        "--itouch", type=session_file, metavar="FILE.itouch", help="a session's XML as a snapshot again"
    )
    parser.add_argument("--csv", nargs="?", const="", metavar="FILE.csv|DIR",
                        type=Output("table", (".csv",), beside=(".columns.csv",), folder=True),
                        help="one table at servo rate, or a table per track; default: FILE-csv")  # fmt: skip
    parser.add_argument("--parquet", nargs="?", const="", metavar="FILE.parquet|DIR",
                        type=Output("table", (".parquet",), folder=True), help="the same as Parquet")  # fmt: skip
    parser.add_argument("--bids", type=output_folder, metavar="DIR", help="a BIDS folder: tables with JSON sidecars")
    parser.add_argument("--subject", default="01", metavar="LABEL", help="subject of --bids (default 01)")
    parser.add_argument("--task", default="", metavar="LABEL", help="task of --bids (default: the scene's name)")
    parser.add_argument("--author", action="append", default=[], metavar="NAME",
                        help="who made the data, for --bids; may be repeated")  # fmt: skip
    parser.add_argument("--layout", type=output_file, metavar="FILE.json",
                        help="panels for Foxglove and Lichtblick: the scene, a plot per unit, the events")  # fmt: skip
    parser.add_argument("--rrd", type=output_file, metavar="FILE.rrd",
                        help="for Rerun: the 3-D scene, the curves, the events (extra [rerun])")  # fmt: skip
    parser.add_argument("--rosbag", type=output_folder, metavar="DIR",
                        help="a bag of ROS 2: poses, wrenches, temperatures, frames, events (extra [ros])")  # fmt: skip
    add_json(parser)
    return parser


def _is_session(path: str) -> bool:
    """Tell whether a file is to be read as a session: a snapshot, or the XML of one."""
    from itouch.session import is_session

    return stored_kind(path) != "recording" and (path.endswith(".xml") or is_session(path))


def _session(options: argparse.Namespace) -> list[str]:
    from itouch.plugin.discovery import Catalog
    from itouch.schema.durable import write_whole
    from itouch.session.building import rebuild
    from itouch.session.document import to_xml
    from itouch.session.open import read_session

    if not (options.xml or options.itouch):
        raise ItouchError("say what to write a session as: --xml FILE.xml, or --itouch FILE.itouch")
    catalog = Catalog()
    snapshot = read_session(options.file, catalog)
    if options.itouch:
        rebuild(snapshot, options.file, catalog, None).save(options.itouch)
    if options.xml:
        write_whole(options.xml, to_xml(snapshot).encode())
    return [path for path in (options.xml, options.itouch) if path]


def _tell_left_out(recording: Recording, options: argparse.Namespace) -> None:
    """Print which channels are missing in a table of one file, and how to get them."""
    from itouch_tools.export.tables import left_out

    for option, ending in (("csv", ".csv"), ("parquet", ".parquet")):
        target = getattr(options, option)
        left = left_out(recording) if target and target.endswith(ending) else []
        if left:
            named = ", ".join(left[:6]) + (f" and {len(left) - 6} more" if len(left) > 6 else "")
            note(f"{target} is a table at servo rate, without what was recorded at other rates: {named}; "
                 f"--{option} FOLDER writes a table a track")  # fmt: skip


def _recording(options: argparse.Namespace) -> list[str]:
    from itouch.recording import read
    from itouch_tools.export.bids import export_bids
    from itouch_tools.export.tables import export_csv, export_parquet

    if options.xml or options.itouch:
        raise ItouchError(f"'{options.file}' is not a session; --xml writes one (.itouch) as XML")
    if (
        options.csv is None
        and options.parquet is None
        and not any((options.bids, options.layout, options.rrd, options.rosbag))
    ):
        raise ItouchError(
            "say what to write: --csv, --parquet, --bids DIR, --layout FILE.json, --rrd FILE.rrd or --rosbag DIR"
        )
    recording = read(options.file)
    for loss in recording.losses:
        note(loss)
    _tell_left_out(recording, options)
    stem, written = str(Path(options.file).with_suffix("")), []
    if options.csv is not None:
        written += export_csv(recording, options.csv or f"{stem}-csv")
    if options.parquet is not None:
        written += export_parquet(recording, options.parquet or f"{stem}-parquet")
    if options.bids:
        named = {"subject": options.subject, "task": options.task}
        written += export_bids(recording, options.bids, authors=options.author, **named)
    if options.layout:
        from itouch_tools.export.foxglove import export_layout

        written += export_layout(recording, options.layout)
    if options.rrd:
        from itouch_tools.export.rerun_viewer import export_rrd

        written += export_rrd(recording, options.rrd)
    if options.rosbag:
        from itouch_tools.export.rosbag import export_rosbag

        written += export_rosbag(recording, options.rosbag)
    return written
