"""Compares the same sessions run by hand, by a sweep in one process, in one process a core, and by Dask."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from itouch.platforms import cores
from itouch_evidence.bench_batch import computed
from itouch_tools.sweeps.sweep_client import sweep
from itouch_tools.sweeps.sweep_store import paths_of

SWEEP = """<sweep version="1.0" name="bench" scene="{scene}">
  <seeds count="{count}"/>
  {rule}
  <collect><report name="contacts" key="contacts[*].peak_force_N" reduce="count"/></collect>
</sweep>
"""
#: Least ratio of the gain by one process a core to that of plain loops, and of Dask's rate to that of processes.
SHARE = 0.9
#: Iterations of a plain compute loop: about a second of work.
LOOP = 10_000_000


@dataclass(slots=True)
class Rate:
    """How many sessions ended in how many seconds after the first; ``whole`` and ``whole_s`` include start and end."""

    sessions: float = 0.0
    seconds: float = 0.0
    whole: float = 0.0
    whole_s: float = 0.0

    @property
    def per_s(self) -> float:
        """Sessions a second."""
        return self.sessions / self.seconds if self.seconds > 0.0 else float("nan")

    def add(self, other: Rate) -> None:
        """Add the sessions and seconds of another round."""
        self.sessions += other.sessions
        self.seconds += other.seconds
        self.whole += other.whole
        self.whole_s += other.whole_s


@dataclass(slots=True)
class Measured:
    """Rates of all ways in one measurement, and of plain loops in one process (``one``) and in one a core (``all``)."""

    scene: str
    cores: int
    rounds: int = 0
    ways: dict[str, Rate] = field(default_factory=dict)
    loops: dict[str, Rate] = field(default_factory=dict)

    @property
    def gain(self) -> float:
        """Rate of the sweep in one process a core, as a multiple of that in one process."""
        return self.ways["processes"].per_s / self.ways["one process"].per_s

    @property
    def plain(self) -> float:
        """The same multiple for plain compute loops."""
        return self.loops["all"].per_s / self.loops["one"].per_s

    @property
    def share(self) -> float:
        """Gain of the sweep as a fraction of that of plain loops."""
        return self.gain / self.plain

    @property
    def dask(self) -> float | None:
        """Rate of Dask as a fraction of that of processes; None if it was not measured."""
        found = self.ways.get("Dask")
        return None if found is None else found.per_s / self.ways["processes"].per_s

    def bounds(self) -> list[tuple[str, float]]:
        """Return the name and value of each figure that must be `SHARE` at least."""
        found = [(f"share of the gain of {self.cores} plain loops", self.share)]
        return found if self.dask is None else [*found, ("rate of Dask beside that of processes", self.dask)]


def by_hand(scene: Path, count: int, seconds: float | None) -> Rate:
    """Run the sessions in a plain loop, as one would write it."""
    import itouch

    itouch.build(scene, seed=0).close()  # compile before the time is taken
    begin = time.perf_counter()
    for seed in range(count):
        session = itouch.build(scene, seed=seed)
        session.run(seconds)
        session.report()
        session.close()
    spent = time.perf_counter() - begin
    return Rate(count, spent, count, spent)


def written(folder: Path, scene: Path, count: int, seconds: float | None) -> Path:
    """Write a sweep of a scene over ``count`` seeds, and return its path."""
    file = folder / "bench.xml"
    rule = "" if seconds is None else f'<run for="{seconds} s"/>'
    file.write_text(SWEEP.format(scene=os.path.relpath(scene, folder), count=count, rule=rule), encoding="utf-8")
    return file


def by_sweep(scene: Path, count: int, seconds: float | None, **engine: Any) -> tuple[Rate, float]:
    """Run a sweep; return its rate and the mean size of a row [bytes].

    Raises
    ------
    KeyboardInterrupt
        If a signal has ended it: a sweep returns in order then, and its rate would be that of another one.
    """
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        file, rows = written(Path(inner), scene, count, seconds), Path(inner) / "rows"
        marks: list[tuple[float, int]] = []
        begin = time.perf_counter()
        swept = sweep(file, rows, told=lambda p: marks.append((time.perf_counter(), p.done)), **engine)
        if swept.ended_by:
            raise KeyboardInterrupt
        whole = time.perf_counter() - begin
        size = sum(path.stat().st_size for path in paths_of(rows))
    between, spent = steady(marks)
    return Rate(between, spent, count, whole), size / count


def steady(marks: Sequence[tuple[float, int]]) -> tuple[int, float]:
    """Return how many rows came after the first ones until the last, and in how many seconds."""
    seen = [mark for mark in marks if mark[1] > 0]
    if not seen or seen[-1][1] <= seen[0][1]:
        return 0, float("nan")
    last = next(mark for mark in seen if mark[1] == seen[-1][1])
    return last[1] - seen[0][1], max(last[0] - seen[0][0], 1e-9)


@dataclass(frozen=True, slots=True)
class Cluster:
    """A Dask cluster on this machine: the address of its scheduler, and the processes of scheduler and workers."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: tuple[subprocess.Popen[bytes], ...]


