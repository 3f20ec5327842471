"""Replays one row: the same run again in this process, compared with the row."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from itouch.plugin.discovery import Catalog
from itouch.session import Session
from itouch_tools.sweeps.provenance import cpu_model, differences, identity
from itouch_tools.sweeps.run_plan import Run, digest_of
from itouch_tools.sweeps.running import Running
from itouch_tools.sweeps.sweep_store import StoreError, paths_of, read_work


@dataclass(frozen=True, slots=True)
class Replayed:
    """A row, the row of the same run made again, and sentences on what differs; none: the bytes are the same."""

    row: Mapping[str, Any]
    again: Mapping[str, Any]
    differs: tuple[str, ...]


def find_row(folder: Path, which: str) -> dict[str, Any]:
    """Return the row whose digest begins with ``which``.

    Raises
    ------
    StoreError
        If there is none, or there are several.
    """
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    found: list[dict[str, Any]] = []
    for path in paths_of(folder):
        digests = pq.read_table(path, columns=["digest"], partitioning=None)["digest"]
        if pc.any(pc.starts_with(digests, which)).as_py():
            table = pq.read_table(path, partitioning=None)
            found += table.filter(pc.starts_with(table["digest"], which)).to_pylist()
    if len(found) != 1:
        many = f"{len(found)} rows begin" if found else "no row begins"
        raise StoreError(f"'{folder}': {many} with the digest '{which}'; a row is named by the first letters of its "
                         "column `digest`")  # fmt: skip
    return found[0]


def replay(folder: Path, which: str) -> Replayed:
    """Run the run of a row again in this process, and compare.

    Raises
    ------
    StoreError
        If there is no such row, or the folder's content is not what the row was made from.
    """
    row = find_row(folder, which)
    work, run = read_work(folder), _run_of(row)
    if digest_of(work.digest, run.sets, run.seed) != run.digest:
        raise StoreError(f"the row {run.digest[:12]} was not made from the scene that lies in '{folder}'")
    with tempfile.TemporaryDirectory(prefix="itouch-sweep-") as inner:
        again = Running(work, Path(inner)).row(run)
    told = [
        f"{name}: {row[name]!r} then, {again[name]!r} now"
        for name in row
        if name in again and name != "cpu" and row[name] != again[name]
    ]
    if told:
        told += [f"{one} (what computes)" for one in differences(work.identity, identity(work.packages))]
        if row["cpu"] != cpu_model():
            told.append(f"the row was made on '{row['cpu']}', this is '{cpu_model()}'")
    return Replayed(row, again, tuple(told))


def session_of(folder: Path, which: str, target: Path) -> None:
    """Write the session of a row before its first tick, which ``itouch-py`` can open in a window.

    Raises
    ------
    StoreError
        If there is no such row.
    SceneError
        If its scene cannot be compiled.
    """
    run, work = _run_of(find_row(folder, which)), read_work(folder)
    with tempfile.TemporaryDirectory(prefix="itouch-sweep-") as inner:
        catalog = Catalog()
        model = Running(work, Path(inner)).model(run.sets)
        session = Session(model, seed=run.seed, catalog=catalog)
        session.save(target)
        session.close()


def _run_of(row: Mapping[str, Any]) -> Run:
    sets = tuple((str(path), str(value)) for path, value in json.loads(row["sets"]))
    return Run({}, sets, int(row["seed"]), str(row["digest"]))
