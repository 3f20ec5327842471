"""``itouch-py view``: open a window on a session that runs; closing it does not end the session."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from itouch.cli.arguments import Parser
from itouch.schema import ItouchError


def main(argv: Sequence[str]) -> int:
    """Open a window on a running session."""
    parser = Parser(prog="itouch-py view", description=__doc__)
    parser.add_argument("session", nargs="?", metavar="NAME", help="name or process id; not needed if only one runs")
    parser.add_argument("--list", action="store_true", help="list the sessions that run, and open nothing")
    parser.add_argument("--mute", action="store_true", help="without sound")
    options = parser.parse_args(argv)
    from itouch.servo import attach, sessions

    if options.list:
        for info in sessions():
            print(f"{info.name:<24} {info.pid:>8}  {info.phase:<9} {info.scene}")
        return 0
    with attach(options.session) as link:
        from itouch.viewer.offscreen import has_display, open_window

        if not has_display():
            raise ItouchError("there is no display; `itouch-py run SCENE --film FILE.mp4` needs none")
        window = open_window(link, time.perf_counter, mute=options.mute)
        print(f"attached to '{link.name}'; closing the window does not end it", file=sys.stderr)
        window.show(while_=lambda: link.alive)
    return 0
