"""A study with simulated observers: the same trials on the twins, answered by models of people.

The models are told what the twin's finger felt.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from itouch import process_exit
from itouch.plugin.discovery import Catalog
from itouch.schema import SceneError
from itouch.schema.terminal import number_of
from itouch.session.session_error import SessionError
from itouch_tools.study import orders
from itouch_tools.study.observer_catalog import observer_of
from itouch_tools.study.observers import Felt, Person
from itouch_tools.study.plugin_tasks import TaskError, task_of
from itouch_tools.study.progression import Course, NextTrial
from itouch_tools.study.reading import StudyFile, load_study
from itouch_tools.study.study_elements import TASKS
from itouch_tools.study.study_store import SIMULATED, Row, Store, StoreError
from itouch_tools.study.tasks import is_right, taken_answer
from itouch_tools.study.touches import TouchRunner, figures
from itouch_tools.study.trials import Trial


@dataclass(frozen=True, slots=True)
class Panel:
    """The simulated participants: their number, the model, and whether their fingers differ in temperature."""

    observers: int
    model: str = "flux"
    skin: bool = True

    def codes(self) -> list[str]:
        """Return the participants' codes."""
        return [f"S{number:03d}" for number in range(1, self.observers + 1)]


@dataclass(frozen=True, slots=True)
class Made:
    """The result of simulating a participant: the number of new trials, and of the void ones by reason."""

    code: str
    trials: int
    void: Counter[str]

    def __str__(self) -> str:
        told = f"{self.code}: {number_of(self.trials, 'new trial')}"
        if self.void:
            reasons = ", ".join(f"{reason} ({count})" for reason, count in self.void.most_common())
            told += f", {self.void.total()} void: {reasons}"
        return told


class Simulation:
    """One simulated observer in a study.  Its answers depend on earlier rows only through staircases."""

    def __init__(self, file: StudyFile, code: str, panel: Panel, catalog: Catalog) -> None:
        self._file, self._code, self._study = file, code, file.study
        levels = self._levels()
        person = Person.drawn(self._rng("person"), biased=panel.model == "naive", answers=levels)
        self.observer = observer_of(panel.model)(person)
        skin = person.finger_temperature if panel.skin else None
        self._touch_runner = TouchRunner(file, catalog, skin_temperature=skin)
        self._known: dict[str, dict[str, Felt]] = {}
        #: The session's name in the rows: it says who answered.
        self.session = f"{SIMULATED}-{panel.model}{'' if panel.skin else '-same-skin'}"

    def _rng(self, *purpose: str) -> np.random.Generator:
        return orders.generator(self._study.seed, self._code, *purpose)

    def _levels(self) -> tuple[str, ...]:
        asked = self._study.task.factor
        return next((factor.names for factor in self._study.factors if factor.name == asked), ())

    def rows(self, done: Sequence[Row]) -> Iterator[Row]:
        """Yield the rows of the trials that are missing after those of ``done``, one by one."""
        course = Course(self._file, self._code, done)
        while (due := course.next()) is not None:
            row = self._trial(due, course.rows)
            course.made(row)
            yield row

    def _trial(self, due: NextTrial, rows: Sequence[Row]) -> Row:
        trial, place = due.trial, due.place
        seeds = self._rng("touch", str(place)).integers(2**31, size=len(due.shown))
        touches = [
            self._touch_runner.touch(condition, int(seed)) for condition, seed in zip(due.shown, seeds, strict=True)
        ]
        void = next((touch.void for touch in touches if touch.void), "")
        rng = self._rng("answer", str(place))
        answer, right = ("", None) if void else self._answer(trial, [touch.felt for touch in touches], rng)
        begun = rows[-1].ended_s if rows else 0.0
        lasted = sum(len(touch.felt.flux) * touch.felt.period for touch in touches)
        return Row(
            self._code, place, trial.block, self._study.task.kind, trial.condition, list(due.shown), begun,
            round(begun + lasted, 6), self.session, "", repeats=due.repeats, staircase=trial.staircase or None,
            level=due.level, answer=None if void else answer, right=right, void=void,
            felt=[figures(touch) for touch in touches],
        )  # fmt: skip

    def _answer(self, trial: Trial, felt: list[Felt], rng: np.random.Generator) -> tuple[str, int | None]:
        task = self._study.task
        if task.kind not in TASKS:
            answer = self._taken(task_of(task.kind).simulated(self.observer, felt, rng))
        elif task.kind == "identify":
            answer = self.observer.identify(felt[0], self._prototypes(trial.condition), rng)
        elif task.kind == "colder":
            answer = str(self.observer.colder(felt, rng))
        elif task.kind == "odd":
            answer = str(self.observer.odd(felt, rng))
        elif task.kind == "same":
            answer = "same" if self.observer.same(felt, rng) else "different"
        else:
            answer = f"{self.observer.coldness(felt[0], rng):.4f}"
        return answer, is_right(task, trial, answer, [one.mean_flux() for one in felt])

    def _taken(self, said: str) -> str:
        """Return a plugin's answer in the form in which it is kept."""
        found = taken_answer(self._study, said)
        if found is None:
            raise TaskError(
                f"{task_of(self._study.task.kind).whose}: simulated gave '{said}', which is not one of the choices"
            )
        return found

    def _prototypes(self, condition: Mapping[str, str]) -> dict[str, Felt]:
        """Return what each level feels like, as learnt before the study, with the other factors as in ``condition``."""
        asked = self._study.task.factor
        others = {name: level for name, level in condition.items() if name != asked}
        key = repr(sorted(others.items()))
        if key not in self._known:
            self._known[key] = {
                level: self._touch_runner.touch({**condition, asked: level}, 0).felt for level in self._levels()
            }
        return self._known[key]


