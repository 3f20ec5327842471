"""A sweep from its command to its last row: run, stopped, killed, extended, replayed, and with engines that break."""

from __future__ import annotations

import contextlib
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sweeping import COLLECT, VARIED, written

import itouch
from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main, sweep
from itouch_tools.sweeps.cost_estimate import estimate
from itouch_tools.sweeps.engines import Engine, EngineLostError, NoEngineError
from itouch_tools.sweeps.running import Running
from itouch_tools.sweeps.sweep_client import Client, SweepError, Swept
from itouch_tools.sweeps.sweep_elements import Stop, StopCriterion
from itouch_tools.sweeps.sweep_progress import Progress
from itouch_tools.sweeps.sweep_reading import load_sweep
from itouch_tools.sweeps.sweep_store import PLAN, RUNS, paths_of, rows, table
from itouch_tools.sweeps.work import work_of
from itouch_tools.sweeps.worker import close_runners


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return a folder with the sweep, and its rows in ``out``."""
    folder = tmp_path_factory.mktemp("sweep") / "home"
    path = written(folder)
    assert main(["sweep", str(path), "-o", str(folder / "out"), "--workers", "2"]) == 0
    yield folder
    close_runners()


class Breaking:
    """An engine that does tasks here, and breaks when it is told to."""

    name, count, alive = "processes", 1, True

    def __init__(self, *after: int) -> None:
        self._after = list(after)

    @contextlib.contextmanager
    def working(self) -> Iterator[Breaking]:
        yield self

    def results(self, tasks: Iterator[Any]) -> Iterator[Any]:
        most = self._after.pop(0) if self._after else 10**9
        for count, (function, words) in enumerate(tasks):
            if count >= most:
                raise EngineLostError("a worker is gone")
            yield function(*words)


def swept(path: Path, out: Path, engine: Any, told: Any = None) -> Any:
    catalog = Catalog()
    return Client(load_sweep(path, catalog), out, engine, catalog, told).sweep()


def test_every_run_has_its_row_and_any_reader_reads_them(home: Path) -> None:
    found = pq.read_table(home / "out" / RUNS).to_pandas()
    assert len(found) == 8
    assert set(found["status"]) == {"done"}
    assert found["digest"].is_unique
    assert set(found["mass"]) == {60.0, 80.0}
    assert (found["own_seed"] == found["seed"]).all()
    assert found.groupby("mass")["force"].nunique().min() >= 2
    assert found["state"].nunique() == 8


def test_status_says_how_far_it_is_and_why_runs_failed(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "status", str(home / "out")]) == 0
    assert capsys.readouterr().out == f"8 of 8 runs in {home / 'out'}: 8 done\n"
    # without a scene beside it, a part of its rows, half of which failed, and a folder of before
    part = tmp_path / "a part"
    shutil.copytree(home / "out", part)
    paths = paths_of(part)  # on a busy machine each row may have a file of its own
    found = pa.concat_tables([pq.read_table(path, partitioning=None) for path in paths]).slice(0, 2)
    for path in paths[1:]:
        path.unlink()
    failed = [["done", "error"], ["", "ValueError: no such\x1b[2Jthing"]]
    for name, values in zip(("status", "reason"), failed, strict=True):
        found = found.set_column(found.schema.get_field_index(name), name, pa.array(values))
    pq.write_table(found, paths[0])
    assert main(["sweep", "status", str(part)]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"2 of 8 runs in {part}: 1 done, 1 error\n  1 x error: ValueError: no such")
    assert "\x1b" not in told
    (part / PLAN).unlink()
    assert main(["sweep", "status", str(part)]) == 0
    assert capsys.readouterr().out.startswith(f"2 runs in {part}: ")
    assert main(["sweep", "status", str(tmp_path)]) == 2
    assert "is not the folder of a sweep" in capsys.readouterr().err


def test_run_may_stand_before_the_sweep(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "run", str(home / "sweep.xml"), "-o", str(home / "out")]) == 0
    assert "8 of 8 runs" in capsys.readouterr().out


def test_the_same_command_again_runs_nothing(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in paths_of(home / "out")}
    assert main(["sweep", str(home / "sweep.xml"), "-o", str(home / "out"), "--workers", "1"]) == 0
    assert {path: path.stat().st_mtime_ns for path in paths_of(home / "out")} == before
    assert "8 of 8 runs" in capsys.readouterr().out


def test_a_row_is_replayed_to_the_same_bytes(home: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    row = next(rows(home / "out"))
    words = ["sweep", "replay", str(home / "out"), row["digest"][:10]]
    assert main([*words, "--headless"]) == 0
    assert f"the same bytes: state {row['state'][:12]}" in capsys.readouterr().out
    saved = tmp_path / "row.itouch"
    assert main([*words, "--save", str(saved)]) == 0
    session = itouch.restore(saved)
    session.run()
    assert session.report()["contacts"][0]["peak_force_N"] == row["force"]
    assert main(["sweep", "replay", str(home / "out"), "zz", "--headless"]) == 2
    assert "no row begins with the digest 'zz'" in capsys.readouterr().err


def test_a_row_that_says_something_else_differs(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forged = tmp_path / "forged"
    shutil.copytree(home / "out", forged)
    path = paths_of(forged)[0]
    found = pq.read_table(path, partitioning=None)
    told = found.to_pylist()
    told[0] |= {"force": 9.0, "cpu": "another processor"}
    pq.write_table(pa.Table.from_pylist(told, schema=found.schema), path)
    assert main(["sweep", "replay", str(forged), told[0]["digest"][:12], "--headless"]) == 1
    printed = capsys.readouterr().out
    assert "differs: force: 9.0 then, " in printed
    assert "the row was made on 'another processor'" in printed


def test_an_engine_that_breaks_loses_and_doubles_nothing(home: Path, tmp_path: Path) -> None:
    done = swept(home / "sweep.xml", tmp_path / "out", Breaking(1, 2))
    assert (done.rows, done.losses, done.whole) == (8, 2, True)
    assert table(tmp_path / "out").equals(table(home / "out"))


def test_an_engine_that_always_breaks_ends_with_a_sentence(home: Path, tmp_path: Path) -> None:
    with pytest.raises(SweepError, match=r"the engine is lost: a worker is gone; 0 of 8 rows are kept, and the same"):
        swept(home / "sweep.xml", tmp_path / "out", Breaking(*[0] * 50))


def test_a_sweep_that_is_stopped_goes_on_and_is_extended(home: Path, tmp_path: Path) -> None:
    asked: list[bool] = []

    def stop(progress: Progress) -> None:
        if progress.done >= 3 and not asked:
            asked.append(True)
            signal.raise_signal(signal.SIGINT)

    done = swept(home / "sweep.xml", tmp_path / "out", Breaking(), stop)
    assert done.ended_by == "interrupted"
    assert 3 <= done.rows < 8
    assert swept(home / "sweep.xml", tmp_path / "out", Breaking()).rows == 8
    assert table(tmp_path / "out").equals(table(home / "out"))
    larger = written(tmp_path / "larger", VARIED.replace('values="60 80"', 'values="60 70 80"') + COLLECT)
    before = set(paths_of(tmp_path / "out"))
    assert swept(larger, tmp_path / "out", Breaking()).rows == 12
    assert before < set(paths_of(tmp_path / "out"))
    assert sum(pq.read_metadata(path).num_rows for path in set(paths_of(tmp_path / "out")) - before) == 4


def test_pilots_tell_runs_time_size_and_keys_that_nobody_has(tmp_path: Path) -> None:
    inside = VARIED + COLLECT.replace("peak_force_N", "peak_fource_N")
    found = estimate(load_sweep(written(tmp_path / "a", inside), Catalog()), Catalog(), 2)
    assert (found.runs, found.structures) == (8, 4)
    assert dict(found.statuses) == {"done": 2}
    assert found.seconds >= 8 * found.run_s > 0.0
    assert 32 < found.row_bytes < 2000
    assert [problem.advice for problem in found.problems] == ["did you mean 'peak_force_N'?"]


def test_a_sweep_ends_when_enough_is_known_or_too_much_fails() -> None:
    enough = Progress(100, 0, Stop(enough=(StopCriterion(result="x", half_width=0.5, at_least=10),)))
    values = [random.Random(1).gauss(3.0, 0.2) for _ in range(12)]
    for index, value in enumerate(values):
        assert not enough.ended_by() or index >= 10
        enough.add({"status": "done", "x": value})
    assert enough.ended_by().startswith("known well enough: x = 3")
    failing = Progress(100, 0, Stop(failures=2))
    failing.add({"status": "fault"})
    assert not failing.ended_by()
    failing.add({"status": "crashed"})
    assert failing.ended_by() == "2 runs were not 'done': 1 crashed, 1 fault"
    assert "failures: 1 crashed, 1 fault" in failing.line()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--engine", "cloud"), "there is no engine 'cloud'"),
        (("--engine", "dask"), "needs its scheduler: --scheduler tcp://HOST:8786"),
        (("--scheduler", "tcp://x:1"), "--scheduler is that of --engine dask"),
        (("--engine", "ray"), "the engine 'ray' needs ray"),
        (("--workers", "0"), "--workers must be 1 or more"),
    ],
)
def test_an_engine_that_is_not_there_is_a_sentence(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], told: str
) -> None:
    assert main(["sweep", str(home / "sweep.xml"), "-o", str(tmp_path / "out"), *words]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("itouch_tools.sweeps.engines.ANSWERS", 1.0)
    with pytest.raises(NoEngineError, match="no scheduler answers at"), Engine("dask", "tcp://127.0.0.1:9").working():
        pass


def test_a_client_that_is_killed_leaves_whole_files(home: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "itouch_tools.cli", "sweep", str(home / "sweep.xml"), "-o", str(tmp_path / "out")]
    client = subprocess.Popen([*command, "--workers", "1"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 240.0
    while not paths_of(tmp_path / "out") and client.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    client.kill()
    client.wait()
    kept = pq.read_table(tmp_path / "out" / RUNS).num_rows
    assert 0 < kept <= 8
    assert swept(home / "sweep.xml", tmp_path / "out", Breaking()).rows == 8
    assert table(tmp_path / "out").equals(table(home / "out"))


def test_a_sweep_of_a_scene_with_parts_that_come_with_the_program(tmp_path: Path) -> None:
    """Such an include is no file of the scene's folder; that it is the same everywhere is looked at by content."""
    path = written(tmp_path / "home", inside='<grid name="m" set="operator.mass" values="60" unit="g"/>' + COLLECT)
    scene = path.with_name("first_touch.xml")
    text = scene.read_text(encoding="utf-8")
    scene.write_text(
        text.replace("<materials>", '<include file="itouch:materials.xml" prefix="their-"/>\n<materials>', 1)
    )
    assert scene.read_text(encoding="utf-8") != text
    out = tmp_path / "out"
    assert main(["sweep", str(path), "-o", str(out), "--workers", "1"]) == 0
    assert [row["status"] for row in rows(out)] == ["done"]
    catalog = Catalog()
    work = work_of(load_sweep(path, catalog), catalog)
    assert "the file 'itouch:materials.xml'" in work.parts()
    other = replace(work, files={**work.files, "itouch:materials.xml": b"another program's"})
    with pytest.raises(ValueError, match="'itouch:materials.xml' is another one here"):
        Running(other, tmp_path / "worker")


def test_a_sweep_of_a_scene_that_is_a_link(tmp_path: Path) -> None:
    path = written(tmp_path / "home", inside='<grid name="m" set="operator.mass" values="60" unit="g"/>' + COLLECT)
    (tmp_path / "shared").mkdir()
    scene = path.with_name("first_touch.xml")
    scene.symlink_to(scene.rename(tmp_path / "shared/any.xml"))
    out = tmp_path / "out"
    assert main(["sweep", str(path), "-o", str(out), "--workers", "1"]) == 0
    assert [row["status"] for row in rows(out)] == ["done"]


@pytest.mark.parametrize(("ended_by", "code"), [("", 0), ("interrupted", 130), ("the end of its time", 0)])
def test_the_command_ends_with_the_code_of_what_ended_it(
    ended_by: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sweep._told(Swept(tmp_path, 3, 8, {"done": 2, "failed": 1}, ended_by, 1, 2)) == code
    said = capsys.readouterr().out
    assert f"3 of 8 runs in {tmp_path}: 2 done, 1 failed\n  tried again: 1 runs; engine lost: 2 times\n" in said
    assert ("the same command goes on" in said) == bool(ended_by) and ended_by in said
