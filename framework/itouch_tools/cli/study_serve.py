"""``itouch-py study serve``: let another program lead the touch, through the study's server."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from itouch_tools.cli.arguments import add_command
from itouch_tools.cli.output_files import output_file
from itouch_tools.cli.shutdown import Interrupted, Stopping

if TYPE_CHECKING:
    from itouch_tools.study.reading import StudyFile


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    serve = add_command(commands, "serve", "let another program lead: PsychoPy, a notebook, Matlab over a socket")
    serve.add_argument("study", metavar="STUDY.xml", help="the study")
    serve.add_argument(
        "--key",
        type=output_file,
        metavar="FILE",
        help="where address and key are written; default: NAME.key.json beside",
    )
    serve.add_argument("--port", type=int, default=0, metavar="N", help="TCP port on this machine; default: a free one")
    pace = "fast: time goes on only while the program waits for something (default: real)"
    serve.add_argument("--pace", choices=("real", "fast"), default="real", help=pace)
    serve.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the twins' noise (default: 0)")


def serve(file: StudyFile, options: argparse.Namespace) -> int:
    """Serve until a program says ``stop`` or a signal comes.

    Raises
    ------
    ItouchError
        If the server can't be opened, or the scene can't be presented.
    """
    from itouch.loop import DeviceFaultError, VirtualClock
    from itouch.loop.clock import WallClock
    from itouch.plugin.discovery import Catalog
    from itouch.schema import ItouchError
    from itouch.schema.terminal import did
    from itouch_tools.cli import study_rig
    from itouch_tools.study.external_control import Served
    from itouch_tools.study.server import StudyServer

    if not 0 <= options.port < 1 << 16 or not 0 <= options.seed < 1 << 63:
        raise ItouchError("--port must be 0 to 65535, --seed 0 to 2^63 - 1")
    path = Path(options.study)
    key = Path(options.key) if options.key else path.with_name(f"{path.stem}.key.json")
    if study_rig.needed(file):
        return study_rig.serve(file, key, options)
    clock = WallClock() if options.pace == "real" else VirtualClock()
    with Stopping() as stop:
        try:
            served = Served(file, Catalog(), StudyServer(key, options.port), clock=clock, seed=options.seed)
            with served.server as server:
                stop.bind(served.end)
                print(f"'{file.name}' is served on port {server.port} of this machine; the key is in {key}", flush=True)
                served.run()
        except Interrupted as signalled:
            return signalled.code
        except DeviceFaultError as error:
            print(f"{error}", flush=True)
            return 1
    did("the served study has ended")
    return stop.code(0)
