"""``itouch-py bench NAME``: measurements of the framework and of plugins."""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence

from itouch.plugin.discovery import BENCHES, Found, find
from itouch.schema.diagnostics import did_you_mean
from itouch_tools.cli.command_options import in_columns
from itouch_tools.cli.progress import measured
from itouch_tools.cli.synopsis import source_of


def main(argv: Sequence[str]) -> int:
    """Measure accuracy and speed."""
    found = find(BENCHES)
    if not argv or argv[0] in ("-h", "--help"):
        names = in_columns({name: _measures(entry) for name, entry in found.items()})
        print(f"usage: itouch-py bench NAME [options]\n\nbenches (each has --help):\n{names}")
        return 0 if argv else 2
    if argv[0] not in found:
        advice = did_you_mean(argv[0], found, "benches are")
        print(f"error: there is no bench named '{argv[0]}'\n  = help: {advice}", file=sys.stderr)
        return 2
    if {"-h", "--help"} & set(argv[1:]):
        return int(found[argv[0]].load()(list(argv[1:])))
    with measured(f"bench {argv[0]}"):  # and nothing in the bench: one style, and no work beside what it measures
        return int(found[argv[0]].load()(list(argv[1:])))


def _measures(entry: Found) -> str:
    """Return what a bench measures: the first line of its module's docstring, read without importing anything.

    For a bench without one, or that is not found, return the name of the distribution that brings it.
    """
    try:
        source = source_of(entry.entry.module)
        told = ast.get_docstring(ast.parse(source.read_bytes())) if source is not None else None
    except (OSError, SyntaxError, ValueError, ImportError):
        told = None
    return (told or "").partition("\n")[0].removeprefix(f"``itouch-py bench {entry.name}``: ") or entry.distribution
