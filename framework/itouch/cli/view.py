"""``itouch-py view``: open a window on a session that runs; closing it does not end the session.

``--rerun`` opens Rerun's window on a recording.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from itouch.cli.arguments import Parser
from itouch.schema import ItouchError


def main(argv: Sequence[str]) -> int:
    """Open a window on a running session."""
    parser = Parser(prog="itouch-py view", description=main.__doc__)
    parser.add_argument("session", nargs="?", metavar="NAME|FILE.mcap",
                        help="name or process id; not needed if only one runs; with --rerun a recording")  # fmt: skip
    parser.add_argument("--rerun", action="store_true", help="open Rerun on a recording (extra [rerun])")
    parser.add_argument("--list", action="store_true", help="list the sessions that run, and open nothing")
    parser.add_argument("--mute", action="store_true", help="without sound")
    options = parser.parse_args(argv)
    if options.rerun:
        return _rerun(options.session or "")
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


def _rerun(file: str) -> int:
    """Show a recording in Rerun's window until that is closed."""
    from itouch.recording import read
    from itouch.recording.rerun import export_rrd
    from itouch.schema.extras import need
    from itouch.schema.waits import waiting
    from itouch.viewer.offscreen import has_display

    if not file.endswith(".mcap"):
        raise ItouchError("--rerun shows a recording (.mcap); a session that runs is shown without --rerun")
    need("rerun", "--rerun")
    if not has_display():
        raise ItouchError(f"there is no display; `itouch-py export {file} --rrd FILE.rrd` needs none")
    with tempfile.TemporaryDirectory() as folder:
        with waiting(f"reading {file}"):
            written = export_rrd(read(file), str(Path(folder, Path(file).stem + ".rrd")))
        return subprocess.run([sys.executable, "-m", "rerun", *written], check=False).returncode
