"""``itouch-py study power|audit|coverage|export``: what a study can find, whether it is blind, its data as tables."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import add_command
from itouch_tools.cli.output_files import Output, output_file, output_folder, write_output

if TYPE_CHECKING:
    from itouch_tools.study.reading import StudyFile


def add_parsers(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the commands' options."""
    power = add_command(commands, "power", "intervals and power of equivalence against the size of the panel")
    power.add_argument("study", metavar="STUDY.xml", help="the study")
    power.add_argument("--panel", type=_numbers, default=(8, 16, 24, 32, 40), metavar="8..40",
                       help="sizes: 8..40, 8..40:4 or 8,12,20 (default: 8..40:8)")  # fmt: skip
    power.add_argument(
        "--repetitions", type=_numbers, default=(), metavar="5,10", help="numbers of repetitions; default: the study's"
    )
    power.add_argument(
        "--model", default="flux", metavar="NAME", help="flux, combined, receptors, naive, or a plugin's"
    )
    power.add_argument("--studies", type=int, default=400, metavar="N", help="panels drawn for each (default: 400)")
    power.add_argument("--seed", type=int, default=1, metavar="N", help="seed of people and panels (default: 1)")
    power.add_argument("--json", type=output_file, metavar="FILE", help="write the numbers too")
    audit = add_command(commands, "audit", "let a classifier guess the condition from all but heat and force")
    audit.add_argument("study", metavar="STUDY.xml", help="the study")
    audit.add_argument("--trials", type=int, default=1000, metavar="N", help="on the twins (default: 1000)")
    audit.add_argument("--seed", type=int, default=1, metavar="N", help="seed of order, noise and folds (default: 1)")
    audit.add_argument("--without", action="store_true", help="as if the study had no <blind>")
    coverage = add_command(commands, "coverage", "check intervals and tests against synthetic studies")
    coverage.add_argument(
        "--studies", type=int, default=500, metavar="N", help="number of studies for coverage (default: 500)"
    )
    coverage.add_argument(
        "--null", type=int, default=2000, metavar="N", help="number of studies for the errors of tests (default: 2000)"
    )
    export = add_command(commands, "export", "write the trials as TSV, Parquet or a BIDS folder")
    export.add_argument("folder", metavar="FOLDER", help="the study's data")
    export.add_argument("--tsv", type=Output("table", (".tsv", ".txt")), metavar="FILE.tsv", help="a table of text")
    export.add_argument(
        "--parquet", type=Output("table", (".parquet",)), metavar="FILE.parquet", help="a table for pandas and R"
    )
    export.add_argument("--bids", type=output_folder, metavar="FOLDER", help="a folder in the form of BIDS")


