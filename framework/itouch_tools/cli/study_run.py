"""``itouch-py study run``: a participant's session at the terminal, from a script, or in windows."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from itouch_tools.cli.arguments import add_command
from itouch_tools.cli.output_files import output_folder

if TYPE_CHECKING:
    from itouch_tools.study.reading import StudyFile


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    run = add_command(commands, "run", "run a participant's trials; goes on where the participant stopped")
    run.add_argument("study", metavar="STUDY.xml", help="the study")
    run.add_argument("-o", "--output", type=output_folder, metavar="FOLDER",
                     help="the study's data; default: NAME.data beside the file")  # fmt: skip
    run.add_argument("--participant", metavar="CODE", required=True, help="the participant's code, as P07")
    run.add_argument(
        "--answers",
        metavar="FILE",
        help="a script, one ANSWER [SECONDS] a line, line n for trial n of the order; - reads it from the input",
    )
    run.add_argument("--answers-from", metavar="NAME", help="an answer device that a plugin brings (itouch.tasks)")
    run.add_argument(
        "--pace",
        choices=("real", "fast"),
        help="real time, or as fast as it can; default: real for a person, fast for a script",
    )
    run.add_argument("--deviation", metavar="WORDS", help="note what was changed after the study was frozen, and why")
    kept = "one recording a session, in the folder's recordings; default: yes for a person, no for a script"
    run.add_argument("--record", action=argparse.BooleanOptionalAction, default=None, help=kept)
    run.add_argument("--window", action="store_true", help="the participant's window, answered by mouse and keys")
    run.add_argument("--operator", action="store_true", help="the operator's window: devices, pause, notes, stop")
    run.add_argument("--mute", action="store_true", help="without the masking noise that the study asks for")
    run.add_argument("--light", action="store_true", help="dark letters on light ground")
    run.add_argument("--full-screen", action="store_true", help="the window fills the screen")


def run(file: StudyFile, options: argparse.Namespace) -> int:
    """Run the remaining trials, and print which were done; return 3 if the session was ended before the last trial."""
    from itouch.loop import DeviceFaultError, VirtualClock
    from itouch.loop.clock import WallClock
    from itouch.plugin.discovery import Catalog
    from itouch.schema.terminal import number_of
    from itouch_tools.cli import study_rig
    from itouch_tools.cli.shutdown import Interrupted, Stopping
    from itouch_tools.cli.study_participant import answers_of, folder_of, masking, opening, outcome_of
    from itouch_tools.cli.study_window import operators_window
    from itouch_tools.study.answer_sources import Stopped
    from itouch_tools.study.participant_session import Run
    from itouch_tools.study.study_store import Store

    if study_rig.needed(file):
        return study_rig.run(file, options)
    answers, shows = answers_of(file, options)
    record = options.record if options.record is not None else not options.answers
    real = (options.pace or ("fast" if options.answers else "real")) == "real"
    with Stopping(), Store.open(folder_of(options)) as store, masking(file, options):
        session = Run(
            file, options.participant, store, answers, Catalog(), clock=WallClock() if real else VirtualClock(),
            show=shows, record=record, operator=operators_window(light=options.light) if options.operator else None,
        )  # fmt: skip
        before = len(session.course.rows)
        print(opening(options.participant, before, session.course.left))
        made, lost = 0, list[str]()
        try:
            for row in session.trials():
                made += 1
                told = outcome_of(row.void, again=session.course.comes_again(row))
                print(f"trial {row.place + 1}: {told}", flush=True)
                if session.switcher.losses and not lost:
                    lost.append(session.switcher.losses[0])
                    print(f"the session is not recorded any more: {lost[0]}", file=sys.stderr)
        except Stopped as why:
            said = f" ({why})" if str(why) else ""
            print(f"stopped after {number_of(made, 'new trial')}{said}; the same command goes on from here")
            return 3
        except Interrupted as signalled:
            print(f"\nstopped after {number_of(made, 'new trial')}; the same command goes on from here")
            return signalled.code
        except DeviceFaultError as error:
            print(f"{error}\nthe trial was not kept; the same command goes on from it", file=sys.stderr)
            return 1
    print(f"all done: {number_of(made, 'new trial')}")
    return 0
