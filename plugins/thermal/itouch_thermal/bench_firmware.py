"""``itouch-py bench firmware``: the reference display's program in a simulated chip: its figures, and random faults."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from itouch.plugin import ItouchError
from itouch.plugin.commands import command_parser, exit_code, output_file
from itouch_thermal.atomic_write import write_whole

#: Number of faults in the long form, and in the short one.
LONG, SHORT = 1000, 36


def main(argv: Sequence[str]) -> int:
    """Print size, speed and accuracy, then what random faults did to the plate; 1 if anything passed its bound."""
    parser = command_parser("itouch-py bench firmware", main.__doc__)
    parser.add_argument("--faults", type=int, default=SHORT, metavar="N", help=f"how many (default {SHORT})")
    parser.add_argument(
        "--long", action="store_const", const=LONG, dest="faults", help=f"{LONG} faults: some 20 minutes"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the first fault (default 1)")
    parser.add_argument("--no-figures", action="store_true", help="faults only")
    parser.add_argument("--all", action="store_true", help="print every fault, not only the sums and what is wrong")
    parser.add_argument("--json", type=output_file(), metavar="FILE", help="write figures and faults to this file too")
    options = parser.parse_args(list(argv))
    if options.faults < 0:
        parser.error("--faults must not be negative")
    try:
        shown = [] if options.no_figures else list(_figures())
        faults = list(_faults(options.faults, options.seed, every=options.all))
        if options.json is not None:
            text = json.dumps({"figures": shown, "faults": faults}, indent=1)
            write_whole(Path(options.json), text + "\n")
    except BrokenPipeError:
        raise
    except OSError as error:
        print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except ItouchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return exit_code([*(row["holds"] for row in shown), *(row["safe"] for row in faults)])


def _figures() -> Iterator[dict[str, Any]]:
    from itouch_thermal.chip.figures_of_merit import figures

    for figure in figures():
        bound = "" if figure.most is None else f"at most {figure.most:g}" + ("" if figure.holds else "  MISSED")
        print(f"{figure.name:<40}{figure.value:>12.4g} {figure.unit:<12} {bound}", flush=True)
        yield {**figure._asdict(), "holds": figure.holds}


def _faults(count: int, seed: int, *, every: bool) -> Iterator[dict[str, Any]]:
    from itouch_thermal.chip.faults import PLATE, campaign, run_fault

    if not count:
        return
    lowest, highest, kinds, wrong, begin = 1e3, -1e3, Counter[str](), 0, time.perf_counter()
    for name, number in campaign(count, seed):
        found = run_fault(name, number)
        kinds[found.state] += 1
        lowest, highest, wrong = min(lowest, found.lowest), max(highest, found.highest), wrong + (not found.safe)
        if every or not found.safe:
            ends = f"{found.lowest:6.2f} to {found.highest:5.2f} degC"
            print(f"{'ok   ' if found.safe else 'WRONG'} {name:<36}seed {number:<6}{ends}  {found.state}", flush=True)
        yield {
            "name": name, "seed": number, "lowest_C": found.lowest, "highest_C": found.highest,
            "state": found.state, "resets": found.resets, "safe": found.safe,
        }  # fmt: skip
    print(f"{count} faults, {wrong} wrong: the true plate was at {lowest:.2f} to {highest:.2f} degC, "
          f"soak included (allowed: {PLATE[0]:g} to {PLATE[1]:g}), in {time.perf_counter() - begin:.0f} s")  # fmt: skip
    print("states at the end: " + ", ".join(f"{state} {number}" for state, number in kinds.most_common()))
