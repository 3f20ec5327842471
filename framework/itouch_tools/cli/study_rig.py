"""``itouch-py study run`` on a rig with hardware: the trials in a servo process, the people at the desk."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from itouch_tools.cli.shutdown import Interrupted, Stopping

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from itouch.servo import Handle
    from itouch_tools.study.reading import StudyFile


def needed(file: StudyFile) -> bool:
    """Tell whether a device of the study's scene is hardware."""
    from itouch.plugin.discovery import Catalog
    from itouch_tools.study.rig_windows import hardware_of

    return bool(hardware_of(file, Catalog()))


def followed(handle: Handle | None) -> list[str]:
    """Return what followed from the fault that ended a session: whether all was made safe; as lines."""
    from itouch.servo import ServoError
    from itouch_tools.viewer.fault_messages import outcome

    if handle is None:
        return []
    try:
        faults = [fault for fault in handle.report()["faults"] if fault.get("safe")]
    except ServoError:  # it has left no report
        return []
    return [f"  {line}" for line in outcome(faults[-1])] if faults else []


def run(file: StudyFile, options: argparse.Namespace) -> int:
    """Run the remaining trials on hardware, and print which were done; exit codes are those on twins.

    Raises
    ------
    ItouchError
        If the session can't begin.
    """
    from itouch.loop import DeviceFaultError
    from itouch.plugin.discovery import Catalog
    from itouch.schema.terminal import number_of
    from itouch.schema.wait_notices import waiting
    from itouch.servo import ServoError
    from itouch_tools.cli.study_participant import answers_of, folder_of, masking, opening, outcome_of
    from itouch_tools.cli.study_window import operators_window
    from itouch_tools.study import rig_windows
    from itouch_tools.study.operating import keep_note
    from itouch_tools.study.progression import Course
    from itouch_tools.study.study_store import Store

    catalog, folder = Catalog(), folder_of(options)
    rig_windows.refuse(file, catalog, switch=options.operator, fast=options.pace == "fast")
    with Store.open(folder) as store:
        store.refuse_simulated()
        course = Course(file, options.participant, store.rows(options.participant))
        before, left = len(course.rows), course.left
        over = course.next() is None
    print(opening(options.participant, before, left))
    if over:
        print("all done: 0 new trials")
        return 0
    answers, show = answers_of(file, options)
    operator = operators_window(light=options.light) if options.operator else None
    record = options.record if options.record is not None else not options.answers
    made, again = 0, "the same command goes on from here"
    handle = None
    with Stopping() as stop, masking(file, options):
        try:
            with waiting(f"starting {options.study}"):
                handle = rig_windows.launch(file, options.participant, folder, record=record)
            stop.bind(handle.request_stop)
            with handle:

                def note(trial: int, words: str) -> None:
                    keep_note(folder, options.participant, trial, words)

                session = rig_windows.RigWindows(handle, answers, show=show, operator=operator, note=note)
                for told in session.attend():
                    if told["kind"] == "trial":
                        made += 1
                        print(f"trial {told['place'] + 1}: {outcome_of(told['void'], again=told['again'])}", flush=True)
                    elif told["kind"] == "lost":
                        print(f"the session is not recorded any more: {told['words']}", file=sys.stderr)
        except Interrupted as signalled:
            return signalled.code
        except DeviceFaultError as error:
            print("\n".join([str(error), *followed(handle), again]), file=sys.stderr)
            return 1
        except ServoError as error:
            print(f"{error}\n{again}", file=sys.stderr)
            return 1
    if session.stopped:
        said = f" ({session.why})" if session.why else ""
        print(f"stopped after {number_of(made, 'new trial')}{said}; {again}")
        return stop.code(3)
    print(f"all done: {number_of(made, 'new trial')}")
    return 0


def serve(file: StudyFile, key: Path, options: argparse.Namespace) -> int:
    """Serve a study on hardware until a program says ``stop``, or a signal or a fault comes.

    Raises
    ------
    ItouchError
        If the session can't begin.
    """
    from itouch.loop import DeviceFaultError
    from itouch.plugin.discovery import Catalog
    from itouch.schema.terminal import did
    from itouch.schema.wait_notices import waiting
    from itouch.servo import ServoError
    from itouch_tools.study import rig_windows

    rig_windows.refuse(file, Catalog(), switch=False, fast=options.pace == "fast")
    handle = None
    with Stopping() as stop:
        try:
            with waiting(f"starting {options.study}"):
                handle = rig_windows.launch_server(file, key, options.port)
            stop.bind(handle.request_stop)
            with handle:
                port = handle.others.get(timeout=10.0)["port"]
                print(f"'{file.name}' is served on port {port} of this machine; the key is in {key}", flush=True)
                handle.enable()
                while not handle.wait(0.1):
                    pass
        except Interrupted as signalled:
            return signalled.code
        except DeviceFaultError as error:
            print("\n".join([str(error), *followed(handle)]), flush=True)
            return 1
        except ServoError as error:
            print(f"{error}", flush=True)
            return 1
    did("the served study has ended")
    return stop.code(0)
