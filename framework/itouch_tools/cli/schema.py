"""``itouch-py schema FOLDER``: the scene language as XML Schema, for completion and hover in editors."""

from __future__ import annotations

import os
from collections.abc import Sequence

from itouch.schema import ItouchError
from itouch.schema.terminal import did
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_folder


def main(argv: Sequence[str]) -> int:
    """Write itouch.xsd, one document for each installed plugin, and sweep.xsd for sweeps."""
    parser = Parser(prog="itouch-py schema", description=main.__doc__)
    parser.add_argument("folder", type=output_folder, metavar="FOLDER", help="made if it is missing")
    options = parser.parse_args(argv)
    for path in write_schemas(options.folder):
        did(f"wrote {path}")
    return 0


def write_schemas(folder: str) -> list[str]:
    """Write the schemas into a folder and return their paths.

    Raises
    ------
    ItouchError
        If they can't be written.
    """
    from itouch.plugin.discovery import Catalog
    from itouch_tools.authoring.xsd import schemas, standalone
    from itouch_tools.sweeps.sweep_elements import Sweep

    written = []
    try:
        os.makedirs(folder, exist_ok=True)
        for name, text in {**schemas(Catalog()), "sweep.xsd": standalone(Sweep)}.items():
            path = os.path.join(folder, name)
            with open(path, "w", encoding="utf-8") as stream:
                stream.write(text)
            written.append(path)
    except OSError as error:
        raise ItouchError(f"cannot write to '{folder}': {error.strerror or error}") from error
    return written
