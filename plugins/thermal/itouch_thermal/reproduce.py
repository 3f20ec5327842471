"""``itouch-py reproduce``: the paper's figures and claims from code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from itouch.plugin import need, waiting


def main(argv: Sequence[str]) -> int:
    """Draw the paper's figures and check its claims."""
    parser = argparse.ArgumentParser(prog="itouch-py reproduce", description=__doc__)
    parser.add_argument("-o", "--out", default="reproduced", metavar="DIR", help="where to write; default: reproduced")
    options = parser.parse_args(list(argv))
    need("plot", "reproduce")
    need("bench", "reproduce")
    from itouch_thermal.rendering.claims import page
    from itouch_thermal.rendering.figures import draw

    out = Path(options.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with waiting("drawing figures and checking claims"):
            text = page(draw(out))
        (out / "claims.md").write_text(text, encoding="utf-8")
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"wrote {out}/claims.md and 9 figures")
    return 0
