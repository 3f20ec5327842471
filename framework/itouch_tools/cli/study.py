"""``itouch-py study check|freeze|run|simulate|report|forget``: psychophysical studies from one file."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from itouch.schema.terminal import did, number_of
from itouch.schema.wait_notices import waiting
from itouch_tools.cli import study_analyses, study_run, study_serve
from itouch_tools.cli.arguments import add_command, parser_of
from itouch_tools.cli.output_files import Output, output_folder
from itouch_tools.cli.study_participant import folder_of

if TYPE_CHECKING:
    from itouch_tools.study.reading import StudyFile

#: Seconds in which most skin recovers from a touch of a few seconds, and seconds for an answer and the next approach.
SKIN, ANSWERING = 10.0, 4.0


def main(argv: Sequence[str]) -> int:
    """Check, freeze, run, simulate or report a study."""
    parser = parser_of("itouch-py study", main.__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="check|freeze|run|simulate|report|...")
    check = add_command(commands, "check", "print every problem, the number of trials, and how long they take")
    check.add_argument("study", metavar="STUDY.xml", help="the study")
    check.add_argument("--participant", metavar="CODE", help="print the order of this participant too")
    simulate = add_command(commands, "simulate", "run the trials on twins, answered by simulated observers")
    simulate.add_argument("study", metavar="STUDY.xml", help="the study")
    simulate.add_argument(
        "-o",
        "--output",
        type=output_folder,
        metavar="FOLDER",
        required=True,
        help="the study's data; goes on with them",
    )
    simulate.add_argument("--observers", type=int, default=8, metavar="N", help="number of observers (default: 8)")
    simulate.add_argument(
        "--model", default="flux", metavar="NAME", help="flux, combined, receptors, naive, or a plugin's"
    )
    simulate.add_argument("--same-skin", action="store_true", help="give all of them the scene's skin temperature")
    simulate.add_argument("--processes", type=int, default=1, metavar="N", help="processes at once (default: 1)")
    report = add_command(commands, "report", "write page, JSON and table of a study's data")
    report.add_argument("study", metavar="STUDY.xml", help="the study")
    report.add_argument("folder", metavar="FOLDER", help="the study's data")
    report.add_argument(
        "-o",
        "--output",
        type=Output("page", beside=(".json", ".tsv")),
        metavar="FILE.html",
        help="the page to write; default: report.html in the folder",
    )
    freeze = add_command(commands, "freeze", "stamp study, scene and program before the first participant")
    freeze.add_argument("study", metavar="STUDY.xml", help="the study")
    freeze.add_argument("folder", type=output_folder, metavar="FOLDER", help="the study's data")
    study_run.add_parser(commands)
    study_serve.add_parser(commands)
    study_analyses.add_parsers(commands)
    forget = add_command(commands, "forget", "delete a participant's personal data for good; the trials stay")
    forget.add_argument("folder", metavar="FOLDER", help="the study's data")
    forget.add_argument("--participant", metavar="CODE", required=True, help="the participant's code, as P07")
    forget.add_argument("--recordings", action="store_true", help="the recordings of the sessions, too")
    options = parser.parse_args(argv)
    missing = _missing()
    if missing:
        print(f"studies need {missing}: pip install 'itouch-py[study]'", file=sys.stderr)
        return 2
    chosen = {
        "check": _check, "simulate": _simulate, "report": _report, "freeze": _freeze, "run": _run, "forget": _forget,
    }  # fmt: skip
    if options.command in chosen:
        return chosen[options.command](options)
    from itouch.schema import ItouchError

    try:
        return _numbers(options)
    except ItouchError as error:
        return _store_error(error)


def _numbers(options: argparse.Namespace) -> int:
    if options.command == "coverage":
        return study_analyses.coverage(options)
    if options.command == "export":
        return study_analyses.export(options)
    file = _load(options.study)
    if file is None:
        return 2
    if options.command == "serve":
        return study_serve.serve(file, options)
    return study_analyses.audit(file, options) if options.command == "audit" else study_analyses.power(file, options)


def _missing() -> str:
    from importlib.util import find_spec

    return " and ".join(name for name in ("scipy", "SweetSpot") if find_spec(name) is None)


def _load(path: str) -> StudyFile | None:
    """Return a study without problems, or print them and return None."""
    from itouch.plugin.discovery import Catalog
    from itouch.schema.diagnostics import render
    from itouch_tools.study.reading import read_study

    found, problems = read_study(path, Catalog())
    if problems:
        print(render(problems), file=sys.stderr)
    broken = found is None or any(problem.severity == "error" for problem in problems)
    return None if broken else found


def _check(options: argparse.Namespace) -> int:
    from itouch_tools.study.plugin_tasks import task_of
    from itouch_tools.study.study_elements import CATCH, PRACTICE, TASKS, UNCOUNTED
    from itouch_tools.study.tasks import question_of
    from itouch_tools.study.trials import trials_of

    file = _load(options.study)
    if file is None:
        return 2
    planned = trials_of(file, options.participant or "P01")
    counted = [trial for trial in planned if trial.block not in UNCOUNTED]
    touches = sum(len(trial.shown) for trial in planned)
    rest = file.study.breaks
    pauses = 0.0 if rest is None else (len(planned) - 1) // rest.every * rest.duration
    between = _between(file)
    seconds = touches * (file.study.contact.duration + between) + pauses
    print(f"{options.study}: ok")
    practice, caught = (sum(trial.block == block for trial in planned) for block in (PRACTICE, CATCH))
    among = f", {number_of(caught, 'catch trial')} among them" if caught else ""
    print(f"  {number_of(len(counted), 'trial')} of {file.study.task.kind} ({practice} of practice before them{among})")
    many = number_of(touches, "touch", "touches")
    print(f"  {many}, about {seconds / 60.0:.0f} min with {between:.0f} s between two touches")
    print(f"  in contact {touches * file.study.contact.duration / 60.0:.1f} min at least")
    counts = {repr(trial.condition): 0 for trial in counted}
    for trial in counted:
        counts[repr(trial.condition)] += 1
    if len(set(counts.values())) > 1:
        print("  unbalanced: " + ", ".join(f"{count} x {name}" for name, count in counts.items()))
    if file.study.task.kind not in TASKS:
        brought = task_of(file.study.task.kind)
        print(f"  {brought.whose} asks: {question_of(file.study)}")
    if file.study.blind is not None and file.study.blind.noise:
        print(
            "  masking noise is played from the first trial to the last: closed headphones, and set its loudness before"
        )
    if options.participant:
        for trial in planned:
            words = " | ".join(", ".join(each.values()) or trial.staircase for each in trial.shown)
            print(f"  {trial.place:4d}  {trial.block:10s}  {words}")
    return 0


def _between(file: StudyFile) -> float:
    """Return the time [s] between two touches: what the study asks for, and what the skin takes to recover."""
    contact, blind = file.study.contact, file.study.blind
    approach = blind.approach if blind is not None and blind.equalise else 0.0
    return contact.pause + approach + min(contact.skin_wait, SKIN) + ANSWERING


def _store_error(error: Exception) -> int:
    print(f"{error}", file=sys.stderr)
    return 2


def _stamp(file: StudyFile, folder: Path, deviation: str = "") -> None:
    """Freeze the study in its folder; if one is frozen there, check that it is the same, or note the deviation."""
    from datetime import UTC, datetime
    from importlib.metadata import version

    from itouch_tools.study.frozen import check_task, digest_of, keep_copy
    from itouch_tools.study.study_store import Store

    digest = digest_of(file)
    with Store.open(folder, create=True) as store:
        check_task(file, store.rows())
        store.freeze(
            name=file.name, seed=file.study.seed, digest=digest, program=version("itouch-py"),
            frozen=datetime.now(UTC).isoformat(timespec="seconds"), deviation=deviation,
            earlier=digest_of(file, earlier=True),
        )  # fmt: skip
    keep_copy(file, folder, digest)


def _prepared(options: argparse.Namespace, folder: str, *, deviation: str = "") -> StudyFile | int:
    from itouch_tools.study.study_store import StoreError

    file = _load(options.study)
    if file is None:
        return 2
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        _stamp(file, Path(folder), deviation)
    except (StoreError, OSError) as error:
        return _store_error(error)
    return file


def _freeze(options: argparse.Namespace) -> int:
    file = _prepared(options, options.folder)
    if isinstance(file, int):
        return file
    print(f"'{file.name}' is frozen in {options.folder}")
    return 0


def _run(options: argparse.Namespace) -> int:
    from itouch.schema import ItouchError

    code = options.participant
    if not (0 < len(code) <= 32 and code.isascii() and code.replace("-", "").replace("_", "").isalnum()):
        print(f"--participant '{code}': a code has letters, digits, - and _, 32 at most", file=sys.stderr)
        return 2
    folder = str(folder_of(options))
    file = _prepared(options, folder, deviation=options.deviation or "")
    if isinstance(file, int):
        return file
    try:
        return study_run.run(file, options)
    except ItouchError as error:
        return _store_error(error)


def _nobody(code: str, folder: str, known: Sequence[str]) -> str:
    """Return what to say of a code that no participant has: a person who asked to be forgotten must be found."""
    there = f"the participants are {', '.join(known)}" if known else "it has no participants yet"
    return f"'{folder}' knows no participant '{code}', nothing was deleted: {there}"


def _deleted(path: Path) -> str:
    """Delete a file; return why it could not be, or nothing."""
    try:
        path.unlink()
    except OSError as error:
        return f"{error}"
    return ""


def _forget(options: argparse.Namespace) -> int:
    from itouch_tools.study.study_store import Store, StoreError

    try:
        with Store.open(Path(options.folder)) as store:
            recordings = store.recordings(options.participant)
            if not recordings and options.participant not in (known := store.known()):
                raise StoreError(_nobody(options.participant, options.folder, known))
            # recordings first: it may be they that fill the disk, and then nothing else can be done
            left = [said for path in recordings if options.recordings and (said := _deleted(path))]
            gone = store.forget(options.participant)
    except StoreError as error:
        return _store_error(error)
    words = "the personal data are deleted" if gone else "there were no personal data"
    print(f"{options.participant}: {words}; the trials stay under the code")
    if left:
        print(f"{options.participant}: not all recordings could be deleted: {'; '.join(left)}", file=sys.stderr)
        return 1
    if recordings:
        many = number_of(len(recordings), "recording of the sessions", "recordings of the sessions")
        told = "deleted, too" if options.recordings else "kept: they show how a hand moved; --recordings deletes them"
        print(f"{options.participant}: {many}: {told}")
    return 0


def _simulate(options: argparse.Namespace) -> int:
    from itouch.schema import ItouchError
    from itouch.session.session_error import SessionError
    from itouch_tools.cli.shutdown import Interrupted, Stopping
    from itouch_tools.study.observer_catalog import observer_of
    from itouch_tools.study.simulate import Panel, simulate

    if options.observers < 1 or options.processes < 1:
        print("--observers and --processes must be 1 or more", file=sys.stderr)
        return 2
    observer_of(options.model)
    file = _prepared(options, options.output)
    if isinstance(file, int):
        return file
    panel = Panel(options.observers, options.model, skin=not options.same_skin)
    try:
        with Stopping(), waiting("simulating") as wait:
            for done, made in enumerate(
                simulate(options.study, Path(options.output), panel, processes=options.processes), 1
            ):
                print(f"{made} ({done} of {options.observers})", flush=True)
                wait.part(done / options.observers, f"{done} of {options.observers} observers")
    except Interrupted as signalled:
        print("stopped; what was made is kept, and the same command goes on from there", file=sys.stderr)
        return signalled.code
    except SessionError as error:
        print(f"{error}", file=sys.stderr)
        return 1
    except ItouchError as error:
        return _store_error(error)
    return 0


def _report(options: argparse.Namespace) -> int:
    from itouch.schema.durable import write_whole
    from itouch_tools.study.analysis import analyse
    from itouch_tools.study.frozen import check_same_study
    from itouch_tools.study.study_page import page
    from itouch_tools.study.study_store import Store, StoreError
    from itouch_tools.study.trial_table import write_table

    file = _load(options.study)
    if file is None:
        return 2
    folder = Path(options.folder)
    target = Path(options.output) if options.output else folder / "report.html"
    try:
        with Store.open(folder) as store:
            check_same_study(file, store)
            rows, frozen, deviations = store.rows(), store.frozen() or {}, store.deviations()
        with waiting(f"analysing {folder}"):
            result = analyse(file, rows)
        provenance = {str(key): str(value) for key, value in frozen.items()}
        provenance |= {f"deviation {at}": what for at, what in deviations}
        write_whole(str(target), page(result, provenance).encode())
        write_whole(str(target.with_suffix(".json")), (json.dumps(result, indent=1) + "\n").encode())
        write_table(rows, target.with_suffix(".tsv"))
    except StoreError as error:
        return _store_error(error)
    except OSError as error:
        return _store_error(ValueError(f"cannot write '{error.filename}': {error.strerror}"))
    correct = result.get("correct")
    if correct is not None and correct["proportion"] is not None:
        print(f"{correct['right']} of {correct['trials']} right ({100.0 * correct['proportion']:.0f} %)")
    did(f"wrote {target}, {target.with_suffix('.json').name} and {target.with_suffix('.tsv').name}")
    return 0
