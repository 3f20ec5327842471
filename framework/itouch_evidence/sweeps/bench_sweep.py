"""``itouch-py bench sweep``: sessions a second by hand, by processes and by Dask, beside plain computing.

All are measured in one run, because on a busy machine only the ratios mean anything.  ``--cost`` measures the parts of
the cost model instead: seconds and bytes of a run, what the engine adds to a task, and how long a worker takes to
begin.  ``--grow`` compares that model with sweeps of more and more runs.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from itouch.platforms import cores
from itouch.plugin.commands import exit_code
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError
from itouch_evidence.sweeps import backends, growth
from itouch_evidence.sweeps.empty_runs import client_alone
from itouch_tools.sweeps.sweep_client import TASK

#: Runs and workers of the sweep to which the figures are extrapolated.
FAR = (1e8, 1e4)


def overhead(tasks: int = 200) -> dict[str, float]:
    """Return what the engine adds to a task [s], and how long its workers take to begin [s]."""
    from joblib import Parallel, delayed

    begin = time.perf_counter()
    Parallel(n_jobs=cores(), batch_size=1)(delayed(_nothing)(n) for n in range(cores()))
    first = time.perf_counter() - begin
    begin = time.perf_counter()
    Parallel(n_jobs=cores(), batch_size=1)(delayed(_nothing)(n) for n in range(tasks))
    return {"task_s": (time.perf_counter() - begin) / tasks * cores(), "begin_s": first}


def _nothing(number: int) -> int:
    return number


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="itouch-py bench sweep", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE", help="a scene; it runs on twins")
    parser.add_argument(
        "--sessions", type=int, default=8, metavar="N", help="sessions of each worker and round (default 8)"
    )
    parser.add_argument("--rounds", type=int, default=2, metavar="N", help="how often each way is measured (default 2)")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="simulated seconds of each; default: its whole motion"
    )
    parser.add_argument("--no-dask", action="store_true", help="leave out the cluster")
    parser.add_argument("--cost", action="store_true", help="the parts of the cost model instead")
    parser.add_argument("--client", type=int, metavar="N", help="what the client alone does with N runs of no time")
    parser.add_argument(
        "--grow", type=_counts, metavar="100,1000", help="sweeps of these numbers of runs beside the cost model"
    )
    parser.add_argument("--timeless", action="store_true", help="the runs of --grow take no time: only what client, "
                        "engine and scheduler do with them")  # fmt: skip
    parser.add_argument("--run-seconds", type=float, default=8.0, metavar="S",
                        help="length of a run in the 1e8 runs to which --grow is extrapolated (default 8)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _counts(text: str) -> tuple[int, ...]:
    try:
        found = tuple(round(float(part)) for part in text.split(","))
    except (ValueError, OverflowError):
        found = ()
    if not found or min(found) < 2 or max(found) > 10**7:
        raise argparse.ArgumentTypeError(f"'{text}' is not like 100,1000,1e4")
    return found


def main(argv: Sequence[str]) -> int:
    """Measure how many sessions a second sweeps run here, and what the cores and a cluster bring."""
    options = _parser().parse_args(argv)
    scene = Path(options.scene)
    if not scene.is_file():
        raise ItouchError(f"there is no scene '{scene}'")
    Catalog()
    if options.client:
        return _printed(_client(scene, options.client), as_json=options.json)
    if options.cost:
        return _cost(scene, max(2, options.sessions), options.seconds, as_json=options.json)
    if options.grow:
        return _grow(scene, options)
    found = backends.measure(
        scene, max(2, options.sessions), options.seconds, dask=not options.no_dask, rounds=max(1, options.rounds)
    )
    print(json.dumps(backends.plain(found), indent=1) if options.json else "\n".join(backends.shown(found)))
    return exit_code(value >= backends.SHARE for _, value in found.bounds())


def _grow(scene: Path, options: argparse.Namespace) -> int:
    model = None if options.timeless else growth.parts(scene, options.seconds)
    if model is not None and not options.json:
        print(f"model: first row after {model.begin_s:.1f} s, then {1e3 * model.run_s:.1f} ms a run in one process, "
              f"{model.gain:.2f} times as many by {cores()} cores (two plain loops)", flush=True)  # fmt: skip
    done = []
    for one in growth.grown(scene, options.grow, options.seconds, model, dask=not options.no_dask):
        done.append(one)
        if not options.json:
            print(growth.line(one), flush=True)
    each = 0.0
    if not options.no_dask:
        with backends.dask_cluster(cores()) as cluster:
            each = growth.scheduler_s(cluster)
    largest = max(done, key=lambda one: one.runs)
    far = growth.extrapolated(largest, *FAR, options.run_seconds, TASK, each_s=each)
    if options.json:
        told = {"model": None if model is None else asdict(model), "grown": [asdict(one) for one in done]}
        print(json.dumps({**told, "scheduler_task_s": each, "far": far}, indent=1))
    else:
        print("\n".join(far))
    return 0


def _cost(scene: Path, sessions: int, seconds: float | None, *, as_json: bool) -> int:
    parts = overhead()
    rate, size = backends.by_sweep(scene, sessions, seconds, workers=1)
    found = {
        "run_s": 1.0 / rate.per_s, "bytes_a_row": size, "engine_task_s": parts["task_s"],
        "engine_begin_s": parts["begin_s"], "sweep_begin_s": max(0.0, rate.whole_s - sessions / rate.per_s),
    }  # fmt: skip
    return _printed(found, as_json=as_json)


def _client(scene: Path, count: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory(prefix="itouch-bench-") as inner:
        return client_alone(backends.written(Path(inner), scene, count, None))


def _printed(found: Mapping[str, Any], *, as_json: bool) -> int:
    if as_json:
        print(json.dumps(found, indent=1))
        return 0
    for name, value in found.items():
        print(f"{name:>16} {value:.4g}")
    return 0
