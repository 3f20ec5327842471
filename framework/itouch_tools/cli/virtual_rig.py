"""``itouch-py virtual-rig``: the devices of a scene, simulated behind their real protocols.

Each device's twin is reached at the address that its parameters give (a serial port, a socket, USB/IP); the twins are
coupled by the same operator and finger as in a run on twins.  Another ``itouch-py`` runs the scene on them as on
hardware.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Sequence

from itouch_tools.cli.arguments import Parser, seconds
from itouch_tools.cli.output_files import output_file
from itouch_tools.cli.served_twins import VirtualRig

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main(argv: Sequence[str]) -> int:
    """Serve a scene's devices until Ctrl-C, or for a time."""
    parser = Parser(prog="itouch-py virtual-rig", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE.xml", help="the scene that another itouch-py will run")
    parser.add_argument("--rig", metavar="FILE", help="put another rig with the same device names under the scene")
    parser.add_argument("--for", dest="duration", type=seconds, metavar="60s", help="end after this time")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all noise (default 0)")
    parser.add_argument("--run", action="store_true",
                        help="run the scene too, in this process and in step: as fast as the wires answer")  # fmt: skip
    parser.add_argument("--pace", choices=("step", "real"), default="step",
                        help="with --run: in step (default), or in real time, as on hardware")  # fmt: skip
    parser.add_argument("--phase", type=seconds, default=0.0, metavar="7ms",
                        help="with --run: exchanges over slow wires begin so much later")  # fmt: skip
    parser.add_argument("--unsteady", action="store_true",
                        help="with --run: they begin every 20 +- 10 ms, one in twenty is lost")  # fmt: skip
    parser.add_argument("--report", type=output_file, metavar="FILE.json", help="with --run: write the report as JSON")
    parser.add_argument("--trace", type=output_file, metavar="FILE", help="with --run: write what goes over the wires")
    parser.add_argument(
        "--only",
        metavar="DEVICE",
        action="append",
        default=[],
        help="with --run: only this device (repeat: these) on its wire, the rest without",
    )
    parser.set_defaults(records_as_asked=True)
    options = parser.parse_args(argv)
    wires = options.phase or options.unsteady
    if (options.report or options.trace or options.only or wires) and not options.run:
        parser.error("--report, --trace, --only, --phase and --unsteady go with --run")
    if options.pace == "real" and not options.run:
        parser.error("--pace goes with --run: without it a virtual rig is in real time")
    if options.pace == "real" and (options.only or options.trace or wires):
        parser.error("--only, --trace, --phase and --unsteady go with --pace step")
    if options.pace == "real":
        from itouch_tools.cli import real_rig

        return real_rig.main(options)
    if options.run:
        from itouch_tools.cli import lockstep

        return lockstep.main(options)
    from itouch.servo import realtime
    from itouch.servo.prepare import prepare

    session = prepare(options.scene, seed=options.seed, twin="all", rig=options.rig)
    rig = VirtualRig(session)
    ended: list[int] = []
    before = {number: signal.signal(number, lambda n, _: ended.append(n)) for number in _SIGNALS}
    try:
        for name, where in rig.open():
            print(f"{name}: {where}")
        print("ready; Ctrl-C ends it", flush=True)
        realtime.be_punctual()
        limit = time.monotonic() + options.duration if options.duration is not None else float("inf")
        rig.run(lambda: bool(ended) or time.monotonic() >= limit)
    finally:
        rig.close()
        for number, handler in before.items():
            signal.signal(number, handler)
        session.close()
    return 0
