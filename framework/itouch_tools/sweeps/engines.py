"""Where tasks are done, through joblib: processes here, a Dask cluster, or Ray; there is no scheduler of our own."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from itouch.platforms import cores
from itouch.schema import ItouchError

ENGINES = ("processes", "dask", "ray")
#: The package that each engine needs, and what to install to get it.
_NEEDS = {
    "processes": ("joblib", "itouch-py[sweep]"),
    "dask": ("distributed", "itouch-py[cluster]"),
    "ray": ("ray", "ray"),
}
#: Seconds within which a scheduler must answer, and a first worker must be there.
ANSWERS, WORKERS = 30.0, 60.0

Task = tuple[Callable[..., Any], tuple[Any, ...]]


class EngineLostError(ItouchError):
    """The engine has lost workers or its scheduler: runs whose rows did not come back are run again."""


class NoEngineError(ItouchError):
    """An engine that does not exist, is not installed, or does not answer."""


@dataclass(frozen=True, slots=True)
class Engine:
    """Which engine to use: its name, its scheduler's address if it has one, and the number of workers if chosen."""

    name: str = "processes"
    scheduler: str = ""
    workers: int | None = None

    def __post_init__(self) -> None:
        from importlib.util import find_spec

        if self.name not in ENGINES:
            raise NoEngineError(f"there is no engine '{self.name}'; there are {', '.join(ENGINES)}")
        module, package = _NEEDS[self.name]
        if find_spec(module) is None:
            raise NoEngineError(f"the engine '{self.name}' needs {module}: pip install '{package}'")
        if self.name == "dask" and not self.scheduler:
            raise NoEngineError("the engine 'dask' needs its scheduler: --scheduler tcp://HOST:8786")
        if self.name == "processes" and self.scheduler:
            raise NoEngineError("--scheduler is that of --engine dask")

    @contextlib.contextmanager
    def working(self) -> Iterator[Pool]:
        """Return a context with the pool in which tasks are done.

        Raises
        ------
        NoEngineError
            If the scheduler does not answer, or has no worker.
        """
        if self.name == "processes":
            yield Pool("loky", self.workers or cores(), {})
        elif self.name == "dask":
            with _dask(self.scheduler) as (client, count):
                yield Pool("dask", count, {"client": client, "wait_for_workers_timeout": WORKERS}, client)
        else:
            from ray.util.joblib import register_ray

            register_ray()
            yield Pool("ray", self.workers or cores(), {}, generates=False)


def _hush() -> None:
    """Keep Dask's client from printing tracebacks of errors that the sweep reports in a sentence."""
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextlib.contextmanager
def _dask(address: str) -> Iterator[tuple[Any, int]]:
    import distributed

    connect: Any = distributed.Client
    _hush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # versions of packages that no run uses may differ
        try:
            client = connect(address, timeout=ANSWERS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise NoEngineError(f"no scheduler answers at {address}: {error}") from None
    try:
        try:
            client.wait_for_workers(1, timeout=WORKERS)
        except Exception as error:
            raise NoEngineError(f"the scheduler at {address} has no worker: {error}") from None
        yield client, max(1, sum(client.ncores().values()))
    finally:
        with contextlib.suppress(Exception):  # a scheduler that is gone cannot say goodbye
            client.close(timeout=2.0)


@dataclass(frozen=True, slots=True)
class Pool:
    """Workers of an engine: joblib's backend, the number of tasks at once, and the backend's options (``told``)."""

    backend: str
    count: int
    told: dict[str, Any]
    client: Any = None
    generates: bool = True

    @property
    def alive(self) -> bool:
        """Whether the scheduler is there, as far as this process knows."""
        return self.client is None or self.client.status == "running"

    def results(self, tasks: Iterator[Task]) -> Iterator[Any]:
        """Yield what tasks return, in any order; they are taken from the iterator as workers become free.

        Raises
        ------
        EngineLostError
            If the engine breaks; an exception of a task itself cannot be distinguished from that.
        """
        try:
            yield from self._results(tasks)
        except (GeneratorExit, KeyboardInterrupt):
            raise
        except Exception as error:
            told = (str(error).strip().splitlines() or [""])[0]
            raise EngineLostError(f"{type(error).__name__}: {told[:300]}") from error

    def _results(self, tasks: Iterator[Task]) -> Iterator[Any]:
        from joblib import Parallel, delayed, parallel_config

        ahead = self.count + (self.count + 1) // 2
        with parallel_config(backend=self.backend, n_jobs=self.count, **self.told):
            if self.generates:
                parallel = Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch=ahead)
                yield from parallel(delayed(function)(*words) for function, words in tasks)
                return
            while wave := [task for _, task in zip(range(4 * self.count), tasks, strict=False)]:
                yield from Parallel(batch_size=1)(delayed(function)(*words) for function, words in wave)
