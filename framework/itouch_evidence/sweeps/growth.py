"""Compares sweeps of more and more runs with the cost model: how long they take, and whether memory stays bounded.

The parts of the model (`Parts`) are measured by a small sweep of the same runs; then sweeps of more and more of them
run on the real engine, each client in its own process, so that its memory and time can be measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from itouch.platforms import cores
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_evidence.sweeps.backends import Cluster, dask_cluster, loops, written
from itouch_evidence.sweeps.empty_runs import TimelessEngine
from itouch_tools.sweeps.engines import Engine
from itouch_tools.sweeps.sweep_client import Client as Sweeping
from itouch_tools.sweeps.sweep_progress import Progress
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import paths_of

#: Runs of the sweep that measures the parts of the model.
PILOTS = 60
#: Most rows in a file and in a partition (``itouch_tools.sweeps.sweep_store``), and bytes of memory a row for resuming.
FILE, PARTITION, DIGEST = 2000, 10_000, 8


@dataclass(frozen=True, slots=True)
class Parts:
    """The cost model: seconds until the first row, seconds a run in one process, gain of all cores, bytes a row."""

    begin_s: float
    run_s: float
    gain: float
    row_bytes: float

    def seconds(self, runs: int) -> float:
        """Return how long a sweep of ``runs`` runs takes here by the model [s]."""
        return self.begin_s + runs * self.run_s / self.gain


@dataclass(frozen=True, slots=True)
class Client:
    """What a client did: rows, seconds to the first and to its end, CPU time in between, and peak memory."""

    rows: int
    first_s: float
    whole_s: float
    cpu_s: float
    memory_MiB: float  # noqa: N815  # a unit


@dataclass(frozen=True, slots=True)
class SweepCost:
    """A sweep and what the model says of it, with the CPU time and peak memory of the scheduler."""

    runs: int
    client: Client
    model_s: float
    row_bytes: float
    files: int
    scheduler_cpu_s: float
    scheduler_MiB: float  # noqa: N815  # a unit

    @property
    def ratio(self) -> float:
        """The measured time as a multiple of the model's."""
        return self.client.whole_s / self.model_s


def client(file: Path, folder: Path, engine: str, scheduler: str, workers: int, *, timeless: bool = False) -> Client:
    """Run a sweep in this process, which does nothing else; with ``timeless``, its runs take no time."""
    import resource

    begin, first, busy = time.perf_counter(), 0.0, time.process_time()

    def told(progress: Progress) -> None:
        nonlocal first, busy
        if not first and progress.done:
            first, busy = time.perf_counter() - begin, time.process_time()

    plugins, works = Catalog(), Engine(engine, scheduler, workers)
    chosen = TimelessEngine(works) if timeless else works
    ended = Sweeping(load_sweep(file, plugins), folder, chosen, plugins, told).sweep()
    if ended.ended_by:
        raise KeyboardInterrupt  # as in `backends.by_sweep`
    whole, most = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Client(ended.rows, first or whole, whole, time.process_time() - busy, most / 1024.0)


def apart(file: Path, folder: Path, cluster: Cluster | None, workers: int, *, timeless: bool = False) -> Client:
    """Run a sweep by a client in a new process, and return what it did.

    Raises
    ------
    ItouchError
        If the client fails.
    """
    engine = ("dask", cluster.address) if cluster else ("processes", "")
    words = [
        sys.executable,
        "-m",
        "itouch_evidence.sweeps.growth",
        os.fspath(file),
        os.fspath(folder),
        *engine,
        str(workers),
    ]
    words += ["timeless"] if timeless else []
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ItouchError(f"the client ended with {done.returncode}: {done.stderr.strip()[-500:]}")
    return Client(**json.loads(done.stdout))


def parts(scene: Path, seconds: float | None) -> Parts:
    """Measure the parts of the model by a sweep in one process."""
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        file, rows = written(Path(inner), scene, PILOTS, seconds), Path(inner) / "rows"
        one = apart(file, rows, None, 1)
        size = sum(path.stat().st_size for path in paths_of(rows)) / PILOTS
    gain = loops(cores()).per_s / loops(1).per_s
    return Parts(one.first_s, (one.whole_s - one.first_s) / (PILOTS - 1), gain, size)


