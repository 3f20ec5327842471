"""The results of a sweep: a Parquet data set that grows by complete files, so that it can be read at any time."""

from __future__ import annotations

import contextlib
import json
import os
import time
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch import platforms
from itouch.schema import ItouchError
from itouch_tools.sweeps.checking import columns
from itouch_tools.sweeps.sweep_elements import Grid
from itouch_tools.sweeps.sweepfile import SweepFile
from itouch_tools.sweeps.work import Work

if TYPE_CHECKING:
    import pyarrow

RUNS, INCOMING, SWEEP, WORK, PLAN = "runs", ".incoming", "sweep.xml", "work.json", "plan.json"
#: Number of runs whose rows lie in one partition, by their number in the plan.
PART = 10_000
#: Most rows that are written together, and how long a row may wait to be written: ``WAITS`` seconds at first, later the
#: ``SHARE`` of the time since the client began, at most ``WAITS_LONGEST`` seconds, so that a long sweep has few files;
#: rows that wait when a client is killed are run again.
MOST_ROWS, WAITS, WAITS_LONGEST, SHARE = 2000, 2.0, 60.0, 0.01
#: Statuses of rows whose runs the next client tries again.
AGAIN = ("machine", "hung")


class StoreError(ItouchError):
    """A folder that holds something else, or that cannot be written."""


def schema_of(file: SweepFile) -> pyarrow.Schema:
    """Return the columns of a sweep's rows."""
    import pyarrow as pa

    units = {each.name: each.unit for each in file.sweep.axes if isinstance(each, Grid)}
    units |= {one.name: one.unit for one in (file.sweep.draws.over if file.sweep.draws else ())}
    plan = file.plan()
    numeric = {name for axis in plan.axes for index, name in enumerate(axis.names)
               if all(isinstance(level.values[index], float) for level in axis.levels)}  # fmt: skip
    numeric |= {one.name for one in plan.over if not one.values}
    fields = [
        pa.field(name, pa.float64() if name in numeric else pa.string(), metadata={"unit": units.get(name, "")})
        for name in plan.columns
    ]
    fields.append(pa.field("seed", pa.int64()))
    for each in file.sweep.collect.results:
        kind = pa.string() if getattr(each, "type_", "number") == "text" else pa.float64()
        fields += [pa.field(name, kind) for name in columns(each)]
    fields += [pa.field("status", pa.string()), pa.field("reason", pa.string()), pa.field("simulated_s", pa.float64())]
    fields += [pa.field(name, pa.string()) for name in ("digest", "state", "cpu", "sets")]
    return pa.schema(fields)


