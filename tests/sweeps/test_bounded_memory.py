"""Many runs: the client streams them, and needs no more memory for more of them than their digests."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from sweeping import COLLECT, VARIED, written

from itouch.plugin.discovery import Catalog
from itouch_evidence.sweeps.bench_sweep import main as bench
from itouch_evidence.sweeps.empty_runs import InstantPool, client_alone
from itouch_tools.sweeps.sweep_client import Client
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import table


def many(folder: Path, seeds: int) -> Path:
    return written(folder, VARIED.replace('<seeds count="2"/>', f'<seeds count="{seeds}"/>') + COLLECT)


def peak(path: Path, out: Path) -> int:
    """Return the most bytes that Python held while a sweep ran."""
    client = Client(load_sweep(path, Catalog()), out, InstantPool(), Catalog(), None)
    tracemalloc.start()
    client.sweep()
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found


def test_memory_does_not_grow_with_the_runs(tmp_path: Path) -> None:
    few, more = peak(many(tmp_path / "a", 100), tmp_path / "few"), peak(many(tmp_path / "b", 500), tmp_path / "more")
    found = table(tmp_path / "more")
    assert found.num_rows == len(set(found["digest"].to_pylist())) == 2000
    assert (more - few) / 1600 < 2048.0  # bytes a run: what is kept of each is its digest and where its row stands


@pytest.mark.long
def test_a_hundred_thousand_runs(tmp_path: Path) -> None:
    found = client_alone(many(tmp_path / "a", 25_000))
    assert found["runs"] == 100_000
    assert found["memory_MiB"] < 200.0
    assert found["bytes_a_row"] < 300.0


def test_the_bench_tells_what_the_client_alone_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench([str(many(tmp_path / "a", 2).parent / "first_touch.xml"), "--client", "300"]) == 0
    assert "rows_per_s" in capsys.readouterr().out
