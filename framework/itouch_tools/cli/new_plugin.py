"""``itouch-py new-plugin NAME``: a complete distribution to begin a plugin with."""

from __future__ import annotations

import os
from collections.abc import Sequence

from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_folder


def main(argv: Sequence[str]) -> int:
    """Write the distribution itouch-NAME with numbered steps; its tests say which step is next."""
    from itouch_tools.scaffold.plugin_distribution import KINDS, TRANSPORTS, make_plugin

    parser = Parser(prog="itouch-py new-plugin", description=main.__doc__)
    parser.add_argument("name", metavar="NAME", help="small letters, digits, dashes: force-lever")
    parser.add_argument("--kind", choices=KINDS, default="device")
    parser.add_argument("--transport", choices=TRANSPORTS, default="none", help="what the device is connected by")
    parser.add_argument(
        "-o", "--folder", type=output_folder, default=".", metavar="FOLDER", help="where to put it (default: here)"
    )
    options = parser.parse_args(argv)
    written = make_plugin(options.name, kind=options.kind, transport=options.transport, folder=options.folder)
    home = os.path.join(options.folder, f"itouch-{options.name}")
    print(f"wrote {len(written)} files to {home}; now:\n  cd {home}\n  pip install -e '.[test]' && pytest")
    return 0
