"""``itouch-py bench spread``: by how much one dimension, and the display's twin, are off under a small finger."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from itouch.plugin.commands import command_parser, output_file
from itouch_thermal.atomic_write import write_whole

#: Contact areas [cm2], times [s], and the sizes of error whose times of first occurrence are reported.
AREAS, TIMES, BOUNDS = (0.5, 1.1, 2.0, 4.0, 8.0, 16.0), (0.02, 0.1, 0.3, 1.0, 3.0, 10.0), (0.01, 0.03, 0.1)


def main(argv: Sequence[str]) -> int:
    """Print by how much the flux of one dimension, and of the twin, is off, and from when on by 1, 3, 10 %."""
    from contact_heat.resistance import DEFAULT_RESISTANCE
    from itouch_thermal.rendering.spread import Touched, error, passed

    parser = command_parser("itouch-py bench spread", main.__doc__)
    parser.add_argument("--area", type=float, action="append", metavar="CM2", help="contact area; may be repeated")
    add, usual = parser.add_argument, DEFAULT_RESISTANCE
    add("--resistance", type=float, default=usual, metavar="K*M2/W", help=f"of the contact ({usual:g})")
    parser.add_argument("--json", type=output_file(), metavar="FILE", help="write the rows to this file too")
    options = parser.parse_args(list(argv))
    fine, rows = np.unique(np.concatenate((np.geomspace(0.01, 10.0, 121), TIMES))), []
    print(
        f"{'cm2':>5}{'plate':>7}"
        + "".join(f"{f'{t:g} s':>9}" for t in TIMES)
        + "".join(f"{f'>{100 * b:g} %':>9}" for b in BOUNDS)
    )
    try:
        for area in options.area or AREAS:
            for plate in ("even", "twin"):
                off = error(Touched(1e-4 * area, options.resistance), fine, even=plate == "even")
                at = [float(off[np.searchsorted(fine, t)]) for t in TIMES]
                since = [passed(fine, off, bound) for bound in BOUNDS]
                cells = "".join(f"{100 * value:>+8.1f}%" for value in at)
                ends = "".join(f"{'never' if t is None else f'{t:.2g} s':>9}" for t in since)
                print(f"{area:>5g}{plate:>7}{cells}{ends}", flush=True)
                rows.append({"contact_area_cm2": area, "plate": plate, "times_s": TIMES, "error": at, "bounds": BOUNDS,
                             "since_s": since})  # fmt: skip
        if options.json is not None:
            write_whole(Path(options.json), json.dumps(rows, indent=1) + "\n")
    except ValueError as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 2
    except OSError as fault:
        print(f"error: '{fault.filename}': {fault.strerror}\n  = help: check the path", file=sys.stderr)
        return 2
    return 0
