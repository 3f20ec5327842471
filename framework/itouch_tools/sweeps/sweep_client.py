"""The client of a sweep: hands out missing runs, writes the rows that come back, and survives lost engines."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from itouch import platforms
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_tools.sweeps.engines import Engine, EngineLostError, NoEngineError, Task
from itouch_tools.sweeps.run_plan import Plan
from itouch_tools.sweeps.sweep_progress import Progress
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import Store, rows
from itouch_tools.sweeps.sweepfile import SweepFile
from itouch_tools.sweeps.work import Work, work_of
from itouch_tools.sweeps.worker import Done, work_on

#: Seconds of work that a task should take, and most runs in a task.
TASK, MOST_TASK = 4.0, 1000
#: Seconds between two checks while no row comes, and how long [s] to wait for a lost scheduler to return.
LOOK, RETURNS = 0.2, 120.0
#: The sweep ends after this many losses of the engine in succession, without a row between them.
LOSSES = 5

Told = Callable[[Progress], None]


class SweepError(ItouchError):
    """A sweep that cannot go on; a later one can go on in its folder."""


@dataclass(frozen=True, slots=True)
class Swept:
    """How a sweep ended: rows in the folder, runs of the plan, rows by status, and why it ended early, if it did."""

    folder: Path
    rows: int
    runs: int
    counts: dict[str, int]
    ended_by: str
    retries: int
    losses: int

    @property
    def whole(self) -> bool:
        """Whether every run has its row."""
        return self.rows >= self.runs


class TaskPool(Protocol):
    """A pool that hands tasks to workers, ``count`` of them at once."""

    @property
    def count(self) -> int:
        """How many tasks run at once."""
        ...

    @property
    def alive(self) -> bool:
        """Whether the engine still exists, as far as is known."""
        ...

    def results(self, tasks: Iterator[Task]) -> Iterator[Any]:
        """Yield what tasks return, in any order."""
        ...


class SweepEngine(Protocol):
    """An engine as the client sees it."""

    @property
    def name(self) -> str:
        """The engine's name."""
        ...

    def working(self) -> AbstractContextManager[TaskPool]:
        """Return a context with the pool in which tasks are done."""
        ...


