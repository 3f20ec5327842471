"""``itouch-py check SCENE...``: every problem with file, line and column; nothing is started."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from itouch.schema import ItouchError
from itouch.schema.terminal import VERBOSITY, did
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser, add_json, as_json
from itouch_tools.cli.output_files import output_file, write_output

if TYPE_CHECKING:
    from itouch.schema import Problem
    from itouch.world import Model
    from itouch_tools.authoring.fixes import Edit

#: The note on hardware that has no watchdog of its own.
_ALONE = (
    "device '{}' has no watchdog of its own that its driver knows of: it runs only with the guardian process and "
    "hold-to-run"
)


def main(argv: Sequence[str]) -> int:
    """Print every problem of scene files."""
    options = _parser().parse_args(argv)
    if options.json and options.sarif:
        raise ItouchError("--json and --sarif are two forms of the result: choose one")
    if options.fix and options.diff:
        raise ItouchError("--fix writes what --diff only shows: choose one")
    if (options.fix or options.diff) and (options.json or options.sarif) and not options.output:
        raise ItouchError("the diff would stand in the JSON: name a file for it by -o")
    if options.fix or options.diff:
        from itouch_tools.cli.fixing import fixed, show_and_write

        for path in options.scenes:
            found = fixed(path, lambda one: examined(one, options.rig, options.twin)[1])
            show_and_write(path, found, write=options.fix)
    results, many = {}, len(options.scenes)
    with waiting(f"checking {options.scenes[0]}" if many == 1 else f"checking {many} scenes") as wait:
        for number, path in enumerate(options.scenes):
            if many > 1:
                wait.part(number / many, path)
            results[path] = examined(path, options.rig, options.twin)
    bad = {path: _bad(*found, strict=options.strict) for path, found in results.items()}
    if options.sarif or options.json or options.output:
        _write(options, results, bad)
    else:
        for path, (model, problems) in results.items():
            _say(path, model, problems, failed=bad[path])
    return 2 if any(bad.values()) else 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="itouch-py check", description=main.__doc__)
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="a scene file")
    parser.add_argument("--rig", metavar="FILE", help="check with another rig under the scene")
    parser.add_argument("--twin", metavar="all|none|NAME", help="check with these devices as twins")
    parser.add_argument("--strict", action="store_true", help="treat what is legal but odd as wrong")
    parser.add_argument("--fix", action="store_true", help="repair what can only have meant one thing; never a limit")
    parser.add_argument("--diff", action="store_true", help="show what --fix would do, and write nothing")
    add_json(parser)
    parser.add_argument("--sarif", action="store_true", help="the result as SARIF, which annotates lines in reviews")
    parser.add_argument("-o", "--output", type=output_file, metavar="FILE",
                        help="write JSON, or SARIF if the name ends in .sarif, to this file")  # fmt: skip
    return parser


def examined(path: str, rig: str | None, twin: str | None) -> tuple[Model | None, list[Problem]]:
    """Return the compiled scene (None if it can't be compiled) and all problems, in the order of the file."""
    from itouch.plugin.discovery import Catalog
    from itouch.scene.loader import in_file_order, read_scene
    from itouch.schema.diagnostics import SceneError
    from itouch.session import choose_twins
    from itouch.session.building import with_records
    from itouch.session.channel_selection import recording_notes, recording_problems
    from itouch.world import survey
    from itouch_tools.authoring.lint import odd
    from itouch_tools.report.safety.rules import alone

    catalog = Catalog()
    scene, problems = read_scene(path, catalog, rig=rig)
    try:
        scene = scene if twin is None else choose_twins(scene, twin)
    except SceneError as error:
        problems += error.problems
    scene, unfit = with_records(scene, catalog)
    found = survey(scene, catalog, problems)
    model, more, unrecordable = found.model, list(found.problems), recording_problems(found)
    if model is not None and not unrecordable:
        more = [*more, *odd(model)]
        untold = (notice for notice in model.notices if not _told(notice, more))
        unwatched = (_ALONE.format(name) for name in alone(model))
        model = replace(model, notices=(*untold, *recording_notes(model), *unwatched))
    return (None if unrecordable or unfit else model), in_file_order([*problems, *unfit, *more, *unrecordable])


def _told(notice: str, problems: Sequence[Problem]) -> bool:
    """Tell whether a notice of a run is among the problems already, with its place."""
    return any(
        notice.startswith(problem.sentence) or (problem.code == "clipped-stiffness" and " with stiffness " in notice
                                                and notice.startswith(problem.sentence.partition(" has a ")[0]))
        for problem in problems
    )  # fmt: skip


def say(path: str, rig: str | None, twin: str | None, *, strict: bool = False) -> bool:
    """Check one scene and print what was found; tell whether the scene is right."""
    model, problems = examined(path, rig, twin)
    failed = _bad(model, problems, strict=strict)
    _say(path, model, problems, failed=failed)
    return not failed


def _bad(model: Model | None, problems: Sequence[Problem], *, strict: bool) -> bool:
    return model is None or any(problem.severity == "error" or strict for problem in problems)


def _say(path: str, model: Model | None, problems: Sequence[Problem], *, failed: bool) -> None:
    """Print what was found in one scene."""
    from itouch.schema.diagnostics import render
    from itouch_tools.report.limits_in_words import limit_lines

    if problems:
        print(render(problems), file=sys.stderr, flush=True)
    if model is None:
        return
    for notice in model.notices if not VERBOSITY.quiet else ():
        print(f"note: {notice}")
    if failed:
        did(f"{path}: legal, but odd")
        return
    found = (("object", "objects", model.objects), ("device", "devices", model.devices),
             ("modality", "modalities", _asked_for(model)))  # fmt: skip
    counts = (f"{len(items)} {one if len(items) == 1 else many}" for one, many, items in found)
    print(f"{path}: ok ({', '.join(counts)})")
    if VERBOSITY.quiet:
        return
    for device in model.devices.values():
        for line in limit_lines(device):
            print(f"  {line}")


def _asked_for(model: Model) -> list[str]:
    """Return the names of the modalities that the scene itself asks for."""
    return [modality.name for modality in model.modalities if not modality.default_of]


def _write(
    options: argparse.Namespace, results: dict[str, tuple[Model | None, list[Problem]]], bad: dict[str, bool]
) -> None:
    """Write the result for a program, as JSON or SARIF."""
    from importlib.metadata import version

    from itouch_tools.report.problem_formats import as_sarif

    sarif = options.sarif or (options.output or "").lower().endswith(".sarif")
    if sarif:
        content: Any = as_sarif({path: problems for path, (_, problems) in results.items()},
                                version=version("itouch-py"), edits=_edits(options, results))  # fmt: skip
    else:
        content = {"scenes": [_entry(path, *results[path], good=not bad[path]) for path in results]}
    if options.output is None:
        print(as_json(content))
        return
    write_output(options.output, as_json(content) + "\n")
    did(f"wrote {options.output}")


def _edits(
    options: argparse.Namespace, results: dict[str, tuple[Model | None, list[Problem]]]
) -> dict[Problem, list[Edit]]:
    """Return the edits that --fix would make, by problem."""
    from pathlib import Path

    from itouch_tools.authoring.fixes import edits
    from itouch_tools.cli.fixing import fixed

    found: dict[Problem, list[Edit]] = {}
    for path, (_, problems) in results.items():
        if not any(problem.mend for problem in problems):
            continue
        try:
            mending = fixed(path, lambda one: examined(one, options.rig, options.twin)[1])
        except ItouchError:  # no copy can be made beside the file: then no fix is offered
            continue
        data = Path(path).read_bytes()
        found |= {one: edits(data, path, one) for one in problems if mending is not None and one in mending.problems}
    return found


def _entry(path: str, model: Model | None, problems: Sequence[Problem], *, good: bool) -> dict[str, Any]:
    from itouch_tools.report.limits_in_words import limit_rows
    from itouch_tools.report.problem_formats import as_entries

    entry: dict[str, Any] = {"scene": path, "ok": good, "problems": as_entries(problems)}
    if model is not None:
        entry |= {
            "notices": list(model.notices),
            "objects": list(model.objects),
            "devices": list(model.devices),
            "modalities": _asked_for(model),
            "limits": [row._asdict() for device in model.devices.values() for row in limit_rows(device)],
        }
    return entry
