"""Runs one run after the other in this process; each scene is built once, each run becomes a row."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import traceback
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from itouch.plugin.discovery import Catalog
from itouch.scene import bundled_scenes
from itouch.scene.documents import contents
from itouch.scene.edits import Edit
from itouch.scene.loader import read_scene
from itouch.scene.source import Attribute
from itouch.schema import SceneError
from itouch.schema.diagnostics import Place
from itouch.session import Session
from itouch.session.batch import Job
from itouch.session.building import choose_twins
from itouch.world import Model
from itouch_tools.sweeps.collecting import Collector, ending
from itouch_tools.sweeps.provenance import cpu_model
from itouch_tools.sweeps.run_plan import Run, Setting
from itouch_tools.sweeps.work import Work

#: Number of compiled scenes that a worker keeps: those that were used last.
KEPT = 4

Row = dict[str, Any]


class MachineError(Exception):
    """A run that failed because of the machine: it is tried again."""


class Running:
    """Runs what a worker is given, in this process; ``folder`` holds the scene, functions and plugins.

    Raises
    ------
    ValueError
        If a file lies outside its folder, or this program brings other scenes than the one that gave the work.
    """

    def __init__(self, work: Work, folder: Path) -> None:
        self.work, self._folder = work, folder
        scene = folder / "scene"
        _write(scene, {name: data for name, data in work.files.items() if not name.startswith(bundled_scenes.SCHEME)})
        _same_as_shipped(contents(scene / work.scene), work.files)
        _write(folder / "functions", work.functions)
        _offer(work, folder / "plugins")
        self._catalog = Catalog()
        self._collector = Collector(work.collect, folder / "functions")
        self._until = ending(work.rule)
        self._jobs: OrderedDict[tuple[Setting, ...], Job | str] = OrderedDict()

    def model(self, sets: tuple[Setting, ...]) -> Model:
        """Return the compiled scene of a run.

        Raises
        ------
        SceneError
            If the scene cannot be compiled.
        """
        path = str(self._folder / "scene" / self.work.scene)
        edits = [Edit(where, Attribute(value, Place("sweep", 1, 1))) for where, value in sets]
        scene, problems = read_scene(path, self._catalog, edits=edits)
        errors = [problem for problem in problems if problem.severity == "error"]
        if errors:
            raise SceneError(errors)
        return Model.of(choose_twins(scene, "all"), self._catalog)

    def row(self, run: Run) -> Row:
        """Return the row of a run.

        Raises
        ------
        MachineError
            If the machine was at fault, not the run.
        """
        row: Row = {**run.values, "seed": run.seed, "digest": run.digest, "cpu": cpu_model()}
        row |= {"sets": json.dumps(run.sets), "status": "error", "reason": "", "simulated_s": None, "state": ""}
        try:
            job = self._job(run.sets)
            row |= {"status": "scene", "reason": job} if isinstance(job, str) else job.run(run.seed)
        except (OSError, MemoryError) as error:
            raise MachineError(f"{type(error).__name__}: {error}") from error
        except Exception as error:  # a plugin may raise anything: this run's row says so, the others go on
            row["reason"] = f"{type(error).__name__}: {error}"[:400] + _where(error, self._folder / "functions")
        return row

    def report(self, run: Run) -> dict[str, Any]:
        """Return the report of the session of a run; empty if there is none."""
        try:
            return dict(Job(self.model(run.sets), self._catalog, self._until, Session.report).run(run.seed))
        except Exception:  # whatever it is, the run's row says so
            return {}

    def _job(self, sets: tuple[Setting, ...]) -> Job | str:
        job = self._jobs.get(sets)
        if job is None:
            try:
                model = self.model(sets)
                job = Job(model, self._catalog, self._until, self._ended, self._collector.begin)
            except SceneError as error:
                job = "; ".join(problem.sentence for problem in error.problems)[:500]
            self._jobs[sets] = job
            while len(self._jobs) > KEPT:
                self._jobs.popitem(last=False)
        self._jobs.move_to_end(sets)
        return job

    def _ended(self, session: Session) -> Row:
        """Return what the row keeps of a session that has ended."""
        fault = session.fault
        row: Row = {"status": "done" if fault is None else "fault", "reason": "" if fault is None else str(fault)[:500]}
        row["simulated_s"] = session.ticks * session.model.period
        row["state"] = hashlib.sha256(session.state.tobytes()).hexdigest()
        return row | self._collector.collect(session)


def _where(error: Exception, functions: Path) -> str:
    """Return in which line of a function that travels with the sweep an exception arose; empty: in none."""
    frames = [(Path(one.filename), one.lineno) for one in traceback.extract_tb(error.__traceback__)]
    own = [f" ({path.name}:{line})" for path, line in frames if path.is_relative_to(functions)]
    return own[-1] if own else ""


def _same_as_shipped(here: Mapping[str, bytes], wanted: Mapping[str, bytes]) -> None:
    """Refuse work whose scene includes files of the program that are not what they are in this program."""
    for name, data in here.items():
        if name.startswith(bundled_scenes.SCHEME) and wanted.get(name) != data:
            raise ValueError(f"the program's '{name}' is another one here")


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        path = (folder / name).resolve()
        if not path.is_relative_to(folder.resolve()):
            raise ValueError(f"'{name}' lies outside its folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _offer(work: Work, folder: Path) -> None:
    """Make the plugins importable that this environment does not have."""
    from itouch_tools.sweeps.provenance import version_of

    for name, files in work.plugins.items():
        if not version_of(name):
            _write(folder / name, files)
            sys.path.insert(0, os.fspath(folder / name))
