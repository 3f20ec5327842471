"""``doctor --rates`` judges what it has measured, and ``bench batch`` prints figures that belong together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shipped import SCENES

from itouch.loop.timing import WAKE_UP, Timing
from itouch.plugin.discovery import Catalog
from itouch.session import load_scene
from itouch.world import Model
from itouch_evidence import bench_batch as bench
from itouch_evidence import start as start_bench
from itouch_evidence.start import Start, table
from itouch_tools.cli import main
from itouch_tools.cli.doctor import held_rates, timer
from itouch_tools.cli.doctor.held_rates import Held
from itouch_tools.cli.doctor.timer import waited

FIRST = SCENES / "first_touch.xml"
GOOD = Held(1000.0, 20_000, 60.0, 90.0, 2, 20, 0)


@pytest.mark.parametrize(
    ("changes", "held"),
    [
        ({}, True),
        ({"overruns_own": 3}, False),
        ({"overruns_late": 21}, False),
        ({"overruns_late": 15, "overruns_taken": 6}, False),
        ({"overruns_late": 15, "overruns_taken": 5}, True),
        ({"skipped": 1}, False),
        ({"ticks": 0}, False),
        ({"problem": "does not divide"}, False),
    ],
)
def test_a_rate_is_held_only_if_nearly_no_tick_overran(changes: dict[str, Any], held: bool) -> None:
    row = replace(GOOD, **changes)
    assert row.held is held
    assert ("NOT held" in row.sentence()) is (not held and not row.problem)


def test_the_fastest_rate_that_is_held_is_named() -> None:
    rows = [GOOD, replace(GOOD, rate_hz=2000.0), replace(GOOD, rate_hz=4000.0, overruns_own=50)]
    assert held_rates.best(rows) == "this machine holds 2000 Hz for this scene"
    assert held_rates.best(rows[2:]) == "this machine holds none of these rates"


def test_each_rate_is_run_and_a_modality_that_does_not_divide_it_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def run(scene: Any, seconds: float, *, realtime: bool) -> Timing:
        asked.append((scene.rates.servo, seconds, realtime))
        Model.of(scene, Catalog())  # what a servo process does first
        times = Timing(["a", "b"])
        for _ in range(1000):
            times.add([0.0, 1e-5, 3e-5])
        times.record["overruns"][...], times.record["culprits"][:2] = 5, (1, 4)
        return times

    monkeypatch.setattr(held_rates, "in_process", run)
    assert main(["doctor", "--rates", str(FIRST), "--measure", "2s", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert asked == [(1000.0, 2.0, True), (2000.0, 2.0, True), (4000.0, 2.0, True)]
    assert [(row["overruns_late"], row["overruns_own"]) for row in found["rates"]] == [(1, 4)] * 3
    assert found["verdict"] == "this machine holds none of these rates"
    assert WAKE_UP == "wake-up"


class Late:
    """A clock that is late by what it is told, a period after the other."""

    pace = "real"

    def __init__(self, *late: float) -> None:
        self.late, self.started = list(late), 0

    def start(self, period: float) -> None:
        self.started += 1

    def wait(self) -> float:
        return self.late.pop(0)


class Machine:
    """Time of a machine: each look takes a microsecond, and it takes the processor away as it is told [s]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, taken: float = 0.0) -> None:
        self.had, self.taken = 0.0, taken
        monkeypatch.setattr(timer, "processor_time", self.processor)
        monkeypatch.setattr(timer, "now", lambda: self.had + (self.taken if self.had > 1e-4 else 0.0))

    def processor(self) -> float:
        self.had += 1e-6
        return self.had


def test_a_bare_timer_counts_what_would_have_overrun(monkeypatch: pytest.MonkeyPatch) -> None:
    Machine(monkeypatch)
    clock = Late(0.0, 7e-5, 9e-5, 3e-4, 0.0)
    assert waited(clock, 2.5e-4, 5, 1.7e-4) == (2, 0, 0)
    assert clock.started == 1
    clock = Late(0.0, 6e-3, 0.0)
    assert waited(clock, 2.5e-4, 3, 1e-5) == (1, 0, 0)
    assert clock.started == 2  # what is missed by more than the servo loop catches up with is not caught up with


