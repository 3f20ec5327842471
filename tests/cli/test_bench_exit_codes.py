"""A bench that prints a missed bound ends with exit code 1, and one that keeps all its bounds with 0."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shipped import SCENES

from itouch_evidence import bench_batch, bench_tick, contact, sessions
from itouch_evidence.contact.step_bounds import Figure as Limited
from itouch_evidence.sessions import Figure
from itouch_thermal import bench_display
from itouch_thermal.rendering.performance_table import Line
from itouch_tools.cli import main

FIRST = str(SCENES / "first_touch.xml")
Bench = Callable[[pytest.MonkeyPatch, bool], list[str]]


def batches(patch: pytest.MonkeyPatch, good: bool) -> list[str]:
    found = {
        "scene": "s", "cores": 2, "sessions_per_s": {"one": 1.0, "all": 2.0}, "times_real_time": {"one": 1.0, "all": 2.0},
        "gain": 2.0, "gain_of_plain_loops": 2.0, "share_of_that": 1.0 if good else 0.5,
    }  # fmt: skip
    patch.setattr(bench_batch, "measure", lambda *_, **__: found)
    return ["batch", FIRST]


def of_sessions(patch: pytest.MonkeyPatch, good: bool) -> list[str]:
    figures = [Figure("a tick", 9.0, "us", float("inf")), Figure("restore", 0.1 if good else 0.9, "s", 0.5)]
    patch.setattr(sessions, "measure", lambda scene: figures)
    return ["sessions"]


def contacts(patch: pytest.MonkeyPatch, good: bool) -> list[str]:
    figure = Limited("hf 1k", "locked steps", 0.0 if good else 1.0, 0.0, "steps")
    patch.setattr(contact, "judged", lambda *_, **__: [figure])
    patch.setattr(contact, "_rows", lambda *_: ([], []))
    return ["contact", "--sizes", "1k", "--surfaces", "hf", "--steps", "1400", "--no-peers"]


def promises(patch: pytest.MonkeyPatch, good: bool) -> list[str]:
    lines = [Line("wood", "peak", 1.0, None, ""), Line("wood", "rms", 1.0, 2.0 if good else 0.5, "")]
    patch.setattr(bench_display.Table, "lines", lambda self: iter(lines))
    return ["display", "--table", "--materials", "wood"]


def ticks(changed: dict[str, Any]) -> Bench:
    def bench(patch: pytest.MonkeyPatch, good: bool) -> list[str]:
        found = {
            "scene": "s", "ticks": 9, "tick_us": {"p50": 3.0, "p99": 4.0, "mean": 3.0}, "real_time": 300.0, "steps": 9,
            "joined_steps": 9, "calls": 1, "round_us": 3.0, "compiled_us": 2.0, "left_to_python": 0.0, "split_us": 5.0,
            "fence_us": 1.0,
        }  # fmt: skip
        wrong = {} if good else changed
        patch.setattr(bench_tick, "measure", lambda *_: {**found, **wrong})
        patch.setattr(
            bench_tick, "turns", lambda *_: {"begins": wrong.get("begins", 1e-4), "ends": None, "changes": 1e-5}
        )
        return ["tick"]

    return bench


@pytest.mark.parametrize("json", [False, True])
@pytest.mark.parametrize(
    "bench",
    [
        batches,
        of_sessions,
        contacts,
        promises,
        ticks({"round_us": 5.0}),
        ticks({"split_us": 11.0}),
        ticks({"begins": 3e-4}),
    ],
)
def test_a_missed_bound_is_told_by_the_exit_code(
    bench: Bench, json: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for good, code in ((True, 0), (False, 1)):
        words = bench(monkeypatch, good)
        beside = [] if not json else ["--json"] if words[0] in ("batch", "tick") else ["--json", str(tmp_path / "rows")]
        assert main(["bench", *words, *beside]) == code
        printed = capsys.readouterr().out
        assert beside == ["--json"] or ("MISSED" in printed or "FAIL" in printed) is (code == 1)