def _simulate_one(work: tuple[str, str, Panel, str]) -> Made:
    path, folder, panel, code = work
    catalog = Catalog()
    file = load_study(path, catalog)
    count, void = 0, Counter[str]()
    with Store.open(Path(folder)) as store:
        simulation, done = Simulation(file, code, panel, catalog), store.rows(code)
        others = [session for session in store.sessions() if session != simulation.session]
        if others:
            raise StoreError(
                f"{folder} holds trials of {others[0]}, these would be of {simulation.session}: another folder"
            )
        for row in simulation.rows(done):
            store.add(row)
            count += 1
            if row.void:
                void[row.void] += 1
    return Made(code, count, void)


def _end_with(parent: Connection) -> None:
    """End this process when the other end of a pipe is closed: with its parent, however that ends, or when it says so.

    Otherwise it would go on to write trials for as long as its participant has some.
    """

    def wait() -> None:
        with contextlib.suppress(OSError, EOFError):
            parent.poll(None)
        process_exit.end_now(1)  # each trial is committed whole

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the parent has it, too
    threading.Thread(target=wait, name="itouch-parent", daemon=True).start()


def simulate(path: str, folder: Path, panel: Panel, *, processes: int = 1) -> Iterator[Made]:
    """Simulate a panel into a study's folder, or go on where it stopped; yield the result of each participant.

    The rows depend only on study, panel and seed, not on the number of processes.

    Raises
    ------
    SceneError
        If study or scene have problems.
    StoreError
        If the folder holds another study, or cannot be written.
    ObserverError
        If there is no such observer.
    SessionError
        If a process ends before its participant is done; rows that were written stay.
    """
    observer_of(panel.model)
    work = [(path, str(folder), panel, code) for code in panel.codes()]
    if processes <= 1:
        yield from map(_simulate_one, work)
        return
    # not multiprocessing's own Pool, which would wait for ever for a worker that was killed
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    many = min(processes, len(work))
    with theirs, ours, ProcessPoolExecutor(
        many, mp_context=context, initializer=_end_with, initargs=(theirs,)
    ) as pool:  # fmt: skip
        try:
            yield from pool.map(_simulate_one, work)
        except BaseException as error:
            ours.close()  # nobody waits for their rows any more
            if not isinstance(error, BrokenProcessPool):
                raise
            raise SessionError(
                "one of the processes that simulate was killed, or ended by itself, before it was done; what was made "
                "is kept, and the same command goes on from there (with less memory for each: fewer --processes)"
            ) from error


__all__ = ["Made", "Panel", "SceneError", "Simulation", "simulate"]
