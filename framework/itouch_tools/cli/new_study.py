"""``itouch-py new-study NAME``: a study to start from, with its scene."""

from __future__ import annotations

import os
from collections.abc import Sequence

from itouch_tools.cli.arguments import parser_of
from itouch_tools.cli.output_files import output_folder


def main(argv: Sequence[str]) -> int:
    """Write a folder NAME with NAME.xml, its scene and what the participant reads."""
    parser = parser_of("itouch-py new-study", main.__doc__)
    parser.add_argument("name", metavar="NAME", help="small letters, digits, dashes: three-materials")
    parser.add_argument(
        "-o", "--folder", type=output_folder, default=".", metavar="FOLDER", help="where to put it (default: here)"
    )
    options = parser.parse_args(argv)
    from itouch_tools.scaffold.files import make_study

    make_study(options.name, folder=options.folder)
    home = os.path.join(options.folder, options.name)
    print(f"wrote {home}; now:\n  cd {home}\n  itouch-py study check {options.name}.xml")
    return 0
