"""What the benches of sweeps say: of rates beside plain loops, of growth beside the model, and of rows after deaths."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from requirements import meant

from itouch_evidence.sweeps import backends, deaths, failures
from itouch_evidence.sweeps.backends import Measured, Rate, plain, shown, steady
from itouch_evidence.sweeps.bench_sweep import main as bench
from itouch_evidence.sweeps.deaths import main as campaign
from itouch_evidence.sweeps.growth import Client, Parts, SweepCost, extrapolated, line, process
from itouch_tools.cli import main
from itouch_tools.sweeps.sweep_store import RUNS

SCENE = """<itouch version="1.0"><world><box name="block" size="1 1 1" material="wood"/></world>
  <materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm"/></interaction></itouch>"""


def measured(dask: float) -> Measured:
    ways = {"one process": Rate(10, 10.0, 10, 12.0), "processes": Rate(20, 10.5, 20, 13.0), "Dask": Rate(20, dask)}
    return Measured("x.xml", 2, 1, ways, {"one": Rate(2, 2.0), "all": Rate(4, 2.0)})


def test_each_promise_stands_beside_what_was_measured() -> None:
    lines = "\n".join(shown(measured(11.0)))
    assert "gain of 2 processes 1.90, of 2 plain compute loops 2.00" in lines
    assert "share of the gain of 2 plain loops: 0.95, bound 0.9 or more\n" in lines
    assert "rate of Dask beside that of processes: 0.95, bound 0.9 or more" in lines
    assert "NOT KEPT" not in lines
    assert "rate of Dask beside that of processes: 0.53, bound 0.9 or more: NOT KEPT" in shown(measured(20.0))[-1]
    assert plain(measured(20.0))["gain of plain loops"] == pytest.approx(2.0)


def test_rounds_are_summed_and_the_first_row_is_where_counting_begins() -> None:
    rate = Rate(10, 5.0, 10, 6.0)
    rate.add(Rate(30, 5.0, 30, 7.0))
    assert (rate.per_s, rate.whole, rate.whole_s) == (4.0, 40, 13.0)
    assert steady([(0.0, 0), (5.0, 1), (6.0, 11), (9.0, 11)]) == (10, 1.0)
    assert steady([(0.0, 0), (5.0, 3)])[0] == 0


def test_a_signal_ends_the_bench_and_not_only_the_sweep_that_it_measures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sweep ended in order, and the bench went on with the next one, and printed a rate of what was not measured."""
    scene, real, begun = tmp_path / "scene.xml", backends.sweep, list[Path]()
    scene.write_text(SCENE)

    def interrupted(file: Path, rows: Path, **named: Any) -> Any:
        begun.append(rows)
        return real(file, rows, **{**named, "told": lambda _: signal.raise_signal(signal.SIGTERM)})

    monkeypatch.setattr(backends, "sweep", interrupted)
    words = ["bench", "sweep", str(scene), "--sessions", "8", "--seconds", "0.01", "--rounds", "1", "--no-dask"]
    assert main(words) == 130
    assert len(begun) == 1
    assert "sessions a second" not in capsys.readouterr().out


def test_growth_says_what_breaks_far_away() -> None:
    assert Parts(4.0, 0.02, 2.0, 100.0).seconds(1000) == pytest.approx(14.0)
    grown = SweepCost(1000, Client(1000, 4.0, 15.0, 0.1, 230.0), 14.0, 90.0, 5, 2.0, 140.0)
    assert "15.0 s, model     14.0 s (1.07)" in line(grown)
    told = extrapolated(grown, 1e8, 1e4, 8.0, 4.0, each_s=0.003)
    assert "22.2 h, 1250 rows a second" in told[0]
    assert told[1].endswith("0.100 ms of processor a row: 12 % of one core")
    assert "375 % of one core: BREAKS" in told[2]
    assert told[2].endswith("60 % with tasks of 50 s")
    assert "9.0 GB in 50000 files" in told[3]
    busy, most = process(os.getpid())
    assert busy > 0.0
    assert most > 10.0


def test_numbers_of_runs_are_checked(capsys: pytest.CaptureFixture[str]) -> None:
    for wrong in ("many", "1", "1e9", ""):
        with pytest.raises(SystemExit):
            bench(["x.xml", "--grow", wrong])
        assert "is not like 100,1000,1e4" in capsys.readouterr().err


def rows_in(out: Path, *digests: str) -> None:
    folder = out / RUNS / "part=00000"
    folder.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({"digest": list(digests)}), folder / f"{len(list(folder.iterdir()))}.parquet")


@pytest.mark.skipif(
    not hasattr(signal, "SIGKILL") or sys.platform != "linux", reason=meant("processes are found in /proc")
)
def test_a_row_that_is_lost_or_doubled_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    rows_in(out, "a", "b")
    spoil = [lambda: None]

    def stand_in(words: list[str], mark: str, log: Path) -> subprocess.Popen[bytes]:
        spoil[0]()
        return subprocess.Popen(["sleep", "100"], env={"ITOUCH_SWEEP_DEATHS": mark})

    monkeypatch.setattr(deaths, "begun", stand_in)
    rng = random.Random(3)
    monkeypatch.setattr(rng, "uniform", lambda low, high: 0.05)
    good = deaths.strike(tmp_path / "sweep.xml", out, 0, rng)
    assert (good["good"], good["killed"], good["rows"], good["left"]) == (True, True, 2, 0)
    spoil[0] = lambda: rows_in(out, "b", "c")
    doubled = deaths.strike(tmp_path / "sweep.xml", out, 1, rng)
    assert (doubled["good"], doubled["doubled"], doubled["new"]) == (False, 1, 2)
    spoil[0] = lambda: (out / RUNS / "part=00000" / "0.parquet").unlink()
    lost = deaths.strike(tmp_path / "sweep.xml", out, 0, rng)
    assert (lost["good"], lost["lost"]) == (False, 1)


@pytest.mark.skipif(sys.platform != "linux", reason=meant("processes are found in /proc"))
def test_what_goes_on_working_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deaths, "GONE", 0.2)
    mark = f"some mark of {os.getpid()}"  # another run of the tests on this machine has its own
    left = subprocess.Popen(["sleep", "100"], env={"ITOUCH_SWEEP_DEATHS": mark})
    try:
        while not Path(f"/proc/{left.pid}/environ").read_bytes():  # a program that has just begun shows none yet
            time.sleep(0.01)
        assert deaths._left(mark) == 1
    finally:
        left.kill()
        left.wait()
    assert deaths._left(mark) == 0


@pytest.mark.long
def test_clients_that_are_killed_lose_and_double_nothing(tmp_path: Path) -> None:
    assert campaign(["--clients", "50", "--keep", str(tmp_path), *(f"--only={name}" for name in failures.CASES)]) == 0