class Client:
    """Runs one sweep into one folder."""

    def __init__(self, file: SweepFile, folder: Path, engine: SweepEngine, catalog: Catalog, told: Told | None) -> None:
        self._file, self._engine, self._told = file, engine, told
        self._work: Work = work_of(file, catalog)
        self._plan: Plan = file.plan(self._work.digest)
        self._store = Store.open(folder, file, self._work)
        self._progress = Progress(len(self._plan), len(self._store), file.sweep.stop)
        self._ending, self._next, self._keys = "", 0, 0
        self._flight: dict[int, list[int]] = {}
        self._again: list[list[int]] = []
        self._cost = (0, 0.0)
        self._pool = 1

    def sweep(self) -> Swept:
        """Run the missing runs; return how the sweep ended.

        Raises
        ------
        SweepError
            If a worker is refused, or the engine is lost for good.
        StoreError
            If the folder cannot be written.
        """
        if self._file.sweep.stop.enough or self._file.sweep.stop.failures:
            names = ["status", *(one.result for one in self._file.sweep.stop.enough)]
            for row in rows(self._store.folder, names):
                self._progress.add(row, before=True)
        try:
            with platforms.answering(dict.fromkeys((signal.SIGINT, signal.SIGTERM), self._asked)):
                self._go()
            self._store.flush()
        except KeyboardInterrupt:
            self._ending = "interrupted"
            self._store.flush()
        finally:
            self._store.close()
            _end_workers(self._engine)
        return self._swept()

    def _swept(self) -> Swept:
        counts = dict(sorted(self._store.counts.items()))
        progress = self._progress
        return Swept(
            self._store.folder, len(self._store), len(self._plan), counts, self._ending, progress.retries,
            progress.losses,
        )  # fmt: skip

    def _go(self) -> None:
        lost, mark = 0, len(self._store)
        while True:
            try:
                with self._engine.working() as pool:
                    self._pool = pool.count
                    self._pour(pool)
                return
            except EngineLostError as error:
                lost = 1 if len(self._store) > mark else lost + 1
                mark = len(self._store)
                self._lose(error, lost)
            except NoEngineError as error:
                if not self._progress.losses:
                    raise
                self._lose(error, lost)

    def _lose(self, error: ItouchError, lost: int) -> None:
        """Take back the tasks that were lost with the engine, and wait until there is an engine again.

        Raises
        ------
        SweepError
            If the engine is lost for good.
        """
        self._progress.losses += 1
        self._again += [self._flight[key] for key in sorted(self._flight, reverse=True)]
        self._flight.clear()
        self._store.flush()
        if self._ending:
            return
        if lost >= LOSSES or isinstance(error, NoEngineError):
            raise SweepError(f"the engine is lost: {error}; {len(self._store)} of {len(self._plan)} rows are kept, and "
                             "the same command goes on from them") from error  # fmt: skip
        if self._engine.name == "dask":
            self._await_scheduler()

    def _await_scheduler(self) -> None:
        end = time.monotonic() + RETURNS
        while time.monotonic() < end and not self._ending:
            with contextlib.suppress(NoEngineError), self._engine.working():
                return
            time.sleep(1.0)

    def _pour(self, pool: TaskPool) -> None:
        """Hand out tasks, and take the rows that come back.

        Raises
        ------
        EngineLostError
            If tasks did not come back.
        """
        found: queue.Queue[Done | BaseException | None] = queue.Queue(2 * pool.count + 8)
        feeder = threading.Thread(target=_feed, args=(pool, self._tasks(), found), daemon=True, name="sweep")
        feeder.start()
        while True:
            try:
                one = found.get(timeout=LOOK)
            except queue.Empty:
                self._look(pool)
                continue
            if one is None:
                feeder.join()
                break
            if isinstance(one, BaseException):
                raise one
            self._take(one)
            self._look(pool)
        if self._flight:
            raise EngineLostError(f"{len(self._flight)} tasks did not come back")

    def _look(self, pool: TaskPool) -> None:
        if self._store.due:
            self._store.flush()
        if not self._ending:
            self._ending = self._progress.ended_by()
        if self._told is not None:
            self._told(self._progress)
        if not pool.alive:
            raise EngineLostError("the scheduler is gone")

    def _take(self, done: Done) -> None:
        numbers = self._flight.pop(done.key, None)
        if numbers is None:
            return  # a task that was taken back before
        if done.refused:
            self._store.flush()
            raise SweepError(f"{done.refused}: refused, because its rows would not be comparable")
        self._progress.retries += done.retries
        for number, row in zip(numbers, done.rows, strict=True):
            self._store.add(number, row)
            self._progress.add(row)
        count, seconds = self._cost
        keep = 0.5 if count > 200 else 1.0
        self._cost = (round(count * keep) + len(done.rows), seconds * keep + sum(done.seconds))

    def _tasks(self) -> Iterator[Task]:
        while not self._ending:
            numbers = self._again.pop() if self._again else self._more()
            if not numbers:
                return
            self._keys += 1
            self._flight[self._keys] = numbers
            yield work_on, (self._work, [self._plan.run(number) for number in numbers], self._keys)

    def _more(self) -> list[int]:
        """Return the numbers of the next missing runs: about ``TASK`` seconds of work."""
        count, seconds = self._cost
        size = 1 if not count else max(1, min(MOST_TASK, round(TASK * count / max(seconds, 1e-6))))
        size = min(size, max(1, (len(self._plan) - self._next) // (2 * self._pool)))
        numbers: list[int] = []
        while self._next < len(self._plan) and len(numbers) < size:
            if not self._store.has(self._plan.run(self._next).digest):
                numbers.append(self._next)
            self._next += 1
        return numbers

    def _asked(self, number: int, frame: FrameType | None) -> None:
        """Note that a signal asks the sweep to end.

        Raises
        ------
        KeyboardInterrupt
            If it is ending already.
        """
        if self._ending:
            raise KeyboardInterrupt
        self._ending = "interrupted"


def _feed(pool: TaskPool, tasks: Iterator[Task], found: queue.Queue[Done | BaseException | None]) -> None:
    try:
        for one in pool.results(tasks):
            found.put(one if isinstance(one, Done) else EngineLostError(f"a task came back as {type(one).__name__}"))
        found.put(None)
    except BaseException as error:  # raised again where the result is waited for
        found.put(error)


def _end_workers(engine: SweepEngine) -> None:
    if engine.name != "processes":
        return
    from joblib.externals.loky import reusable_executor

    executor = reusable_executor._executor  # noqa: SLF001  # there is no other way to ask whether there is one
    if executor is not None:
        executor.shutdown(wait=True, kill_workers=True)


def sweep(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    engine: str = "processes",
    scheduler: str = "",
    workers: int | None = None,
    told: Told | None = None,
    catalog: Catalog | None = None,
) -> Swept:
    """Run a sweep into a folder; runs whose rows are there already are not run again.

    Parameters
    ----------
    path
        The sweep's file.
    folder
        The folder of its rows, a Parquet data set in ``runs``; made if it is missing.
    engine
        ``processes`` of this machine, ``dask``, or ``ray``.
    scheduler
        Address of Dask's scheduler.
    workers
        Number of processes; default: one per core.
    told
        Called now and then with the `Progress`.
    catalog
        The plugins; default: those of this environment.

    Raises
    ------
    SceneError
        With all problems of sweep and scene.
    ItouchError
        If there is no such engine, the folder holds something else or cannot be written, or a worker is refused.
    """
    plugins = catalog or Catalog()
    chosen = Engine(engine, scheduler, workers)
    return Client(load_sweep(path, plugins), Path(folder), chosen, plugins, told).sweep()