@contextlib.contextmanager
def dask_cluster(workers: int, address: str = "") -> Iterator[Cluster]:
    """Start a scheduler, at ``address`` if one is given, and ``workers`` workers here, by Dask's own commands."""
    if not address:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    dask = [sys.executable, "-m", "dask"]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen([*dask, "scheduler", "--host", address, "--no-dashboard"], **quiet)
    begun = [scheduler]
    try:
        for _ in range(workers):
            words = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard"]
            begun.append(subprocess.Popen(words, **quiet))
        yield Cluster(address, scheduler, tuple(begun[1:]))
    finally:
        for one in reversed(begun):
            one.terminate()
        for one in begun:
            with contextlib.suppress(subprocess.TimeoutExpired):
                one.wait(10.0)
            one.kill()


def loops(workers: int, turns: int = LOOP) -> Rate:
    """Return the rate of plain compute loops in ``workers`` processes."""
    return Rate(workers, workers / computed(workers, turns))


def measure(scene: Path, sessions: int, seconds: float | None, *, dask: bool, rounds: int = 2) -> Measured:
    """Measure all ways, round by round; plain loops run before and after the ways that are compared with them.

    Parameters
    ----------
    scene
        A scene that runs on twins.
    sessions
        Sessions of each process and round; by hand a quarter of them.
    seconds
        Simulated time of each session; None: the whole motion.
    dask
        Whether Dask is measured, too, on a cluster here.
    rounds
        How often everything is measured; sessions and seconds are summed.
    """
    count = cores()
    found = Measured(scene.name, count)

    def note(where: dict[str, Rate], name: str, rate: Rate) -> None:
        where.setdefault(name, Rate()).add(rate)

    for _ in range(rounds):
        note(found.ways, "by hand", by_hand(scene, max(2, sessions // 4), seconds))
        note(found.loops, "one", loops(1))
        note(found.ways, "one process", by_sweep(scene, sessions, seconds, workers=1)[0])
        note(found.loops, "one", loops(1))
        note(found.loops, "all", loops(count))
        note(found.ways, "processes", by_sweep(scene, sessions * count, seconds, workers=count)[0])
        note(found.loops, "all", loops(count))
        if dask:
            with dask_cluster(count) as cluster:
                engine = {"engine": "dask", "scheduler": cluster.address}
                note(found.ways, "Dask", by_sweep(scene, sessions * count, seconds, **engine)[0])
        found.rounds += 1
    return found


def shown(found: Measured) -> list[str]:
    """Return the lines of a measurement: the rate of each way, and each figure that has a bound."""
    lines = [f"{found.scene}, {found.rounds} rounds, sessions a second (between the first row and the last):"]
    for name, rate in found.ways.items():
        whole = f"; {rate.whole / rate.whole_s:.3f} with start and end" if rate.whole_s > rate.seconds else ""
        lines.append(f"  {name:<12} {rate.per_s:8.3f}   {rate.sessions:.0f} in {rate.seconds:.1f} s{whole}")
    lines.append(f"  gain of {found.cores} processes {found.gain:.2f}, of {found.cores} plain compute loops "
                 f"{found.plain:.2f}")  # fmt: skip
    for name, value in found.bounds():
        lines.append(f"  {name}: {value:.2f}, bound {SHARE:g} or more{'' if value >= SHARE else ': NOT KEPT'}")
    return lines


def plain(found: Measured) -> Mapping[str, Any]:
    """Return a measurement as printed in JSON."""
    rates = {name: {"per_s": rate.per_s, "sessions": rate.sessions, "seconds": rate.seconds}
             for name, rate in found.ways.items()}  # fmt: skip
    return {"scene": found.scene, "cores": found.cores, "rounds": found.rounds, "sessions": rates, "gain": found.gain,
            "gain of plain loops": found.plain, **dict(found.bounds())}  # fmt: skip
