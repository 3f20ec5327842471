"""Many sessions of one model on all cores: each is what it would be alone, bit for bit."""

from __future__ import annotations

import multiprocessing
import operator
import os
from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any, TypeVar

from itouch.loop import DeviceFaultError
from itouch.platforms import cores
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.schema.quantities import checked_time
from itouch.schema.seeds import checked_seed
from itouch.session.building import load_scene
from itouch.session.forks import forked
from itouch.session.session import Session
from itouch.world import Model

Result = TypeVar("Result")
Until = float | Callable[[Session], bool] | None


class Job:
    """What every session of a batch needs; worker processes inherit it when they are forked.

    ``begin`` is called with each session before its first tick.
    """

    def __init__(
        self,
        model: Model,
        catalog: Catalog,
        until: Until,
        collect: Callable[[Session], Any],
        begin: Callable[[Session], None] | None = None,
    ) -> None:
        self._model, self._catalog, self._until, self._collect, self._begin = model, catalog, until, collect, begin

    def run(self, seed: int) -> Any:
        """Run the session with this seed, and return what is collected from it."""
        session = Session(self._model, seed=seed, catalog=self._catalog)
        session.records = False
        if self._begin is not None:
            self._begin(session)
        until = self._until
        try:
            if callable(until):
                session.run(until=lambda: until(session))
            else:
                session.run(until)
        except DeviceFaultError:
            pass  # its devices are safe, `session.fault` says why, and the others go on
        collected = self._collect(session)
        session.close()
        return collected


def report(session: Session) -> dict[str, Any]:
    """Return the report of a session."""
    return session.report()


def batch(
    model: Model | Scene | str | os.PathLike[str],
    *,
    seeds: Iterable[int],
    until: Until = None,
    collect: Callable[[Session], Result] = report,  # type: ignore[assignment]
    workers: int | None = None,
) -> list[Result]:
    """Run a session for each seed, and return what is collected from each, in the order of the seeds.

    The model is compiled once and shared; each session is what ``Session(model, seed=seed)`` would be alone, to the
    last bit, whatever runs beside it.  On systems that can fork, every core runs sessions in a process of its own;
    elsewhere they run in this process, one after the other.  A ``<record>`` in the scene is ignored.

    Parameters
    ----------
    model
        A compiled scene, a scene, or its file; all devices must be twins.
    seeds
        One session each: whole numbers from 0 to 2^63 - 1.
    until
        Seconds to run, or a function of the session that is asked after every tick and ends it; None: until the
        scripted motion has ended.
    collect
        Function of a session that has ended, which returns what to keep of it; called in the process in which it ran,
        so that the result must be picklable.  A session that tripped is collected, too; its ``fault`` says why.
        Default: its report.
    workers
        How many run at once; default: one for each core that this process may use.

    Raises
    ------
    SceneError
        With all problems of the scene.
    ValueError
        If a device is not a twin, a seed or the time is not valid, ``workers`` is below 1, or there is neither a time
        nor a scripted motion.
    TypeError
        If ``seeds``, ``until``, ``collect`` or ``workers`` is not of its kind, or what is collected cannot be passed
        from one process to another.
    SessionError
        If a process ends before its session does: it was killed, or the machine ran out of memory.
    BaseException
        What ``until`` or ``collect`` raises; the other sessions are then ended, too.
    """
    _check(until, collect, workers)
    wanted = _seeds(seeds)
    catalog = Catalog()
    if not isinstance(model, Model):
        model = Model.of(model if isinstance(model, Scene) else load_scene(model, catalog=catalog), catalog)
    hardware = [device.name for device in model.devices.values() if not device.twin]
    if hardware:
        raise ValueError(f"a batch runs on twins; '{hardware[0]}' is real: build the scene with twin='all'")
    job = Job(model, catalog, until, collect)
    count = min(len(wanted), workers or cores())
    if count <= 1 or "fork" not in multiprocessing.get_all_start_methods():
        return [job.run(seed) for seed in wanted]
    Session(model, catalog=catalog).close()  # everything is compiled once, before the processes are forked
    return forked(job.run, wanted, count)


def _check(until: Any, collect: Any, workers: Any) -> None:
    """Raise an error for what would only fail when a session has run, or be taken for something else."""
    if isinstance(until, bool) or not (until is None or callable(until) or isinstance(until, Real)):
        raise TypeError(f"until = {until!r} must be a number of seconds, a function of the session, or None")
    if until is not None and not callable(until):
        checked_time("until", until)
    if not callable(collect):
        raise TypeError(f"collect = {collect!r} must be a function of a session; left out, its report is collected")
    if workers is not None:
        try:
            count = operator.index(workers)
        except TypeError:
            raise TypeError(f"workers = {workers!r} must be a whole number, at least 1") from None
        if count < 1 or isinstance(workers, bool):
            raise ValueError(f"workers = {workers!r} must be a whole number, at least 1")


def _seeds(seeds: Any) -> list[int]:
    """Return the seeds, or raise an error that says how they are given."""
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
        raise TypeError(f"seeds = {seeds!r} must be several whole numbers, as [1, 2, 3] or range(5)")
    return [checked_seed(seed) for seed in seeds]