def grown(
    scene: Path, counts: Sequence[int], seconds: float | None, model: Parts | None, *, dask: bool
) -> Iterator[SweepCost]:  # fmt: skip
    """Run a sweep of each number of runs, and yield its figures; without a model the runs take no time."""
    no_time = model is None
    for count in counts:
        with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
            file, rows = written(Path(inner), scene, count, seconds), Path(inner) / "rows"
            if dask:
                with dask_cluster(cores()) as cluster:
                    done = apart(file, rows, cluster, cores(), timeless=no_time)
                    busy, most = process(cluster.scheduler.pid)
            else:
                done, busy, most = apart(file, rows, None, cores(), timeless=no_time), 0.0, 0.0
            files = paths_of(rows)
            size = sum(path.stat().st_size for path in files) / count
        if done.rows != count:
            raise ItouchError(f"{count} runs have {done.rows} rows")
        yield SweepCost(count, done, model.seconds(count) if model else float("nan"), size, len(files), busy, most)


def process(pid: int) -> tuple[float, float]:
    """Return the CPU time [s] and the peak memory [MiB] of a process; NaN where the system does not give them."""
    try:
        after = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return float("nan"), float("nan")
    busy = (int(after[11]) + int(after[12])) / os.sysconf("SC_CLK_TCK")
    most = next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:")), 0)
    return busy, most / 1024.0


def scheduler_s(cluster: Cluster, tasks: int = 100, idle_s: float = 3.0) -> float:
    """Return the CPU time [s] that a scheduler spends on a task, without what it uses while idle.

    The tasks do nothing, and are handed out as usual.
    """
    pid = cluster.scheduler.pid
    with Engine("dask", cluster.address).working() as pool:
        list(pool.results((_nothing, (number,)) for number in range(8)))
        marks = [(time.perf_counter(), process(pid)[0])]
        time.sleep(idle_s)
        marks.append((time.perf_counter(), process(pid)[0]))
        list(pool.results((_nothing, (number,)) for number in range(tasks)))
        marks.append((time.perf_counter(), process(pid)[0]))
    (begin, first), (middle, idle), (end, last) = marks
    return max(0.0, last - idle - (idle - first) / (middle - begin) * (end - middle)) / tasks


def _nothing(number: int) -> int:
    return number


def extrapolated(
    largest: SweepCost, runs: float, workers: float, run_s: float, task_s: float, *, each_s: float = 0.0
) -> list[str]:  # fmt: skip
    """Return the lines that say what a far larger sweep would demand of each part, and which part would break.

    Parameters
    ----------
    largest
        The sweep that shows what a row costs the client.
    runs, workers, run_s
        Number of runs, number of workers, and seconds of a run in the larger sweep.
    task_s
        Seconds of work in a task.
    each_s
        CPU time of the scheduler for a task [s]; 0: unknown.
    """
    rate, client_s = workers / run_s, largest.client.cpu_s / largest.runs
    lines = [f"{runs:.0e} runs of {run_s:g} s on {workers:.0e} workers: {runs * run_s / workers / 3600.0:.1f} h, "
             f"{rate:.0f} rows a second"]  # fmt: skip
    lines.append(f"  client: {1e3 * client_s:.3f} ms of processor a row: {_load(rate * client_s)}")
    if each_s > 0.0:
        lines.append(f"  scheduler: {1e3 * each_s:.2f} ms of processor a task, with tasks of {max(task_s, run_s):g} s: "
                     f"{_load(workers / max(task_s, run_s) * each_s)}; 60 % with tasks of "
                     f"{workers * each_s / 0.6:.0f} s")  # fmt: skip
    lines.append(f"  rows: {runs * largest.row_bytes / 1e9:.1f} GB in {runs / FILE:.0f} files or more, "
                 f"{runs / PARTITION:.0f} partitions")  # fmt: skip
    lines.append(f"  to resume: {runs * DIGEST / 1e6:.0f} MB of digests")
    return lines


def _load(share: float) -> str:
    return f"{100.0 * share:.0f} % of one core{'' if share < 1.0 else ': BREAKS, cut the sweep or make tasks longer'}"


def line(one: SweepCost) -> str:
    """Return the line of a sweep for the screen."""
    told = one.client
    model = f", model {one.model_s:8.1f} s ({one.ratio:.2f})" if one.model_s > 0.0 else ""
    theirs = f"; scheduler {one.scheduler_MiB:.0f} MiB, {one.scheduler_cpu_s:.1f} s" if one.scheduler_MiB else ""
    return (
        f"{one.runs:7d} runs: {told.whole_s:8.1f} s{model}; first row after {told.first_s:.1f} s; client "
        f"{told.memory_MiB:.0f} MiB, {told.cpu_s:.1f} s of processor{theirs}; {one.row_bytes:.0f} bytes a row, "
        f"{one.files} files"
    )


if __name__ == "__main__":
    FILE_OF, ROWS, ENGINE, SCHEDULER, WORKERS, *HOW = sys.argv[1:]
    DONE = client(Path(FILE_OF), Path(ROWS), ENGINE, SCHEDULER, int(WORKERS), timeless="timeless" in HOW)
    print(json.dumps(asdict(DONE)))
