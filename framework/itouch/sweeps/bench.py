"""``itouch-py bench sweep``: sessions a second, written by hand, by processes and by Dask, beside plain computing.

All of them in one run, because on a busy machine only the ratios mean anything.  With ``--cost`` the parts of the cost
model: seconds and bytes of a run, what the engine adds to a task, and how long a worker takes to begin.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from itouch.bench.batch import computed
from itouch.platforms import cores
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch.sweeps.client import sweep
from itouch.sweeps.instant import client_alone
from itouch.sweeps.store import paths_of

_SWEEP = """<sweep version="1.0" name="bench" scene="{scene}">
  <seeds count="{count}"/>
  {rule}
  <collect><report name="contacts" key="contacts[*].peak_force_N" reduce="count"/></collect>
</sweep>
"""


def by_hand(scene: Path, count: int, seconds: float | None) -> float:
    """Return sessions a second of the loop that one would write."""
    import itouch

    begin = time.perf_counter()
    for seed in range(count):
        session = itouch.build(scene, seed=seed)
        session.run(seconds)
        session.report()
        session.close()
    return count / (time.perf_counter() - begin)


def by_sweep(scene: Path, count: int, seconds: float | None, **engine: Any) -> dict[str, float]:
    """Return sessions a second of a sweep, with and without its begin and end, and the bytes of a row."""
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        file = Path(inner) / "bench.xml"
        rule = "" if seconds is None else f'<run for="{seconds} s"/>'
        file.write_text(_SWEEP.format(scene=os.path.relpath(scene, inner), count=count, rule=rule), encoding="utf-8")
        marks: list[tuple[float, int]] = []
        begin = time.perf_counter()
        sweep(file, Path(inner) / "rows", told=lambda p: marks.append((time.perf_counter(), p.done)), **engine)
        whole = time.perf_counter() - begin
        size = sum(path.stat().st_size for path in paths_of(Path(inner) / "rows"))
    return {"per_s": count / whole, "steady_per_s": _steady(marks), "bytes_a_row": size / count, "s": whole}


def _steady(marks: Sequence[tuple[float, int]]) -> float:
    """Return the rate between the first row and the last."""
    seen = [mark for mark in marks if mark[1] > 0]
    if not seen or seen[-1][1] <= seen[0][1]:
        return float("nan")
    last = next(mark for mark in seen if mark[1] == seen[-1][1])
    return (last[1] - seen[0][1]) / max(last[0] - seen[0][0], 1e-9)


@contextlib.contextmanager
def dask_cluster(workers: int) -> Iterator[str]:
    """Return the address of a scheduler with so many worker processes of this machine, by Dask's own commands."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    dask = [sys.executable, "-m", "dask"]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    begun = [subprocess.Popen([*dask, "scheduler", "--host", address, "--no-dashboard"], **quiet)]
    try:
        for _ in range(workers):
            words = [*dask, "worker", address, "--nthreads", "1", "--no-dashboard"]
            begun.append(subprocess.Popen(words, **quiet))
        yield address
    finally:
        for one in reversed(begun):
            one.terminate()
        for one in begun:
            with contextlib.suppress(subprocess.TimeoutExpired):
                one.wait(10.0)
            one.kill()


def measure(scene: Path, sessions: int, seconds: float | None, *, dask: bool) -> dict[str, Any]:
    """Return sessions a second by each way, and the gain of plain compute loops in the same run."""
    count, rounds = cores(), 3_000_000
    found: dict[str, Any] = {"scene": scene.name, "cores": count, "sessions": sessions}
    found["by hand"] = by_hand(scene, sessions, seconds)
    found["one process"] = by_sweep(scene, sessions, seconds, workers=1)
    loop_one = computed(1, rounds)
    found["processes"] = by_sweep(scene, sessions * count, seconds, workers=count)
    found["gain of plain loops"] = computed(count, rounds) / loop_one
    found["gain"] = found["processes"]["steady_per_s"] / found["one process"]["steady_per_s"]
    found["share of that"] = found["gain"] / found["gain of plain loops"]
    if dask:
        with dask_cluster(count) as address:
            found["dask"] = by_sweep(scene, sessions * count, seconds, engine="dask", scheduler=address)
        found["dask of processes"] = found["dask"]["steady_per_s"] / found["processes"]["steady_per_s"]
    return found


