"""Reads a sweep's file, with the place of everything in it, and finds all problems at once."""

from __future__ import annotations

import os
from collections.abc import Iterator

from itouch.plugin.discovery import Catalog
from itouch.scene.binding import Binder
from itouch.scene.loader import in_file_order
from itouch.scene.places import Places
from itouch.scene.source import Node, SourceError, read_root
from itouch.schema.diagnostics import Problem, SceneError
from itouch_tools.study.reading import StudyFile, read_study
from itouch_tools.sweeps.checking import contradictions, scenes
from itouch_tools.sweeps.sweep_elements import VERSION, Sweep
from itouch_tools.sweeps.sweepfile import SweepFile


def load_sweep(path: str | os.PathLike[str], catalog: Catalog) -> SweepFile:
    """Load a sweep, and check it against its scene.

    Raises
    ------
    SceneError
        With all problems of sweep and scene in file order.
    """
    found, problems = read_sweep(path, catalog)
    if found is None or any(problem.severity == "error" for problem in problems):
        raise SceneError(problems)
    return found


def read_sweep(path: str | os.PathLike[str], catalog: Catalog) -> tuple[SweepFile | None, list[Problem]]:
    """Return a sweep, or None if it can't be read, and the problems found, in file order."""
    shown = os.fspath(path)
    try:
        root = read_root(shown, "sweep", f'<sweep version="{VERSION}" scene="SCENE.xml">')
    except SourceError as error:
        return None, [error.problem]
    problems: list[Problem] = []
    places = Places()
    sweep = Binder(catalog, problems, places).bind(root, Sweep)
    problems += _wanting(root)
    if sweep is None or problems:
        return None, in_file_order(problems)
    study, problems = _study(sweep, shown, catalog)
    if any(problem.severity == "error" for problem in problems):
        return None, problems
    scene = os.path.join(os.path.dirname(shown), sweep.scene) if study is None else study.scene_path
    found = SweepFile(sweep, shown, scene, places, study)
    problems += contradictions(found)
    if not any(problem.severity == "error" for problem in problems):
        problems += scenes(found, catalog)
    return found, in_file_order(problems)


def _study(sweep: Sweep, shown: str, catalog: Catalog) -> tuple[StudyFile | None, list[Problem]]:
    if not sweep.study:
        return None, []
    return read_study(os.path.join(os.path.dirname(shown), sweep.study), catalog)


def _wanting(root: Node) -> Iterator[Problem]:
    version = root.attributes.get("version")
    if version is not None and version.value != VERSION:
        sentence = f"the file is written for sweep format {version.value[:40]}, this program reads {VERSION}"
        yield Problem("bad-version", sentence, version.place, f'write version="{VERSION}"')
    if not any(node.tag == "collect" for node in root.children):
        advice = 'write <collect><report name="..." key="..."/></collect>'
        yield Problem("missing-element", "<sweep> needs the element <collect>", root.place, advice)
