"""``itouch-py report SESSION -o FILE.html``: a page about a session, to look at and to send."""

from __future__ import annotations

import os
from collections.abc import Sequence

from itouch.schema.extras import need
from itouch.schema.terminal import did
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output


def main(argv: Sequence[str]) -> int:
    """Write one self-contained page of a recording (.mcap) or a snapshot (.itouch)."""
    parser = Parser(prog="itouch-py report", description=main.__doc__)
    parser.add_argument("session", metavar="SESSION.mcap|.itouch", help="a recording or a snapshot")
    parser.add_argument("-o", "--output", type=output_file, required=True, metavar="FILE.html", help="the page")
    options = parser.parse_args(argv)
    given = options.session
    need("report", "the page")
    from itouch_tools.report.collect import collect
    from itouch_tools.report.session_page import page, scene_picture

    with waiting(f"reading {given}") as wait:
        findings = collect(given, progress=wait.part)
        wait.part(None, "drawing the page")
        text = page(findings, picture=scene_picture(findings))
    write_output(options.output, text)
    size, many = os.path.getsize(options.output) / 1e6, len(findings.contacts)
    did(f"wrote {options.output}: {findings.kind}, {many} contact{'' if many == 1 else 's'}, {size:.1f} MB")
    return 0