def overhead(tasks: int = 200) -> dict[str, float]:
    """Return what the engine adds to a task [s], and how long it takes until the first worker answers [s]."""
    from joblib import Parallel, delayed

    begin = time.perf_counter()
    Parallel(n_jobs=cores(), batch_size=1)(delayed(_nothing)(n) for n in range(cores()))
    first = time.perf_counter() - begin
    begin = time.perf_counter()
    Parallel(n_jobs=cores(), batch_size=1)(delayed(_nothing)(n) for n in range(tasks))
    return {"task_s": (time.perf_counter() - begin) / tasks * cores(), "begin_s": first}


def _nothing(number: int) -> int:
    return number


def main(argv: Sequence[str]) -> int:
    """Measure how many sessions a second sweeps run here, and what the cores and a cluster bring."""
    parser = argparse.ArgumentParser(prog="itouch-py bench sweep", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE", help="a scene; it runs on twins")
    parser.add_argument("--sessions", type=int, default=8, metavar="N", help="of each worker (default 8)")
    parser.add_argument("--seconds", type=float, metavar="S", help="simulated, of each; default: its whole motion")
    parser.add_argument("--no-dask", action="store_true", help="leave out the cluster")
    parser.add_argument("--cost", action="store_true", help="the parts of the cost model instead")
    parser.add_argument("--client", type=int, metavar="N", help="what the client alone does with N runs of no time")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    scene = Path(options.scene)
    if not scene.is_file():
        raise ItouchError(f"there is no scene '{scene}'")
    Catalog()
    if options.client:
        return _printed(_client(scene, options.client), as_json=options.json)
    if options.cost:
        return _cost(scene, max(2, options.sessions), options.seconds, as_json=options.json)
    found = measure(scene, max(2, options.sessions), options.seconds, dask=not options.no_dask)
    if options.json:
        print(json.dumps(found, indent=1))
        return 0
    print(f"{found['scene']}, sessions a second (between the first row and the last):")
    print(f"  by hand, one process    {found['by hand']:8.3f}")
    rows = (("one process", "sweep, one process"), ("processes", "sweep, processes"), ("dask", "sweep, Dask"))
    for key, name in rows:
        if key in found:
            print(f"  {name:<23} {found[key]['steady_per_s']:8.3f}   with begin and end {found[key]['per_s']:.3f}")
    print(f"  gain of {found['cores']} cores {found['gain']:.2f}; of plain compute loops "
          f"{found['gain of plain loops']:.2f}: {found['share of that']:.2f} of that")  # fmt: skip
    if "dask" in found:
        print(f"  Dask has {found['dask of processes']:.2f} of the rate of processes")
    return 0


def _cost(scene: Path, sessions: int, seconds: float | None, *, as_json: bool) -> int:
    parts = overhead()
    run = by_sweep(scene, sessions, seconds, workers=1)
    found = {
        "run_s": 1.0 / run["steady_per_s"], "bytes_a_row": run["bytes_a_row"], "engine_task_s": parts["task_s"],
        "engine_begin_s": parts["begin_s"], "sweep_begin_s": max(0.0, run["s"] - sessions / run["steady_per_s"]),
    }  # fmt: skip
    return _printed(found, as_json=as_json)


def _client(scene: Path, count: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        file = Path(inner) / "bench.xml"
        file.write_text(_SWEEP.format(scene=os.path.relpath(scene, inner), count=count, rule=""), encoding="utf-8")
        return client_alone(file)


def _printed(found: dict[str, float], *, as_json: bool) -> int:
    if as_json:
        print(json.dumps(found, indent=1))
        return 0
    for name, value in found.items():
        print(f"{name:>16} {value:.4g}")
    return 0
