"""``itouch-py SCENE|SESSION``: run, show what happens, end safely with a report."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from itouch.schema import ItouchError
from itouch.schema.regular_files import stored_kind
from itouch.schema.seeds import checked_seed
from itouch.schema.terminal import did, note
from itouch.schema.wait_notices import waiting
from itouch_tools.cli import arm_input, deprecations, live, output_options, pictures, sounds, windows
from itouch_tools.cli.arguments import Parser, seconds
from itouch_tools.cli.output_files import Output, output_file
from itouch_tools.cli.shutdown import Interrupted, Stopping, begin_report, unstarted, write_report

if TYPE_CHECKING:
    from itouch.session import Session


def main(argv: Sequence[str]) -> int:
    """Run a scene, or go on with a saved session."""
    options, begun = _parser().parse_args(argv), time.monotonic()
    with Stopping() as stop:
        try:
            return _start(options, stop)
        except (Exception, KeyboardInterrupt) as raised:
            number = raised.number if isinstance(raised, Interrupted) else stop.unstarted
            if not number:
                raise
            words = {"scene": options.scene, "seed": options.seed or 0, "pace": options.pace}
            return unstarted(number, words, begun, options.report)


def _start(options: argparse.Namespace, stop: Stopping) -> int:
    """Choose how to run, and run; until something runs, a signal raises ``Interrupted``."""
    _check(options)
    if options.trace:
        from itouch.plugin import trace

        trace.begin(options.trace)
    window = windows.wanted(options)
    if options.pace == "real" or window:
        return live.run(options, stop, window=window)
    if stored_kind(options.scene) == "recording":
        note("goes on from the last whole State; the contacts before it stand in the recording, for itouch-py report")
    with waiting(f"preparing {options.scene}"):
        session = _prepare(options)
    if options.trace and all(runner.model.twin for runner in session.runners):
        note(f"no device of this scene is hardware: nothing goes over a wire, and {options.trace} stays empty")
    if options.pace is None and live.needed(session):
        return live.run(options, stop)
    _refuse_hardware(session)
    gamepad = arm_input.without_window(session.model, real=options.pace is None and not _drawn(options))
    if gamepad is not None:
        return live.run(options, stop, gamepad=gamepad)
    from itouch_tools.report.screen import Screen
    from itouch_tools.viewer.fault_messages import told

    for notice in session.notices:
        note(notice)
    deprecations.warn(session.model)
    windows.tell(options, opened=False)
    end = None if options.duration is None else session.seconds + options.duration
    screen = Screen(session, sys.stdout, left=_left(session, end) if options.film else None)
    session.loss_hooks.append(lambda loss: screen.interrupt(told(loss)))
    with pictures.taking(session, options, end=end), sounds.keeping(session, options):
        with output_options.opened(session, options):
            code, lost = _run(session, options, stop.listened(screen.show), stop)
        report = session.report()  # before pictures and sounds are finished: that may fail, and loses nothing then
        stop.listened(screen.finish)(report)
        _write(session, options, report, lost)
    return code


def _left(session: Session, end: float | None) -> Callable[[], float] | None:
    """Return a function of how long a run simulates yet [s], at the earliest; None if no motion of a finger tells."""
    if end is not None:
        return lambda: end - session.seconds
    return (lambda: session.left * session.model.period) if session.left > 1 else None


def _refuse_hardware(session: Session) -> None:
    """Refuse hardware, which is never driven faster than real time, nor in a process without a guardian."""
    real = [f"'{device.name}'" for device in session.model.devices.values() if not device.twin]
    if real:
        raise ItouchError(f"--pace fast is for simulated twins, not for {', '.join(real)}: omit it, or --twin all")


def _drawn(options: argparse.Namespace) -> bool:
    """Tell whether pictures or sounds are asked for, which are made between ticks."""
    return bool(options.screenshot or options.film or options.wav)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="itouch-py run", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE|SESSION", help="a scene (.xml) or a saved session (.itouch)")
    parser.add_argument("--headless", action="store_true", help="no window; chosen by itself where there is no display")
    parser.add_argument("--mute", action="store_true", help="without sound")
    parser.add_argument("--for", dest="duration", type=seconds, metavar="30s",
                        help="simulated time; default: until the scripted motion ends")  # fmt: skip
    parser.add_argument("--pace", choices=("real", "fast"),
                        help="real time or as fast as it can; default: fast on twins, real on hardware")  # fmt: skip
    parser.add_argument("--twin", metavar="all|none|NAME", help="run these devices as simulated twins")
    parser.add_argument("--rig", metavar="FILE", help="put another rig with the same device names under the scene")
    parser.add_argument("--report", type=output_file, metavar="FILE.json", help="write the report as JSON")
    parser.add_argument("--save", type=Output("session", kind="session", in_place=True), metavar="FILE.itouch",
                        help="save the session at the end")  # fmt: skip
    parser.add_argument("--trace", type=output_file, metavar="FILE",
                        help="write what goes over the wires of real devices, as readable text")  # fmt: skip
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all noise (default 0); a session has its own")
    pictures.add_options(parser)
    sounds.add_options(parser)
    output_options.add_options(parser)
    parser.set_defaults(records_as_asked=True)
    return parser


def _check(options: argparse.Namespace) -> None:
    given, options.seed = options.seed is not None, options.seed or 0
    try:
        checked_seed(options.seed)
    except ValueError as error:
        raise ItouchError(f"--{error}") from None
    output_options.wanted(options)
    from itouch.session.open import is_session

    if (options.twin or options.rig) and is_session(options.scene):
        raise ItouchError("--twin and --rig choose devices for a scene; a session has its own")
    if given and is_session(options.scene):
        raise ItouchError("--seed begins the noise of a scene; a session goes on with its own")


def _prepare(options: argparse.Namespace) -> Session:
    """Build the engine, without opening hardware, which is never driven in this process."""
    from itouch.servo.prepare import prepare

    return prepare(options.scene, seed=options.seed, twin=options.twin, rig=options.rig, opens=False)


def _run(
    session: Session, options: argparse.Namespace, show: Callable[[], None], stop: Stopping
) -> tuple[int, ItouchError | None]:
    """Run to the end; return the exit code, and the error if what the run keeps could not be finished."""
    from itouch.loop import DeviceFaultError, builtins_guard
    from itouch.loop.fault_attribution import changed_python, ended_by

    if number := stop.unstarted:  # what was raised then has been dropped on its way
        session.close()
        raise Interrupted(number)
    stop.bind(session.stop)
    fault: BaseException | None = None
    modules = builtins_guard.LoadedModules()
    harmed: tuple[str, ...] = ()
    try:
        if options.duration is None and not session.scripted:
            raise ItouchError("the scene has no scripted motion: say for how long to run, with --for 30s")
        session.enable()
        begin_report(options.report, {"scene": options.scene, "seed": options.seed, "pace": "fast"})
        session.run(options.duration, each=show, every=50)
    except DeviceFaultError as met:
        fault = met
    except BaseException as raised:
        fault = ended_by(session.fault, raised)  # code that ends the program within a tick counts as a fault
        if fault is raised:
            session.close()
            raise
    finally:
        builtins_guard.put_back()
        harmed = modules.put_back()
    if harmed and fault is None and session.runners:
        fault = changed_python(session.model, session.ticks, harmed)
        session.make_safe(fault)
    try:
        session.close()
    except ItouchError as error:
        if fault is None:
            return 2, error
        print(f"{fault}\nthen: {error}", file=sys.stderr)
    return (1 if fault is not None else stop.code(1 if session.failed else 0)), None


def _write(session: Session, options: argparse.Namespace, report: dict[str, Any], lost: ItouchError | None) -> None:
    """Write report and session; one that cannot be written takes the other not with it, and each is told.

    Raises
    ------
    ItouchError
        Naming each file that can't be written, and what was ``lost`` before.
    """
    failed = [lost] if lost is not None else []
    try:
        write_report(options.report, lambda: report)
    except ItouchError as error:
        failed.append(error)
    if options.save:
        try:
            session.save(options.save)
            did(f"saved {options.save}")
        except ItouchError as error:
            failed.append(error)
    if failed:
        raise ItouchError("\n".join(str(error) for error in failed)) from failed[0]
