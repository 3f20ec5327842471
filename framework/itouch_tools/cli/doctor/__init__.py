"""``itouch-py doctor``: what this machine can do, what it lacks, and whether a person should put a finger in."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict

from itouch_tools.cli.arguments import Parser, seconds
from itouch_tools.cli.progress import measured

#: How long [s] `--rig` watches the sensors of a rig, unless `--for` says.
WATCHED = 3.0
_MARKS = {"ok": "ok    ", "lack": "LACK  ", "note": "note  "}


def main(argv: Sequence[str]) -> int:
    """Say what this machine can do, and what to do about each lack."""
    parser = Parser(
        prog="itouch-py doctor", description=main.__doc__,
        epilog="ITOUCH_KERNELS, ITOUCH_KEPT and ITOUCH_MESH_CACHE name other folders for cached kernels, results and "
        "meshes, or are `off`.",
    )  # fmt: skip
    parser.add_argument("--measure", type=seconds, metavar="10s",
                        help="run the loop for this long, idle and then beside a load, and judge by that")  # fmt: skip
    parser.add_argument("--rates", nargs="?", const="", metavar="SCENE",
                        help="which rate of the loop this machine holds for a scene on twins")  # fmt: skip
    parser.add_argument("--rig", metavar="SCENE",
                        help="look at a scene's devices in the air: sensors, watchdogs, cut-offs")  # fmt: skip
    parser.add_argument("--twin", metavar="all|none|NAME", help="with --rig: take these devices as twins")
    parser.add_argument("--for", dest="duration", type=seconds, metavar="3s",
                        help=f"with --rig: how long to watch the sensors (default {WATCHED:g} s)")  # fmt: skip
    parser.add_argument("--busy", type=int, default=0, metavar="N",
                        help="with --rates: while N processes compute, compared with a bare timer")  # fmt: skip
    parser.add_argument("--clear-kept", action="store_true",
                        help="remove cached kernels, results and meshes; the next start makes them again")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("alone", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    _check(parser, options)
    if options.clear_kept:
        from itouch_tools.cli.doctor.disk_caches import clear_kept

        print(clear_kept())
        return 0
    with measured("doctor"):
        if options.rig is not None:
            watched = WATCHED if options.duration is None else options.duration
            return _rig(options.rig, options.twin, watched, as_json=options.json)
        if options.rates is not None:
            return _rates(options.rates, options.measure or 5.0, beside=options.busy, as_json=options.json)
        return _machine(options)


def _machine(options: argparse.Namespace) -> int:
    """Look at the machine, measure its loop if that is asked for, and print what was found and the verdict."""
    from itouch_tools.cli.doctor.machine_checks import examine
    from itouch_tools.cli.doctor.verdict import judge, measure

    findings = examine()
    if not options.json:
        for finding in findings:
            print(f"{_MARKS[finding.status]}{finding.name:<15} {finding.found}")
            if finding.advice:
                print(f"{'':<22}-> {finding.advice}")
    loops = None if options.measure is None else measure(options.measure)
    verdict = judge(findings, loops)
    if options.json:
        content = {
            "checks": [asdict(finding) for finding in findings],
            "measured": None if loops is None else [asdict(row) for row in loops],
            "finger": verdict.finger,
            "verdict": verdict.sentence,
        }
        print(json.dumps(content, indent=1))
        return 0
    for row in loops or ():
        print(f"loop, {row.load:<10}    {row.sentence()}")
    print(f"\n{verdict.sentence}")
    return 0


def _check(parser: Parser, options: argparse.Namespace) -> None:
    """Refuse what no option takes, options that mean nothing without another, and values out of range; exit code 2."""
    for word in options.alone:
        parser.error(
            f"no option takes '{word}': write itouch-py doctor --rig {word} to look at the devices of a scene, "
            f"or --rates {word} to see which rate of the loop this machine holds for it"
        )
    for option, given, whole in (
        ("--twin", options.twin is not None, "rig"), ("--for", options.duration is not None, "rig"),
        ("--busy", options.busy != 0, "rates"),
    ):  # fmt: skip
        if given and getattr(options, whole) is None:
            parser.error(f"{option} goes with --{whole}: write itouch-py doctor --{whole} SCENE {option} ...")
    if options.duration is not None and options.duration <= 0.0:
        parser.error("--for must be more than 0 s; write for example --for 3s")
    if not 0 <= options.busy <= 256:
        parser.error(f"--busy {options.busy} is out of range: 0 to 256")


def _rates(path: str, each: float, *, beside: int, as_json: bool) -> int:
    """Measure which rates are held, each for ``each`` seconds, and print them."""
    from itouch.session import load_scene
    from itouch_tools.cli.doctor.held_rates import best, rates
    from itouch_tools.cli.doctor.measured_loop import bench_scene

    found = []
    for row in rates(load_scene(path, twin="all") if path else bench_scene(), each, beside=beside):
        found.append(row)
        if not as_json:
            print(row.sentence(), flush=True)
    if as_json:
        rows = [{**asdict(row), "held": row.held} for row in found]
        print(json.dumps({"rates": rows, "verdict": best(found)}, indent=1))
    else:
        print(f"\n{best(found)}")
    return 0


def _rig(path: str, twin: str | None, each: float, *, as_json: bool) -> int:
    """Examine a rig in the air and print a line for each check; return 1 if one fails."""
    from itouch.loop import WallClock
    from itouch.servo.prepare import prepare
    from itouch_tools.cli.doctor.rig_checks import FAIL, NOT, examine_rig

    session = prepare(path, seed=0, twin=twin, rig=None)
    session.clock = WallClock()
    session.claim_wires()
    found = []
    for finding in examine_rig(session, each):
        found.append(finding)
        if not as_json:
            print(f"{finding.status:<13} {finding.name:<13} {finding.found}", flush=True)
            if finding.advice:
                print(f"{'':<27} -> {finding.advice}")
    failed, left = (sum(one.status == status for one in found) for status in (FAIL, NOT))
    verdict = f"{failed} of {len(found)} lines fail" if failed else f"nothing fails; {left} lines need a person"
    if as_json:
        print(json.dumps({"rig": [asdict(finding) for finding in found], "verdict": verdict}, indent=1))
    else:
        print(f"\n{verdict}: the checklist of the safety case says how the rest is shown on the rig itself")
    return 1 if failed else 0
