"""The folder of a sweep: whole files, one writer, nothing twice, and a sentence where it cannot be written."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from sweeping import written

from itouch.plugin.discovery import Catalog
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import INCOMING, RUNS, Store, StoreError, paths_of, table
from itouch_tools.sweeps.sweepfile import SweepFile
from itouch_tools.sweeps.work import Work, work_of


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[SweepFile, Work]:
    file = load_sweep(written(tmp_path_factory.mktemp("store") / "a"), Catalog())
    return file, work_of(file, Catalog())


@pytest.fixture
def store(made: tuple[SweepFile, Work], tmp_path: Path) -> Iterator[Store]:
    found = Store.open(tmp_path / "out", *made)
    yield found
    found.close()


def rows(made: tuple[SweepFile, Work], status: str = "done") -> list[dict[str, Any]]:
    plan = made[0].plan(made[1].digest)
    runs = [plan.run(number) for number in range(len(plan))]
    return [{**run.values, "seed": run.seed, "digest": run.digest, "status": status, "sets": "[]"} for run in runs]


def test_rows_are_read_while_more_are_written(made: tuple[SweepFile, Work], store: Store) -> None:
    every = rows(made)
    for number, row in enumerate(every[:3]):
        store.add(number, row)
    assert not paths_of(store.folder)
    store.flush()
    assert pq.read_table(store.folder / RUNS).num_rows == 3
    for number, row in enumerate(every[3:], 3):
        store.add(number + 10_000, row)
    store.flush()
    whole = pq.read_table(store.folder / RUNS).to_pandas()
    assert sorted(whole["digest"]) == sorted(row["digest"] for row in every)
    assert set(whole["part"].astype(int)) == {0, 1}
    assert table(store.folder).schema.field("mass").metadata == {b"unit": b"g"}
    assert not list((store.folder / INCOMING).iterdir())


def test_a_folder_is_taken_up_where_it_is(made: tuple[SweepFile, Work], store: Store) -> None:
    every = rows(made)
    for number, row in enumerate(every[:5]):
        store.add(number, row)
    store.flush()
    store.close()
    (store.folder / INCOMING / "x.partial").write_bytes(b"half a file")
    again = Store.open(store.folder, *made)
    assert [again.has(row["digest"]) for row in every] == [True] * 5 + [False] * 3
    assert len(again) == 5
    assert not list((store.folder / INCOMING).iterdir())
    again.close()


def test_what_the_machine_spoilt_is_taken_out_to_be_tried_again(made: tuple[SweepFile, Work], store: Store) -> None:
    every = rows(made)
    for number, row in enumerate(every[:4]):
        store.add(number, {**row, "status": ("done", "machine", "crashed", "hung")[number]})
    store.flush()
    store.add(4, {**every[4], "status": "machine"})
    store.flush()
    store.close()
    again = Store.open(store.folder, *made)
    assert [again.has(row["digest"]) for row in every[:5]] == [True, False, True, False, False]
    assert table(store.folder).num_rows == 2
    assert dict(again.counts) == {"done": 1, "crashed": 1}
    again.close()


def test_two_clients_do_not_work_in_one_folder(made: tuple[SweepFile, Work], store: Store) -> None:
    with pytest.raises(StoreError, match="another program works in"):
        Store.open(store.folder, *made)


def test_another_scene_or_program_is_refused_with_what_differs(
    made: tuple[SweepFile, Work], store: Store, tmp_path: Path
) -> None:
    store.close()
    path = written(tmp_path / "b")
    scene = path.parent / "first_touch.xml"
    scene.write_text(scene.read_text(encoding="utf-8").replace("50 mm", "51 mm"), encoding="utf-8")
    other = load_sweep(path, Catalog())
    with pytest.raises(StoreError, match=r"the file 'first_touch\.xml' is not what it was"):
        Store.open(store.folder, other, work_of(other, Catalog()))
    fields = {name: getattr(made[1], name) for name in Work.__slots__}
    newer = Work(**{**fields, "identity": {**made[1].identity, "numba": "9.9"}})
    with pytest.raises(StoreError, match=r"numba was .*, and is 9\.9"):
        Store.open(store.folder, made[0], newer)
    Store.open(store.folder, *made).close()


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_is_a_sentence_and_nothing_is_lost_or_doubled(
    made: tuple[SweepFile, Work], store: Store, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    every = rows(made)
    store.add(0, every[0])
    store.flush()
    store.add(1, every[1])

    def full(*words: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "runs/x")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(StoreError, match=r"cannot write 'runs/x': No space left on device; all rows before"):
            store.flush()
    assert table(store.folder).num_rows == 1
    assert not list((store.folder / INCOMING).iterdir())
    store.flush()
    store.flush()
    assert sorted(table(store.folder)["digest"].to_pylist()) == sorted(row["digest"] for row in every[:2])


def test_a_folder_that_cannot_be_made_is_a_sentence(made: tuple[SweepFile, Work], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot write"):
        Store.open(tmp_path / "file", *made)
