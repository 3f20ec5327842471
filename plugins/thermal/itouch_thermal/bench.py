"""``itouch-py bench thermal``: accuracy and speed of every contact solver, side by side with the installed peers."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.plugin.commands import command_parser, output_file
from itouch_thermal.atomic_write import write_whole

if TYPE_CHECKING:
    from contact_heat.contact import Contact
    from contact_heat.measure import Row


def main(argv: Sequence[str]) -> int:
    """Measure accuracy and speed of the contact solvers; returns the exit code."""
    options = _parser().parse_args(list(argv))
    try:
        rows = list(_printed(options))
    except OSError as error:
        print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if options.json is not None:
        write_whole(Path(options.json), json.dumps([row.as_dict() for row in rows], indent=1) + "\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "itouch-py bench thermal",
        "Measure accuracy and speed of every contact solver, side by side with the installed peers.",
    )
    parser.add_argument("--case", metavar="FILE.json", help="measure on this case in place of the stated ones")
    parser.add_argument("--json", type=output_file(), metavar="FILE", help="write the rows to this file too")
    parser.add_argument("--no-peers", action="store_true", help="leave SciPy out")
    parser.add_argument("--no-batch", action="store_true", help="leave the batches out")
    return parser


def _printed(options: argparse.Namespace) -> Iterator[Row]:
    peers = not options.no_peers and find_spec("scipy") is not None
    print(f"{'case':<22}{'method':<34}{'error 10 us..':>14}{'error 1 ms..':>14}{'cost':>12} unit")
    for row in _rows(options, peers=peers):
        print(_line(row), flush=True)
        yield row
    if not peers:
        print("scipy is left out or not installed: pip install 'itouch-py[bench]'")


def _rows(options: argparse.Namespace, *, peers: bool) -> Iterator[Row]:
    from contact_heat import measure
    from contact_heat.published_cases import many_layers, published_cases

    cases = _cases(options.case)
    for name, contact in cases.items():
        yield from measure.case_rows(name, contact, peers=peers)
    if options.case is None:
        yield from measure.order_rows(*next(iter(published_cases().items())))
        yield measure.build_row("many layers", many_layers())
    if not options.no_batch:
        yield from measure.batch_rows(next(iter(cases.values())))


def _cases(path: str | None) -> dict[str, Contact]:
    """Return the stated cases: the finger in air at 23 degC that touches 20 mm blocks."""
    from contact_heat.contact import Contact
    from contact_heat.published_cases import published_cases

    return published_cases() if path is None else {Path(path).stem: Contact.from_json(path)}


def _line(row: Row) -> str:
    errors = "".join(f"{'' if error is None else f'{error:.1e}':>14}" for error in (row.error_10us, row.error_1ms))
    cost = "" if row.cost is None else f"{row.cost:.4g}"
    return f"{row.case:<22}{row.method:<34}{errors}{cost:>12} {row.unit:<21}{row.note}".rstrip()
