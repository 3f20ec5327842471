"""``itouch-py bench viewer``: how long a frame takes with small and large meshes; what a viewer does to the loop."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from itouch_evidence.bumpy_sphere import bumpy_sphere
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

#: Triangles of the meshes that are drawn.
SIZES = (1_000, 100_000, 1_000_000)


def main(argv: Sequence[str]) -> int:
    """Print frame times with 1k, 100k and 1M triangles; with --servo, how punctual the loop is beside viewers."""
    parser = Parser(prog="itouch-py bench viewer", description=main.__doc__)
    parser.add_argument("--frames", type=int, default=60, metavar="N", help="frames of each size (default 60)")
    parser.add_argument("--size", default="1280x720", metavar="1280x720", help="size of the picture")
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures, too")
    beside = "instead: the servo loop beside a viewer that is there, killed, frozen, overloaded"
    parser.add_argument("--servo", action="store_true", help=beside)
    parser.add_argument("--web", action="store_true",
                        help="with --servo: a browser instead, on `itouch-py view --web`")  # fmt: skip
    parser.add_argument("--rerun", action="store_true", help="with --servo: Rerun instead, fed by `view --rerun`")
    parser.add_argument("--ros2", action="store_true", help="with --servo: a listener instead, fed by `view --ros2`")
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S",
                        help="with --servo: length of each situation in a round (default 10)")  # fmt: skip
    parser.add_argument("--rounds", type=int, default=1, metavar="N", help="with --servo: number of rounds (default 1)")
    options = parser.parse_args(argv)
    if not 0.1 <= options.seconds <= 3600 or not 1 <= options.rounds <= 1000:
        parser.error("--seconds must be 0.1 to 3600, --rounds 1 to 1000")
    ways = [way for way in ("web", "rerun", "ros2") if getattr(options, way)]
    if ways and not options.servo or len(ways) > 1:
        parser.error("--web, --rerun and --ros2 go with --servo, one at a time")
    if options.servo:
        return _beside_the_loop(options)
    from itouch_tools.viewer.offscreen import size_of

    try:
        width, height = size_of(options.size)
    except ValueError as error:
        parser.error(str(error))
    if not 3 <= options.frames <= 100_000:
        parser.error("--frames must be 3 to 100000")
    rows = [measure(count, options.frames, width, height) for count in SIZES]
    print(f"{'triangles':>10} {'p50 ms':>8} {'p99 ms':>8} {'max ms':>8} {'cpu ms':>8} {'setup ms':>9}")
    for row in rows:
        print(f"{row['triangles']:>10} {row['p50_ms']:>8.1f} {row['p99_ms']:>8.1f} {row['max_ms']:>8.1f} "
              f"{row['cpu_ms']:>8.1f} {row['setup_ms']:>9.0f}")  # fmt: skip
    _write(rows, options.json)
    return 0


def _beside_the_loop(options: argparse.Namespace) -> int:
    from itouch_evidence import viewer_servo

    if options.web:
        from itouch_evidence.viewer_web import Browsers

        rows = viewer_servo.measure(options.seconds, options.rounds, browsers=Browsers)
    elif options.rerun or options.ros2:
        from itouch_evidence.viewer_bridges import Listeners, Reruns

        other = Reruns if options.rerun else Listeners
        rows = viewer_servo.measure(options.seconds, options.rounds, browsers=other)
    else:
        rows = viewer_servo.measure(options.seconds, options.rounds)
    print(viewer_servo.table(rows))
    _write([row.figures() for row in rows], options.json)
    return 0


def _write(rows: list[dict[str, Any]], path: str | None) -> None:
    if path is None:
        return
    write_output(path, json.dumps(rows, indent=1))


def measure(triangles: int, frames: int, width: int, height: int) -> dict[str, Any]:
    """Return the frame times [ms] of a bumpy sphere of about ``triangles`` triangles, with curves and text."""
    from itouch.contact import Surface
    from itouch.contact.shapes import Mesh
    from itouch.plugin.discovery import Catalog
    from itouch.scene import loads
    from itouch.session import build
    from itouch_tools.viewer.offscreen import Offscreen

    vertices, faces = bumpy_sphere(triangles)
    session = build(loads(_SCENE.encode(), Catalog()))
    session.run(0.2)
    model = replace(session.model, shapes=(Mesh(Surface(vertices, faces)),))
    begin = time.perf_counter()
    shots = Offscreen(model, width=width, height=height)
    shots.shoot(session.state)
    setup = time.perf_counter() - begin
    spent, used = [], []
    for _ in range(frames):
        shots.picture.camera.orbit(2.0, 0.0)
        begin, before = time.perf_counter(), time.process_time()
        shots.shoot(session.state)
        spent.append(1e3 * (time.perf_counter() - begin))
        used.append(1e3 * (time.process_time() - before))
    shots.close()
    p50, p99 = np.percentile(spent, [50, 99])
    return {"triangles": len(faces), "p50_ms": float(p50), "p99_ms": float(p99), "max_ms": max(spent),
            "cpu_ms": float(np.median(used)),
            "setup_ms": 1e3 * setup, "width": width, "height": height}  # fmt: skip


_SCENE = """<itouch version="1.0">
  <materials><material name="m"><contact stiffness="1 N/mm"/><visual color="0.7 0.6 0.5"/></material></materials>
  <world><sphere name="ball" radius="30 mm" material="m"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="0 0 60 mm" in="0.1 s"/></motion></operator></interaction>
</itouch>"""