class Store:
    """A sweep's folder, held by one client at a time."""

    def __init__(self, folder: Path, schema: pyarrow.Schema) -> None:
        self.folder, self._schema = folder, schema
        self._waiting: list[tuple[int, Mapping[str, Any]]] = []
        self._since, self._began = 0.0, time.monotonic()
        self._lock = -1
        #: Number of rows by status, those of earlier clients included.
        self.counts: Counter[str] = Counter()
        #: First eight bytes of the digests of the rows found at opening, sorted.
        self._known: NDArray[np.uint64] = np.empty(0, np.uint64)

    @classmethod
    def open(cls, folder: Path, file: SweepFile, work: Work) -> Store:
        """Open a sweep's folder, or create one.

        Raises
        ------
        StoreError
            If it holds another sweep, another client works in it, or it cannot be written.
        """
        store = cls(folder, schema_of(file))
        try:
            (folder / RUNS).mkdir(parents=True, exist_ok=True)
            (folder / INCOMING).mkdir(exist_ok=True)
            store._take_lock()
            store._compare(work)
            write_whole(folder / INCOMING, folder / SWEEP, Path(file.path).read_bytes())
            write_whole(folder / INCOMING, folder / WORK, work.dumps().encode())
            plan = json.dumps({"runs": len(file.plan())})
            write_whole(folder / INCOMING, folder / PLAN, plan.encode())
            store._recover()
        except (OSError, StoreError) as error:
            store.close()
            raise unwritable(folder, error) if isinstance(error, OSError) else error from None
        return store

    def _take_lock(self) -> None:
        self._lock = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | platforms.OPEN_FLAGS, 0o644)
        try:
            platforms.claim(self._lock)
        except BlockingIOError:
            os.close(self._lock)
            self._lock = -1
            raise StoreError(f"another program works in '{self.folder}': wait for it, or take another folder") from None

    def _compare(self, work: Work) -> None:
        if not (self.folder / WORK).exists():
            return
        before = read_work(self.folder).parts()
        now = work.parts()
        differ = [name for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
        if not differ:
            return
        shown = [
            f"{name} was {before.get(name, 'not there')}, and is {now.get(name, 'not there')}"
            if name in work.identity or not name.startswith(("the ", "w")) else f"{name} is not what it was"
            for name in differ
        ]  # fmt: skip
        raise StoreError(
            f"'{self.folder}' holds runs of something else:\n  " + "\n  ".join(shown)
            + "\ntake another folder: rows of both in one table would not be comparable"
        )  # fmt: skip

    def _recover(self) -> None:
        """Remove unfinished files of a killed client and rows to be tried again; note which rows there are."""
        import pyarrow.compute as pc
        import pyarrow.parquet as pq

        for path in (self.folder / INCOMING).iterdir():
            path.unlink()
        known = []
        for path in paths_of(self.folder):
            table = pq.read_table(path, columns=["digest", "status"], partitioning=None)
            again = pc.is_in(table["status"], value_set=_array(AGAIN))
            if pc.any(again).as_py():
                self._write(path, pq.read_table(path, partitioning=None).filter(pc.invert(again)))
                table = table.filter(pc.invert(again))
            self.counts.update(table["status"].to_pylist())
            known.append(keys(table["digest"].to_pylist()))
        self._known = np.unique(np.concatenate(known)) if known else self._known

    def __len__(self) -> int:
        return sum(self.counts.values())

    def has(self, digest: str) -> bool:
        """Tell whether a run's row was there when the folder was opened."""
        key = np.uint64(int(digest[:16], 16))
        at = int(np.searchsorted(self._known, key))
        return at < len(self._known) and bool(self._known[at] == key)

    def add(self, number: int, row: Mapping[str, Any]) -> None:
        """Take the row of the run with this number in the plan; the next ``flush`` writes it to disk."""
        if not self._waiting:
            self._since = time.monotonic()
        self._waiting.append((number, row))
        self.counts[str(row["status"])] += 1

    @property
    def due(self) -> bool:
        """Whether it is time to ``flush``."""
        if not self._waiting:
            return False
        now = time.monotonic()
        waits = min(max(WAITS, SHARE * (now - self._began)), WAITS_LONGEST)
        return len(self._waiting) >= MOST_ROWS or now - self._since > waits

    def flush(self) -> None:
        """Write the rows that wait.

        Raises
        ------
        StoreError
            If they cannot be written; they go on waiting, and the folder is as sound as before.
        """
        import pyarrow as pa

        parts: dict[int, list[Mapping[str, Any]]] = {}
        for number, row in self._waiting:
            parts.setdefault(number // PART, []).append(row)
        try:
            for part, rows in parts.items():
                table = pa.Table.from_pylist(rows, schema=self._schema)
                folder = self.folder / RUNS / f"part={part:05d}"
                folder.mkdir(exist_ok=True)
                self._write(folder / f"{uuid.uuid4().hex}.parquet", table)
                self._waiting = [(n, row) for n, row in self._waiting if n // PART != part]
        except OSError as error:
            raise unwritable(self.folder, error) from error

    def _write(self, path: Path, table: pyarrow.Table) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not len(table):
            path.unlink(missing_ok=True)
            return
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        write_whole(self.folder / INCOMING, path, sink.getvalue().to_pybytes())

    def close(self) -> None:
        """Release the folder for other clients."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def write_whole(incoming: Path, path: Path, data: bytes) -> None:
    """Write a file atomically: whenever the program or the machine ends, it is complete or unchanged."""
    partial = incoming / f"{uuid.uuid4().hex}.partial"
    try:
        with open(partial, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
    with contextlib.suppress(PermissionError):  # Windows does not open folders
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def unwritable(folder: Path, error: OSError) -> StoreError:
    """Return the error that says why a folder cannot be written."""
    return StoreError(
        f"cannot write '{error.filename or folder}': {error.strerror or error}; all rows before this one are kept, and "
        "the same command goes on from them"
    )


def paths_of(folder: Path) -> list[Path]:
    """Return the files of a sweep's data set."""
    return sorted((folder / RUNS).glob("part=*/*.parquet"))


def read_work(folder: Path) -> Work:
    """Return what the runs of a folder have in common.

    Raises
    ------
    StoreError
        If it is not the folder of a sweep.
    """
    try:
        return Work.loads((folder / WORK).read_text(encoding="utf-8"))
    except OSError as error:
        raise StoreError(f"'{folder}' is not the folder of a sweep: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"'{folder / WORK}' is not what a sweep writes: {error}") from None


def keys(digests: Sequence[str]) -> NDArray[np.uint64]:
    """Return the first eight bytes of digests as numbers, shape (n,)."""
    return np.array([int(digest[:16], 16) for digest in digests], np.uint64)


def rows(folder: Path, names: Sequence[str] | None = None) -> Iterator[dict[str, Any]]:
    """Yield the rows of a folder, file by file, with these columns only if ``names`` are given."""
    import pyarrow.parquet as pq

    for path in paths_of(folder):
        yield from pq.read_table(path, columns=None if names is None else list(names), partitioning=None).to_pylist()


def table(folder: Path) -> pyarrow.Table:
    """Return all rows of a folder, sorted by digest.

    Raises
    ------
    StoreError
        If there are none.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    found = [pq.read_table(path, partitioning=None) for path in paths_of(folder)]
    if not found:
        raise StoreError(f"'{folder}' has no rows")
    return pa.concat_tables(found).sort_by("digest")


def _array(words: Sequence[str]) -> Any:
    import pyarrow as pa

    return pa.array(list(words))