def _numbers(text: str) -> tuple[int, ...]:
    """Return the numbers of ``8..40``, ``8..40:4`` or ``8,12``."""
    try:
        if ".." in text:
            ends, _, step = text.partition(":")
            low, high = (int(end) for end in ends.split(".."))
            every = int(step) if step else max(1, (high - low) // 4)
            found = tuple(range(low, high + 1, every))
        else:
            found = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not like 8..40, 8..40:4 or 8,12,20") from None
    if not found or min(found) < 1 or max(found) > 10_000:
        raise argparse.ArgumentTypeError(f"'{text}' must hold numbers from 1 to 10000")
    return found


def power(file: StudyFile, options: argparse.Namespace) -> int:
    """Print intervals and power of equivalence, a line for each size of the panel."""
    from dataclasses import asdict

    from itouch.plugin.discovery import Catalog
    from itouch_tools.study.observer_catalog import observer_of
    from itouch_tools.study.power import library, touch_runner
    from itouch_tools.study.power import power as powers

    if options.studies < 1:
        print("--studies must be 1 or more", file=sys.stderr)
        return 2
    observer_of(options.model)
    with waiting("power of equivalence") as wait:
        felt = library(file, touch_runner(file, Catalog()), told=wait.part)
        wait.part(None, "drawing panels")
        found = powers(
            file, felt, options.panel, model=options.model, repetitions=options.repetitions, studies=options.studies,
            seed=options.seed,
        )  # fmt: skip
    print("panel  repetitions  right  95 % interval  power of equivalence (margin 10 %)")
    for one in found:
        equal = ", ".join(f"{name}: {100.0 * value:.0f} %" for name, value in one.equivalence.items()) or "-"
        half = f"+-{100.0 * one.half_width:.1f} %"
        print(f"{one.panel:5d}  {one.repetitions:11d}  {100.0 * one.proportion:4.0f} %  {half:>13s}  {equal}")
    if options.json:
        write_output(options.json, json.dumps([asdict(one) for one in found], indent=1) + "\n")
    return 0


def audit(file: StudyFile, options: argparse.Namespace) -> int:
    """Print how often the condition was guessed; return 1 if the study is not shown to be blind."""
    from itouch.plugin.discovery import Catalog
    from itouch_tools.study.audit import judged, observe, without_blind

    if options.trials < 20 or file.study.staircases:
        print("an audit has 20 trials or more, of a study with conditions", file=sys.stderr)
        return 2
    tried = without_blind(file) if options.without else file

    with waiting("auditing") as wait:

        def told(count: int) -> None:
            wait.part(count / options.trials, f"{count} of {options.trials} trials")

        labels, table = observe(tried, Catalog(), options.trials, seed=options.seed, told=told)
        wait.part(None, "guessing the conditions")
        guesses = judged(labels, table, seed=options.seed)
    for one in guesses:
        words = "blind" if one.blind else "LEAKS" if one.leaks else "not shown to be blind"
        print(
            f"{one.features:7s} {100.0 * one.accuracy:5.1f} % [{100.0 * one.low:.1f}, {100.0 * one.high:.1f}] of "
            f"{one.trials} guessed, chance {100.0 * one.chance:.1f} %: {words}"
        )
    return 0 if guesses[0].blind else 1


def coverage(options: argparse.Namespace) -> int:
    """Print a line for each promise of the statistics; return 1 if one was not kept."""
    from itouch_tools.study.coverage import campaign

    if options.studies < 10 or options.null < 40:
        print("--studies must be 10 or more, --null 40 or more", file=sys.stderr)
        return 2
    broken = 0
    with waiting("checking the statistics"):
        for one in campaign(options.studies, options.null):
            low, high = one.promised
            broken += not one.kept
            print(
                f"{one.what}, {one.participants} participants, {one.studies} studies: {100.0 * one.share:.1f} % "
                f"[{100.0 * one.low:.1f}, {100.0 * one.high:.1f}], promised {100.0 * low:.0f} to {100.0 * high:.0f} %"
                f"{'' if one.kept else '  NOT KEPT'}", flush=True,
            )  # fmt: skip
    return 1 if broken else 0


def export(options: argparse.Namespace) -> int:
    """Write the trials in the formats that are asked for.

    Raises
    ------
    ItouchError
        If there are no trials, or a file can't be read or written.
    """
    from itouch.schema import ItouchError
    from itouch_tools.study.exports import write_bids, write_parquet
    from itouch_tools.study.study_store import Store
    from itouch_tools.study.trial_table import write_table

    if not (options.tsv or options.parquet or options.bids):
        print("say where to: --tsv FILE, --parquet FILE or --bids FOLDER", file=sys.stderr)
        return 2
    with Store.open(Path(options.folder)) as store:
        rows, frozen = store.rows(), store.frozen() or {}
    if not rows:
        raise ItouchError(f"'{options.folder}' holds no trials yet")
    try:
        if options.tsv:
            write_table(rows, Path(options.tsv))
        if options.parquet:
            write_parquet(rows, Path(options.parquet))
        if options.bids:
            write_bids(rows, Path(options.bids), name=str(frozen.get("name", "study")))
    except OSError as error:
        raise ItouchError(f"cannot write '{error.filename}': {error.strerror}") from error
    print(f"wrote {', '.join(name for name in (options.tsv, options.parquet, options.bids) if name)}")
    return 0
