"""``itouch-py export FILE``: a session as one XML document, a recording as tables."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from itouch.schema import ItouchError


def main(argv: Sequence[str]) -> int:
    """Write a session as XML, or a recording as tables."""
    options = _parser().parse_args(argv)
    try:
        written = _session(options) if options.file.endswith((".itouch", ".xml")) else _recording(options)
    except OSError as error:
        outputs = (options.xml, options.itouch, options.csv, options.parquet, options.bids, options.hjif)
        name = error.filename or next((output for output in outputs if output), options.file)
        raise ItouchError(f"cannot write '{name}': {error.strerror or error}") from error
    except ValueError as error:
        raise ItouchError(str(error)) from error
    for path in written:
        print(f"wrote {path}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="itouch-py export", description=main.__doc__)
    parser.add_argument("file", metavar="FILE", help="a session (.itouch, or its .xml) or a recording (.mcap)")
    parser.add_argument("--xml", metavar="FILE.xml", help="the whole session as one XML document")
    parser.add_argument("--itouch", metavar="FILE.itouch", help="a session's XML as a snapshot again")
    parser.add_argument("--csv", nargs="?", const="", metavar="FILE.csv|DIR",
                        help="one table at servo rate, or a table a track; default: FILE-csv")  # fmt: skip
    parser.add_argument("--parquet", nargs="?", const="", metavar="FILE.parquet|DIR", help="the same as Parquet")
    parser.add_argument("--bids", metavar="DIR", help="a BIDS folder: tables with JSON sidecars")
    parser.add_argument("--subject", default="01", metavar="LABEL", help="subject of --bids (default 01)")
    parser.add_argument("--task", default="", metavar="LABEL", help="task of --bids (default: the scene's name)")
    parser.add_argument("--author", action="append", default=[], metavar="NAME",
                        help="who made the data, for --bids; may be given again")  # fmt: skip
    parser.add_argument("--hjif", metavar="FILE.hjif", help="temperature and force as a haptic file of MPEG")
    return parser


def _session(options: argparse.Namespace) -> list[str]:
    from itouch.plugin.discovery import Catalog
    from itouch.session.building import rebuild
    from itouch.session.document import to_xml
    from itouch.session.durable import write_whole
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


def _recording(options: argparse.Namespace) -> list[str]:
    from itouch.recording import read
    from itouch.recording.bids import export_bids
    from itouch.recording.tables import export_csv, export_parquet

    if options.xml or options.itouch:
        raise ItouchError(f"'{options.file}' is not a session; --xml writes one (.itouch) as XML")
    if options.csv is None and options.parquet is None and not options.bids and not options.hjif:
        raise ItouchError("say what to write: --csv, --parquet, --bids DIR or --hjif FILE")
    recording = read(options.file)
    for loss in recording.losses:
        print(f"note: {loss}")
    stem, written = str(Path(options.file).with_suffix("")), []
    if options.csv is not None:
        written += export_csv(recording, options.csv or f"{stem}-csv")
    if options.parquet is not None:
        written += export_parquet(recording, options.parquet or f"{stem}-parquet")
    if options.bids:
        named = {"subject": options.subject, "task": options.task}
        written += export_bids(recording, options.bids, authors=options.author, **named)
    if options.hjif:
        from itouch.recording.hjif import export_hjif

        written += export_hjif(recording, options.hjif)
    return written
