"""``itouch-py bench NAME``: measurements of the framework and of plugins."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from itouch.plugin.discovery import BENCHES, find
from itouch.schema.diagnostics import did_you_mean


def main(argv: Sequence[str]) -> int:
    """Measure accuracy and speed."""
    found = find(BENCHES)
    if not argv or argv[0] in ("-h", "--help"):
        names = "\n".join(f"  {name:<12} {entry.distribution}" for name, entry in found.items())
        print(f"usage: itouch-py bench NAME [options]\n\nbenches:\n{names}")
        return 0 if argv else 2
    if argv[0] not in found:
        advice = did_you_mean(argv[0], found, "benches are")
        print(f"error: there is no bench named '{argv[0]}'\n  = help: {advice}", file=sys.stderr)
        return 2
    return int(found[argv[0]].load()(list(argv[1:])))
