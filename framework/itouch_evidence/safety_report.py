"""``itouch-py safety-report SCENE``: limits, trips, worst case and tests of a scene, for an ethics board."""

from __future__ import annotations

import argparse
import datetime
from collections.abc import Sequence
from importlib import metadata
from typing import TYPE_CHECKING

from itouch.schema.terminal import did, note
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

if TYPE_CHECKING:
    from itouch.scene import Scene
    from itouch_tools.report.safety import Tested


def main(argv: Sequence[str]) -> int:
    """Write limits, trips, worst case and tests of a scene, for a board; exit code 1 if a test failed or it tripped."""
    options = _parser().parse_args(argv)
    from itouch.plugin.discovery import Catalog
    from itouch.session import build, load_scene
    from itouch.world import Model
    from itouch_tools.report.safety import document, html, markdown, run

    scene = load_scene(options.scene, rig=options.rig, twin=options.twin)
    model = Model.of(scene, Catalog())
    worst, fault = None, ""
    tested: list[Tested] = []
    if not options.no_run and all(device.twin for device in model.devices.values()):
        with waiting(f"running {options.scene}") as wait:
            worst, fault = run(build(scene))
            wait.part(None, "injecting faults")
            tested = _tested(scene, every=options.all)
    elif not options.no_run:
        note("hardware in the rig: nothing is run; --twin all runs the script on the twins")
    made = datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    program = f"itouch-py {metadata.version('itouch-py')}"
    blocks = list(document(model, worst, fault, tested, made=made, program=program))
    as_html = options.output is not None and options.output.lower().endswith((".html", ".htm"))
    _write(options.output, html(blocks, f"Safety report: {options.scene}") if as_html else markdown(blocks))
    return 1 if fault or any(not one.good for one in tested) else 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="itouch-py safety-report", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE", help="a scene file")
    parser.add_argument("-o", "--output", type=output_file, metavar="FILE.md|.html",
                        help="write to this file, as Markdown or HTML; default: Markdown on the screen")  # fmt: skip
    parser.add_argument(
        "--all", action="store_true", help="inject faults in every phase of a touch, not only in contact"
    )
    parser.add_argument("--no-run", action="store_true", help="neither run the script nor inject faults")
    parser.add_argument("--rig", metavar="FILE", help="put another rig with the same device names under the scene")
    parser.add_argument("--twin", metavar="all|none|NAME", help="run these devices as simulated twins")
    return parser


def _tested(scene: Scene, *, every: bool) -> list[Tested]:
    """Inject every kind of fault into every twin, and return what followed.

    The faults come in contact, or with ``every`` in each phase of a touch; at the start if the script has no whole one.
    """
    from itouch.loop import DeviceFaultError
    from itouch_evidence.faults import phases, prepared, single
    from itouch_tools.report.safety import Tested

    if not scene.devices:
        return []
    session = prepared(scene)
    start = {"closed-open": session.state.tobytes()}
    try:
        stored = phases(session)
        chosen = stored if every else {"contact": stored["contact"]}
    except (ValueError, DeviceFaultError):  # the script has no whole contact, or trips before it has
        session, chosen = prepared(scene), start
    session.statistics.faults.clear()
    return [
        Tested(f"{device} {kind}", cell.phase, cell.trip, cell.safe_after, cell.good)
        for cell in single(session, chosen)
        for device, kind in cell.faults
    ]


def _write(path: str | None, text: str) -> None:
    if path is None:
        print(text, end="")
        return
    write_output(path, text)
    did(f"wrote {path}")
