"""What a sweep will cost, from a few of its runs (pilots): seconds, bytes, and keys that no report has."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from itouch.plugin.discovery import Catalog
from itouch.schema.diagnostics import Problem
from itouch_tools.sweeps import report_paths
from itouch_tools.sweeps.run_plan import Plan
from itouch_tools.sweeps.sweep_elements import FromReport
from itouch_tools.sweeps.sweep_store import schema_of
from itouch_tools.sweeps.sweepfile import SweepFile
from itouch_tools.sweeps.work import work_of
from itouch_tools.sweeps.worker import DeadError, Runner, failed

#: Number of rows by which the size of a row is measured.
_ROWS = 512


@dataclass(frozen=True, slots=True)
class Estimate:
    """The cost of a sweep by pilot runs: seconds of a run and of a build, bytes of a row, statuses of the pilots."""

    runs: int
    structures: int
    run_s: float
    build_s: float
    row_bytes: float
    statuses: Mapping[str, int]
    problems: tuple[Problem, ...]
    #: Why pilots failed.
    reasons: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Seconds that the whole sweep takes on one core."""
        return self.runs * self.run_s + self.structures * self.build_s


def estimate(file: SweepFile, catalog: Catalog, pilots: int) -> Estimate:
    """Run some pilots on this machine, spread over the plan, and return what they cost.

    Raises
    ------
    ItouchError
        If scene, files and plugins are too large to travel with a task.
    """
    work = work_of(file, catalog)
    plan = file.plan(work.digest)
    numbers = sorted({round(index * (len(plan) - 1) / max(1, pilots - 1)) for index in range(pilots)})
    runner = Runner(work)
    rows: list[dict[str, Any]] = []
    seconds: list[float] = []
    try:
        _, report, first = runner.report(plan.run(numbers[0]))  # builds the model, and compiles what is missing
        for number in numbers:
            _, row, spent = runner.run(plan.run(number))
            rows.append(row)
            seconds.append(spent)
    except DeadError as dead:
        rows.append(failed(plan.run(numbers[len(rows)]), dead.status, str(dead)))
        report, first = {}, 0.0
    finally:
        runner.close()
    run, build = _split(plan, seconds, first)
    statuses: dict[str, int] = {}
    for row in rows:
        statuses[row["status"]] = statuses.get(row["status"], 0) + 1
    return Estimate(
        len(plan), plan.structures, run, build, _bytes(file, plan, rows), statuses,
        tuple(_unknown_keys(file, report, rows)) if any(row["status"] == "done" for row in rows) else (),
        tuple(dict.fromkeys(row["reason"] for row in rows if row["reason"])),
    )  # fmt: skip


def _split(plan: Plan, seconds: list[float], first: float) -> tuple[float, float]:
    """Return the time [s] of a run and of a build; the first pilot's scene was built before its run."""
    if not seconds:
        return 0.0, 0.0
    run = seconds[0]
    others = seconds[1:] if plan.structures > 1 else []
    build = max(0.0, sum(others) / len(others) - run) if others else max(0.0, first - run)
    return run, build


def _bytes(file: SweepFile, plan: Plan, rows: list[dict[str, Any]]) -> float:
    """Return the bytes of a row, compressed among rows with the plan's parameters and results like the pilots'."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    made = []
    for index in range(_ROWS):
        run, row = plan.run(index * len(plan) // _ROWS), rows[index % len(rows)]
        state = hashlib.sha256(f"{index}".encode()).hexdigest()
        noisy = {name: value * (1.0 + 1e-6 * index) if isinstance(value, float) else value
                 for name, value in row.items()}  # fmt: skip
        digest = hashlib.sha256(state.encode()).hexdigest()
        made.append({**noisy, **run.values, "seed": run.seed, "digest": digest, "state": state, "sets": str(run.sets)})
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(made, schema=schema_of(file)), sink, compression="zstd")
    return float(len(sink.getvalue()) / _ROWS)


def _unknown_keys(file: SweepFile, report: dict[str, Any], rows: list[dict[str, Any]]) -> list[Problem]:
    """Return a warning for each key that no pilot's report has."""
    found = []
    for each in file.sweep.collect.results:
        if isinstance(each, FromReport) and report and all(row.get(each.name) is None for row in rows):
            sentence = f"no pilot has '{each.key}' in its report: the column '{each.name}' was empty"
            place, advice = file.places.of(each, "key"), report_paths.advice(report, each.key)
            found.append(Problem("unknown-name", sentence, place, advice, severity="warning"))
    return found
