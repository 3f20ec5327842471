"""``itouch-py new-scene NAME``: a scene to start from, and the schema for completion in editors."""

from __future__ import annotations

import os
from collections.abc import Sequence

from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_folder


def main(argv: Sequence[str]) -> int:
    """Write a folder NAME with NAME.xml and the schema for editors."""
    parser = Parser(prog="itouch-py new-scene", description=main.__doc__)
    parser.add_argument("name", metavar="NAME", help="small letters, digits, dashes: my-blocks")
    parser.add_argument(
        "-o", "--folder", type=output_folder, default=".", metavar="FOLDER", help="where to put it (default: here)"
    )
    options = parser.parse_args(argv)
    from itouch.plugin.discovery import Catalog
    from itouch_tools.authoring.xsd import schemas
    from itouch_tools.scaffold.files import make_scene

    make_scene(options.name, schemas(Catalog()), folder=options.folder)
    home = os.path.join(options.folder, options.name)
    print(f"wrote {home}; now:\n  cd {home}\n  itouch-py {options.name}.xml")
    return 0
