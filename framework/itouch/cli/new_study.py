"""``itouch-py new-study NAME``: a study to start from, with its scene."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence


def main(argv: Sequence[str]) -> int:
    """Write a folder NAME with NAME.xml, its scene and what the participant reads."""
    parser = argparse.ArgumentParser(prog="itouch-py new-study", description=main.__doc__)
    parser.add_argument("name", metavar="NAME", help="small letters, digits, dashes: three-materials")
    parser.add_argument("--folder", default=".", metavar="FOLDER", help="where to put it (default: here)")
    options = parser.parse_args(argv)
    from itouch.scaffold.study import make_study

    make_study(options.name, folder=options.folder)
    home = os.path.join(options.folder, options.name)
    print(f"wrote {home}; now:\n  cd {home}\n  itouch-py study check {options.name}.xml")
    return 0
