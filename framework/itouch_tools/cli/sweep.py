"""``itouch-py sweep``: very many runs of a scene with parameters by path, on this machine or a cluster."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from itouch.schema import ItouchError
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_folder, session_file

if TYPE_CHECKING:
    from itouch_tools.sweeps.sweep_client import Swept
    from itouch_tools.sweeps.sweep_progress import Progress
    from itouch_tools.sweeps.sweepfile import SweepFile

#: The sub-commands that may follow `sweep` instead of a file.
COMMANDS = ("check", "run", "status", "replay", "page")

#: How many runs (pilots) `check` makes to estimate what a sweep will cost, unless `--pilots` says.
PILOTS = 3

#: Most reasons that `status` prints.
MOST_REASONS = 10


def main(argv: Sequence[str]) -> int:
    """Run a sweep, say what it will cost and how far it is, run one of its rows again, or write its page."""
    words = list(argv)
    missing = _missing()
    if missing and not {"-h", "--help"} & set(words):
        print(f"sweeps need {missing}: pip install 'itouch-py[sweep]'", file=sys.stderr)
        return 2
    if words[:1] == ["check"]:
        return _check(words[1:])
    if words[:1] == ["run"]:
        return _sweep(words[1:])
    if words[:1] == ["status"]:
        return _status(words[1:])
    if words[:1] == ["replay"]:
        return _replay(words[1:])
    if words[:1] == ["page"]:
        return _page(words[1:])
    if words and re.fullmatch("[a-z]+", words[0]) and not Path(words[0]).exists():
        from itouch.schema.diagnostics import did_you_mean

        advice = did_you_mean(words[0], COMMANDS, "commands are")
        print(f"error: there is no command or file named '{words[0]}'\n  = help: {advice}", file=sys.stderr)
        return 2
    return _sweep(words)


def _missing() -> str:
    from importlib.util import find_spec

    return " and ".join(name for name in ("joblib", "scipy", "pyarrow") if find_spec(name) is None)


def _sweep(words: list[str]) -> int:
    parser = Parser(
        prog="itouch-py sweep", description=main.__doc__,
        epilog="itouch-py sweep check SWEEP.xml: runs, time and size, from a few pilots.  itouch-py sweep status "
        "FOLDER: how far it is.  itouch-py sweep replay FOLDER ROW: one run again.  itouch-py sweep page KIND FOLDER: "
        "figures and numbers of a shipped sweep.",
    )  # fmt: skip
    parser.add_argument(
        "sweep", metavar="SWEEP.xml", help="the sweep; or check, run, status, replay, page (each has --help)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=output_folder,
        metavar="FOLDER",
        required=True,
        help="its rows; goes on with what is there",
    )
    parser.add_argument("--engine", default="processes", metavar="NAME", help="processes (default), dask, or ray")
    parser.add_argument(
        "--scheduler", default="", metavar="ADDRESS", help="address of Dask's scheduler, such as tcp://HOST:8786"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="processes at once (default: one a core)")
    options = parser.parse_args(words)
    if options.workers is not None and options.workers < 1:
        print("--workers must be 1 or more", file=sys.stderr)
        return 2
    from itouch.plugin.discovery import Catalog
    from itouch_tools.sweeps.engines import Engine
    from itouch_tools.sweeps.sweep_client import Client

    catalog = Catalog()
    engine = Engine(options.engine, options.scheduler, options.workers)
    file = _load(options.sweep, catalog)
    if file is None:
        return 2
    with waiting("sweep") as wait:

        def told(progress: Progress) -> None:
            wait.part(progress.share, progress.line())

        swept = Client(file, Path(options.output), engine, catalog, told).sweep()
    return _told(swept)


def _told(swept: Swept) -> int:
    kinds = ", ".join(f"{count} {status}" for status, count in swept.counts.items()) or "none"
    print(f"{swept.rows} of {swept.runs} runs in {swept.folder}: {kinds}")
    if swept.retries or swept.losses:
        print(f"  tried again: {swept.retries} runs; engine lost: {swept.losses} times")
    if swept.ended_by:
        print(f"  ended before its end: {swept.ended_by}; the same command goes on")
    return 130 if swept.ended_by == "interrupted" else 0


def _load(path: str, catalog: Any) -> SweepFile | None:
    """Return a sweep without problems, or print them and return None."""
    from itouch.schema.diagnostics import render
    from itouch_tools.sweeps.sweep_reading import read_sweep

    found, problems = read_sweep(path, catalog)
    if problems:
        print(render(problems), file=sys.stderr)
    broken = found is None or any(problem.severity == "error" for problem in problems)
    return None if broken else found


def _check(words: list[str]) -> int:
    """Print every problem of a sweep, and what it will cost."""
    parser = Parser(prog="itouch-py sweep check", description=_check.__doc__)
    parser.add_argument("sweep", metavar="SWEEP.xml")
    parser.add_argument(
        "--pilots", type=int, default=PILOTS, metavar="N", help=f"runs that are made for it (default: {PILOTS})"
    )
    parser.add_argument("--cores", type=int, metavar="N", help="for how many cores (default: those of this machine)")
    options = parser.parse_args(words)
    from itouch.platforms import cores
    from itouch.plugin.discovery import Catalog
    from itouch.schema.diagnostics import render
    from itouch_tools.sweeps.cost_estimate import estimate
    from itouch_tools.sweeps.sweep_progress import shown_time

    catalog = Catalog()
    file = _load(options.sweep, catalog)
    if file is None:
        return 2
    with waiting("running pilots"):
        found = estimate(file, catalog, max(1, options.pilots))
    if found.problems:
        print(render(found.problems), file=sys.stderr)
    count = options.cores or cores()
    print(f"{options.sweep}: {found.runs} runs of {found.structures} scenes")
    print(f"  pilots: {', '.join(f'{n} {status}' for status, n in found.statuses.items())}; "
          f"{found.run_s:.2f} s a run, {found.build_s:.2f} s a scene")  # fmt: skip
    for reason in found.reasons:
        print(f"    {reason}")
    print(f"  about {shown_time(found.seconds / count)} on {count} cores, {shown_time(found.seconds)} on one")
    print(f"  about {_size(found.runs * found.row_bytes)}: {found.row_bytes:.0f} bytes a row")
    return 0


def _size(count: float) -> str:
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count:.0f} bytes"


def _status(words: list[str]) -> int:
    """Say how many runs of a sweep have their row, how they ended, and why; also while it runs."""
    parser = Parser(prog="itouch-py sweep status", description=_status.__doc__)
    parser.add_argument("folder", metavar="FOLDER", help="the folder of a sweep")
    options = parser.parse_args(words)
    from itouch_tools.sweeps.sweep_progress import status_of

    found = status_of(Path(options.folder))
    kinds = ", ".join(f"{count} {status}" for status, count in sorted(found.counts.items())) or "none"
    of = "" if found.runs is None else f" of {found.runs}"
    print(f"{found.rows}{of} runs in {options.folder}: {kinds}")
    for reason, count in found.reasons.most_common(MOST_REASONS):
        print(f"  {count} x {reason}")
    if len(found.reasons) > MOST_REASONS:
        print(f"  and {len(found.reasons) - MOST_REASONS} more reasons, in the column `reason`")
    return 0


def _replay(words: list[str]) -> int:
    """Run the run of one row again, to the same bytes; or open it in the window."""
    parser = Parser(prog="itouch-py sweep replay", description=_replay.__doc__)
    parser.add_argument("folder", metavar="FOLDER", help="the folder of a sweep")
    parser.add_argument("row", metavar="ROW", help="the first letters of the row's digest")
    parser.add_argument("--headless", action="store_true", help="compare with the row, without a window")
    parser.add_argument(
        "--save", type=session_file, metavar="FILE.itouch", help="write its session before the first tick"
    )
    options = parser.parse_args(words)
    from itouch_tools.sweeps.replayed_row import replay, session_of

    folder = Path(options.folder)
    if options.save:
        session_of(folder, options.row, Path(options.save))
        print(f"wrote {options.save}")
        return 0
    if options.headless:
        with waiting(f"running {options.row} again"):
            found = replay(folder, options.row)
        print(f"{found.row['digest'][:12]}: {found.again['status']}, {found.again['simulated_s'] or 0.0:g} s simulated")
        for line in found.differs:
            print(f"  differs: {line}")
        if not found.differs:
            print(f"  the same bytes: state {found.row['state'][:12] or 'none'}")
        return 1 if found.differs else 0
    return _window(folder, options.row)


def _window(folder: Path, row: str) -> int:
    import tempfile

    from itouch_tools.cli.run import main as run
    from itouch_tools.sweeps.replayed_row import session_of

    with tempfile.TemporaryDirectory(prefix="itouch-sweep-") as inner:
        target = Path(inner) / "row.itouch"
        session_of(folder, row, target)
        return run([str(target)])


def _page(words: list[str]) -> int:
    """Write numbers and a figure of a sweep."""
    from itouch_tools.sweeps.pages import names, write_page

    parser = Parser(prog="itouch-py sweep page", description=_page.__doc__)
    parser.add_argument("kind", metavar="KIND", help=f"{', '.join(names())}; or your own FILE.py:FUNCTION")
    parser.add_argument("folder", metavar="FOLDER", help="the folder of the sweep")
    parser.add_argument(
        "-o", "--output", type=output_folder, metavar="FOLDER", help="for page and figure (default: the sweep's)"
    )
    options = parser.parse_args(words)
    try:
        with waiting("writing the page"):
            written = write_page(options.kind, Path(options.folder), Path(options.output or options.folder))
    except OSError as error:
        raise ItouchError(f"cannot write '{error.filename}': {error.strerror}") from error
    print(written.read_text(encoding="utf-8"))
    return 0
