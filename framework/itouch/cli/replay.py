"""``itouch-py replay FILE.mcap``: recorded readings in, every command compared."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence


def main(argv: Sequence[str]) -> int:
    """Feed a recording to the engine and compare every command; exit code 1 if one differs."""
    parser = argparse.ArgumentParser(prog="itouch-py replay", description=main.__doc__)
    parser.add_argument("recording", metavar="FILE.mcap", help="a recording")
    options = parser.parse_args(argv)
    from itouch.recording import read
    from itouch.session.replay import replay

    recording = read(options.recording)
    for loss in recording.losses:
        print(f"note: {loss}", file=sys.stderr)
    begin = time.perf_counter()
    outcome = replay(recording)
    spent = time.perf_counter() - begin
    if outcome.skipped:
        print(f"note: {outcome.skipped} ticks after gaps could not be replayed", file=sys.stderr)
    seconds = outcome.ticks * recording.period
    print(f"{options.recording}: {outcome.ticks} ticks ({seconds:.3f} s) replayed in {spent:.1f} s, "
          f"{outcome.compared} commands compared, {outcome.mismatches} mismatches")  # fmt: skip
    if outcome.first is not None:
        print(f"first difference: {outcome.first}")
    return 1 if outcome.mismatches or not outcome.ticks else 0