def test_it_tells_what_took_its_processor_and_what_is_too_much_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    Machine(monkeypatch, taken=3e-4)
    assert waited(Late(0.0), 2.5e-4, 1, 1.7e-4) == (0, 1, 0)
    Machine(monkeypatch)
    assert waited(Late(0.0), 2.5e-4, 1, 3e-4) == (0, 0, 1)


def test_rates_beside_busy_processes_are_set_beside_a_bare_timer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(scene: Any, seconds: float, *, realtime: bool) -> Timing:
        times = Timing(["a"])
        for _ in range(100):
            times.add([0.0, 3e-5])
        return times

    monkeypatch.setattr(held_rates, "in_process", run)
    monkeypatch.setattr(held_rates, "RATES", (4000.0,))
    assert main(["doctor", "--rates", str(FIRST), "--measure", "0.1s", "--busy", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rates"]
    assert [row["bare_ticks"] for row in rows] == [400]
    assert all(0 <= row["bare_late"] <= row["bare_ticks"] for row in rows)
    said = replace(GOOD, bare_ticks=GOOD.ticks, bare_late=3).sentence()
    assert f"(of {GOOD.ticks} of a bare timer 0 overran by themselves, 3 were woken late, 0 lost the processor)" in said
    with pytest.raises(SystemExit):
        main(["doctor", "--rates", str(FIRST), "--busy", "-1"])


def test_a_batch_is_measured_beside_plain_loops() -> None:
    catalog = Catalog()
    model = Model.of(load_scene(FIRST, catalog=catalog), catalog)
    found = bench.measure(model, 1, 0.02, rounds=20_000)
    assert found["cores"] >= 1
    assert found["gain"] == pytest.approx(found["sessions_per_s"]["all"] / found["sessions_per_s"]["one"])
    assert found["share_of_that"] == pytest.approx(found["gain"] / found["gain_of_plain_loops"])


def test_the_gain_of_a_batch_stands_beside_what_it_must_be() -> None:
    assert bench.judged(0.96) == "0.96 of that, at least 0.9"
    assert bench.judged(0.89) == "0.89 of that, at least 0.9 MISSED"


def start_of(seconds: float, functions: int) -> Start:
    stage = {"stage": "model", "cpu": seconds, "wall": seconds, "compiled": functions}
    return Start("first", seconds, seconds, (stage,))


@pytest.mark.parametrize(
    ("first", "compiled", "says"),
    [
        (1.4, 0, "1.40 in CPU, 1.40 in time, at most 1.5"),
        (1.6, 0, "1.60 in CPU, 1.60 in time, at most 1.5 MISSED"),
        (9.0, 3, "9.00 in CPU, 9.00 in time (from a wheel nothing is compiled)"),
    ],
)
def test_a_first_start_stands_beside_what_it_may_take(first: float, compiled: int, says: str) -> None:
    assert table(start_of(first, compiled), start_of(1.0, 0))[-1] == f"first / later: {says}"


@pytest.mark.parametrize(
    ("first", "compiled", "asked", "code"),
    [(1.4, 0, 0.1, 0), (1.6, 0, 0.1, 1), (9.0, 3, 0.1, 0), (1.4, 0, 0.2, 1), (9.0, 3, 0.2, 1)],
)
def test_a_start_that_misses_its_bound_is_told_by_the_exit_code(
    first: float,
    compiled: int,
    asked: float,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(start_bench, "measure", lambda scene, times: (start_of(first, compiled), start_of(1.0, 0)))
    monkeypatch.setattr(start_bench, "help_seconds", lambda: asked)
    figures = tmp_path / "start.json"
    assert main(["bench", "start", "--json", str(figures)]) == code
    assert ("MISSED" in capsys.readouterr().out) is (code == 1)
    assert json.loads(figures.read_text(encoding="utf-8"))["help_cpu_s"] == asked


def test_a_start_that_fails_is_no_start_that_is_slow(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    figures = tmp_path / "start.json"
    assert main(["bench", "start", str(tmp_path / "no.xml"), "--json", str(figures)]) == 2
    told = capfd.readouterr().err
    assert "error[no-such-file]" in told and told.endswith("a start failed; its error is above\n")
    assert "Traceback" not in told
    assert not figures.exists()
