"""``itouch-py bench batch``: how many sessions per second run here, and how well a batch uses all cores.

The gain of a batch over one worker is compared with that of plain compute loops, in the same run: on a busy machine, or
where cores share hardware, both are less than the number of cores.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Sequence
from typing import Any

from itouch.loop.clock import now
from itouch.platforms import cores
from itouch.plugin.commands import exit_code
from itouch.plugin.discovery import Catalog
from itouch.session import Session, load_scene
from itouch.session.batch import batch
from itouch.world import Model

#: The share of the gain of plain compute loops that a batch must reach.
SHARE = 0.9


def _compute(rounds: int) -> int:
    """Compute in plain Python."""
    total = 0
    for index in range(rounds):
        total += index * index & 7
    return total


def computed(workers: int, rounds: int) -> float:
    """Return how many compute loops a second this many processes run."""
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        pool.map(_compute, [1000] * workers)  # after this the workers have started
        begin = now()
        pool.map(_compute, [rounds] * workers, chunksize=1)
        return workers / (now() - begin)


def _ticks(session: Session) -> int:
    return session.ticks


def _run(model: Model, count: int, seconds: float | None, workers: int) -> tuple[float, float]:
    """Run ``count`` sessions; return sessions per second, and simulated seconds per second."""
    begin = now()
    ticks = batch(model, seeds=range(count), until=seconds, collect=_ticks, workers=workers)
    spent = now() - begin
    return count / spent, sum(ticks) * model.period / spent


def measure(model: Model, sessions: int, seconds: float | None, rounds: int = 3_000_000) -> dict[str, Any]:
    """Return sessions per second with one worker and with one per core, and the gains."""
    count = cores()
    one, loop_one = _run(model, sessions, seconds, 1), computed(1, rounds)
    many, loop_many = _run(model, sessions * count, seconds, count), computed(count, rounds)
    return {
        "scene": model.scene.source,
        "cores": count,
        "sessions_per_s": {"one": one[0], "all": many[0]},
        "times_real_time": {"one": one[1], "all": many[1]},
        "gain": many[0] / one[0],
        "gain_of_plain_loops": loop_many / loop_one,
        "share_of_that": many[0] / one[0] / (loop_many / loop_one),
    }


def main(argv: Sequence[str]) -> int:
    """Measure how many sessions a second run in a batch; exit code 1: it makes too little of all cores."""
    parser = argparse.ArgumentParser(prog="itouch-py bench batch", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE", help="a scene; it runs on twins")
    parser.add_argument("--sessions", type=int, default=4, metavar="N", help="sessions of each worker (default 4)")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="simulated seconds of each; default: its whole motion"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    catalog = Catalog()
    model = Model.of(load_scene(options.scene, twin="all", catalog=catalog), catalog)
    found = measure(model, max(1, options.sessions), options.seconds)
    code = exit_code([found["share_of_that"] >= SHARE])
    if options.json:
        print(json.dumps(found, indent=1))
        return code
    rate, fast = found["sessions_per_s"], found["times_real_time"]
    print(f"{found['scene']}: {rate['one']:.2f} sessions a second with one worker ({fast['one']:.0f} x real time)")
    all_of_them = f"{rate['all']:.2f} a second ({fast['all']:.0f} x real time)"
    print(f"  {found['cores']} workers: {all_of_them}, gain {found['gain']:.2f}")
    print(f"  plain compute loops gain {found['gain_of_plain_loops']:.2f}: {judged(found['share_of_that'])}")
    return code


def judged(share: float) -> str:
    """Return a sentence on the share of plain loops' gain that a batch has, beside what it must have."""
    return f"{share:.2f} of that, at least {SHARE:g}{' MISSED' if share < SHARE else ''}"
