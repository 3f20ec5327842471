"""``itouch-py view``: open a window on a running session; closing it does not end the session.

``--web`` shows the session in browsers, ``--rerun`` in Rerun, which opens recordings, too; ``--ros2`` publishes it to
ROS 2.
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from itouch.schema import ItouchError
from itouch.schema.regular_files import stored_kind
from itouch_tools.cli.arguments import Parser

#: The default port for browsers, if nothing else listens there.
PORT = 8080


def main(argv: Sequence[str]) -> int:
    """Open a window on a running session."""
    parser = Parser(prog="itouch-py view", description=main.__doc__)
    parser.add_argument("session", nargs="?", metavar="NAME|FILE.mcap",
                        help="name or process id; not needed if only one runs; with --rerun a recording")  # fmt: skip
    parser.add_argument("--rerun", action="store_true", help="open Rerun on it, or on a recording (extra [rerun])")
    parser.add_argument("--to", metavar="ADDRESS",
                        help="with --rerun: a running Rerun, such as rerun+http://127.0.0.1:9876/proxy")  # fmt: skip
    parser.add_argument("--ros2", action="store_true",
                        help="publish it as topics of ROS 2, by Zenoh and without ROS (extra [ros2])")  # fmt: skip
    parser.add_argument("--router", metavar="HOST[:PORT]", help="with --ros2: a Zenoh router (default localhost:7447)")
    parser.add_argument("--domain", type=int, metavar="N", help="with --ros2: ROS_DOMAIN_ID (default: as set, or 0)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="with --ros2: messages a second (default 100)")
    parser.add_argument("--web", action="store_true",
                        help="serve browsers on this machine, for viewing only (extra [web])")  # fmt: skip
    parser.add_argument(
        "--port", type=int, metavar="N", help="with --web: the port (default 8080, or any that is free)"
    )
    parser.add_argument("--host", metavar="ADDRESS",
                        help="with --web: let other machines view, at this address; needs --token")  # fmt: skip
    parser.add_argument("--token", metavar="TEXT", help="with --web: what a browser must show, at least 16 characters")
    parser.add_argument("--list", action="store_true", help="list the sessions that run, and open nothing")
    parser.add_argument("--mute", action="store_true", help="without sound")
    options = parser.parse_args(argv)
    _check(options)
    if options.ros2:
        from itouch_tools.cli.bridges import ros2

        return ros2(options)
    if options.rerun and stored_kind(options.session or "") != "recording":
        from itouch_tools.cli.bridges import rerun

        return rerun(options)
    if options.rerun:
        return _rerun(options.session)
    if options.web:
        return _web(options)
    from itouch.servo import attach, sessions

    if options.list:
        running = list(sessions())
        if not running:
            print("no session is running", file=sys.stderr)
        for info in running:
            print(f"{info.name:<24} {info.pid:>8}  {info.phase:<9} {info.scene}")
        return 0
    with attach(options.session) as link:
        from itouch_tools.viewer.offscreen import has_display, open_window

        if not has_display():
            raise ItouchError("there is no display; `itouch-py run SCENE --film FILE.mp4` needs none")
        window = open_window(link, time.perf_counter, mute=options.mute)
        print(f"attached to '{link.name}'; closing the window does not end it", file=sys.stderr)
        window.show(while_=lambda: link.alive)
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together."""
    ways = [f"--{way}" for way in ("web", "rerun", "ros2") if getattr(options, way)]
    if len(ways) > 1:
        raise ItouchError(
            f"{' and '.join(ways)}: choose one; a session can have several views, each by a command of its own"
        )
    if not options.web and (options.port is not None or options.host or options.token is not None):
        raise ItouchError("--port, --host and --token say how browsers look; they go with --web")
    if not options.ros2 and (options.router or options.domain is not None or options.rate is not None):
        raise ItouchError("--router, --domain and --rate say how to publish to ROS 2; they go with --ros2")
    if options.to and not options.rerun:
        raise ItouchError("--to says which Rerun viewer to send to; it goes with --rerun")


def _web(options: argparse.Namespace) -> int:
    """Show a running session to browsers until it ends."""
    from itouch.schema.extras import need
    from itouch.servo import attach

    need("web", "--web")
    host, token = options.host or "127.0.0.1", options.token or ""
    if options.port is not None and not 0 <= options.port <= 65535:
        raise ItouchError(f"--port {options.port}: a port is 0 to 65535; 0 takes any that is free")
    if options.token is not None and (len(token) < 16 or not all(c.isalnum() or c in "-_" for c in token)):
        raise ItouchError("--token is 16 letters, digits, '-' or '_' or more, so that nobody guesses it")
    if options.host and not token:
        raise ItouchError(f"--host {host} lets other machines look; say with --token TEXT what they must show")
    from itouch_tools.viewer.web import Access, show

    port = options.port if options.port is not None else _free(host)
    with attach(options.session) as link:

        def told(address: str) -> None:
            print(f"attached to '{link.name}'; Ctrl-C ends the view and not the session", file=sys.stderr)
            print(address, flush=True)

        def looks(count: int) -> None:
            print(f"a browser looks ({count} in all)", file=sys.stderr, flush=True)

        with contextlib.suppress(KeyboardInterrupt):
            show(link, Access(host, port, token), told, looks)
    return 0


def _free(host: str) -> int:
    """Return the default port, or 0 for any free one if something else listens there."""
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    with contextlib.suppress(OSError), socket.socket(kind) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host.strip("[]"), PORT))
        return PORT
    return 0


def _rerun(file: str) -> int:
    """Show a recording in Rerun's window until the window is closed; return Rerun's exit code."""
    from itouch.recording import read
    from itouch.schema.extras import need
    from itouch.schema.wait_notices import waiting
    from itouch_tools.export.rerun_viewer import export_rrd
    from itouch_tools.viewer.offscreen import has_display

    need("rerun", "--rerun")
    if not has_display():
        raise ItouchError(f"there is no display; `itouch-py export {file} --rrd FILE.rrd` needs none")
    with tempfile.TemporaryDirectory() as folder:
        with waiting(f"reading {file}"):
            written = export_rrd(read(file), str(Path(folder, Path(file).stem + ".rrd")))
        return subprocess.run([sys.executable, "-m", "rerun", *written], check=False).returncode
