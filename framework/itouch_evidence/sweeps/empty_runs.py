"""Runs that take no time: what the client alone costs, or the client with an engine and its scheduler."""

from __future__ import annotations

import contextlib
import hashlib
import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from itouch.plugin.discovery import Catalog
from itouch_tools.sweeps.engines import Engine, Pool, Task
from itouch_tools.sweeps.provenance import cpu_model
from itouch_tools.sweeps.run_plan import Run
from itouch_tools.sweeps.sweep_client import Client
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import paths_of
from itouch_tools.sweeps.worker import Done


class InstantPool:
    """A pool that answers every task at once, with invented rows of the right shape."""

    name, count, alive = "instant", 1, True

    @contextlib.contextmanager
    def working(self) -> Iterator[InstantPool]:
        """Yield this pool."""
        yield self

    def results(self, tasks: Iterator[Task]) -> Iterator[Done]:
        """Yield the answer to each task."""
        for _, (_, runs, key) in tasks:
            yield answered(runs, key)


def answered(runs: Sequence[Run], key: int) -> Done:
    """Return the answer to a task, without running it; called here or in a worker of an engine."""
    return Done([_row(run) for run in runs], [0.01] * len(runs), key=key)


class TimelessEngine:
    """An engine that hands out the tasks as usual, to workers that answer at once."""

    def __init__(self, engine: Engine) -> None:
        self._engine, self.name = engine, engine.name

    @contextlib.contextmanager
    def working(self) -> Iterator[_TimelessPool]:
        """Yield a pool of the engine, whose workers answer at once."""
        with self._engine.working() as pool:
            yield _TimelessPool(pool)


class _TimelessPool:
    def __init__(self, pool: Pool) -> None:
        self._pool, self.count = pool, pool.count

    @property
    def alive(self) -> bool:
        return self._pool.alive

    def results(self, tasks: Iterator[Task]) -> Iterator[Any]:
        yield from self._pool.results((answered, (runs, key)) for _, (_, runs, key) in tasks)


def _row(run: Run) -> dict[str, Any]:
    state = hashlib.sha256(run.digest.encode()).hexdigest()
    row: dict[str, Any] = {**run.values, "seed": run.seed, "digest": run.digest, "cpu": cpu_model(), "state": state}
    return row | {"sets": json.dumps(run.sets), "status": "done", "reason": "", "simulated_s": 8.0}


def client_alone(sweep: Path) -> dict[str, float]:
    """Return the figures of a client for all runs of a sweep that take no time.

    Rows a second, number of files, bytes of a row, seconds to open the folder again, and by how much the peak memory
    of this process grew [MiB].
    """
    catalog = Catalog()
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        folder, engine = Path(inner) / "rows", InstantPool()
        client = Client(load_sweep(sweep, catalog), folder, engine, catalog, None)
        before = _memory()
        begin = time.perf_counter()
        done = client.sweep()
        if done.ended_by:
            raise KeyboardInterrupt  # as in `backends.by_sweep`
        spent = time.perf_counter() - begin
        grown = _memory() - before
        files = paths_of(folder)
        size = sum(path.stat().st_size for path in files)
        begin = time.perf_counter()
        again = Client(load_sweep(sweep, catalog), folder, engine, catalog, None).sweep()
        if not (done.whole and again.rows == done.rows):
            raise RuntimeError(f"{done.runs} runs have {again.rows} rows")
        opened = time.perf_counter() - begin
    return {"runs": done.runs, "rows_per_s": done.rows / spent, "files": len(files), "bytes_a_row": size / done.rows,
            "open_again_s": opened, "memory_MiB": grown}  # fmt: skip


def _memory() -> float:
    """Return the peak memory of this process so far [MiB]."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
