"""``itouch-py bench identify``: how often the intervals of `identify` hold the truth, on random fingers' twins."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.plugin import waiting
from itouch.plugin.commands import command_parser, exit_code, output_file
from itouch_thermal.atomic_write import write_whole

if TYPE_CHECKING:
    from itouch_thermal.identify.coverage import Row


def main(argv: Sequence[str]) -> int:
    """Print coverage, error and Cramer-Rao bound of each value; 1 if intervals hold too little or too much."""
    from itouch_thermal.identify.coverage import LEAST, MOST

    options = _parser().parse_args(list(argv))
    if options.fingers < 1 or options.seed < 0:
        print("error: --fingers must be 1 or more, --seed 0 or more", file=sys.stderr)
        return 2
    try:
        rows = _rows(options)
        if options.json is not None:
            write_whole(Path(options.json), json.dumps(document(options, rows), indent=1) + "\n")
    except ValueError as error:  # of a material's name
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: '{error.filename}': {error.strerror}\n  = help: check the path", file=sys.stderr)
        return 2
    print(table(rows))
    missed = [row.name for row in rows if not row.holds]
    of = f"{100 * LEAST:.0f} to {100 * MOST:.0f} % must hold the truth"
    print(f"{options.fingers} fingers, {of}" + (f"; MISSED by {', '.join(missed)}" if missed else ""))
    return exit_code(row.holds for row in rows)


def _rows(options: argparse.Namespace) -> list[Row]:
    from itouch_thermal.identify.coverage import campaign

    with waiting("estimating") as wait:
        return campaign(
            options.fingers, options.seed, options.sample, other=options.other,
            each=lambda done: wait.part(done / options.fingers, f"{done} of {options.fingers} fingers"),
        )  # fmt: skip


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("itouch-py bench identify", main.__doc__)
    parser.add_argument(
        "--fingers", type=int, default=100, metavar="N", help="number of fingers (100; a third of a second each)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of fingers and noise (0)")
    parser.add_argument("--sample", default="", metavar="MATERIAL", help="what they touch; default: it is looked for")
    parser.add_argument("--other", action="store_true",
                        help="data of a finite-difference model with Laplace's noise")  # fmt: skip
    parser.add_argument("--json", type=output_file(), metavar="FILE", help="write the rows to this file too")
    return parser


def table(rows: Sequence[Row]) -> str:
    """Return a line for each value; errors and bounds are relative to the width of the prior."""
    lines = [f"{'value':<12}{'95 % hold':>11}{'rms error':>11}{'bound':>9}{'of it':>8}{'told':>8}"]
    for row in rows:
        lines.append(
            f"{row.name:<12}{100 * row.coverage:>9.1f} %{row.error:>11.4f}{row.bound:>9.4f}"
            f"{row.error / row.bound:>8.2f}{100 * row.told:>6.0f} %"
        )
    return "\n".join(lines)


def document(options: argparse.Namespace, rows: Sequence[Row]) -> dict[str, object]:
    """Return a campaign's results as a JSON document."""
    return {
        "fingers": options.fingers, "seed": options.seed, "sample": options.sample or None,
        "data": "finite differences, Laplace's noise" if options.other else "closed form, normal noise",
        "values": {
            row.name: {
                "coverage": row.coverage, "error": row.error, "cramer_rao": row.bound, "told": row.told,
                "holds": row.holds,
            }
            for row in rows
        },
    }  # fmt: skip
