"""Timing: bins that tell durations to within 2 %, culprits of overruns, skipped periods; no wall clock in any assertion."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop.pacing import Pacing
from itouch.loop.run_statistics import Histogram
from itouch.loop.timing import BETWEEN, BINS, TAKEN, WAKE_UP, Timing, edges, percentile


class _Clock:
    """A clock whose lateness a test writes down."""

    pace = "real"

    def __init__(self, late: list[float]) -> None:
        self.late, self.starts = late, 0

    def start(self, period: float) -> None:
        self.starts += 1

    def wait(self) -> float:
        return self.late.pop(0) if self.late else 0.0


def test_percentiles_are_right_to_two_percent() -> None:
    times, rng = Timing(["a"]), np.random.default_rng(1)
    values = np.exp(rng.normal(-9.0, 1.0, 20_000))
    for value in values.tolist():
        times.add([0.0, value])
    found = times.summary()
    for name, percent in (("p50", 50), ("p99", 99), ("p99.9", 99.9)):
        assert found[name] == pytest.approx(np.percentile(values, percent) * 1e6, rel=0.025)
    assert found["max"] == pytest.approx(values.max() * 1e6)
    assert times.ticks == 20_000
    assert sum(count for *_, count in times.histogram(1)) == 20_000


@pytest.mark.parametrize("value", [0.0, 1e-9, 0.25e-6, 15.0, 1e9])
def test_what_is_beyond_the_bins_counts_in_the_last(value: float) -> None:
    times = Timing(["a"])
    times.add([0.0, value])
    assert times.record["counts"][1].sum() == 1
    assert times.summary()["max"] == pytest.approx(value * 1e6)
    assert edges().shape == (BINS + 1,)
    assert percentile(np.zeros(BINS), 50) is None


def test_an_overrun_names_the_part_that_took_longest_and_its_backlog_too() -> None:
    times = Timing(["read arm", "contact", "twins"])
    quick = [0.0, 1e-4, 2e-4, 3e-4]
    assert times.pace(1e-5, 1e-3, quick) is None
    assert times.pace(0.0, 1e-3, [0.0, 3e-3, 3.1e-3, 3.2e-3]) == "read arm"
    assert times.pace(2.2e-3, 1e-3, quick) == "read arm"  # still behind because of it
    assert times.pace(1.5e-3, 1e-3, quick) == "read arm"
    assert times.pace(0.1e-3, 1e-3, quick) is None
    assert times.pace(4e-3, 1e-3, quick) == WAKE_UP
    assert times.overruns == 4
    assert times.culprits() == {"read arm": 3, WAKE_UP: 1}


def test_what_the_machine_takes_is_not_the_ticks_own_time() -> None:
    times = Timing(["read arm", "contact", "twins"])
    long, quick = [0.0, 2.9e-3, 3.0e-3, 3.1e-3], [0.0, 1e-4, 2e-4, 3e-4]
    assert times.pace(0.0, 1e-3, long, end=3.2e-3, busy=3e-4) == TAKEN
    assert times.pace(2.2e-3, 1e-3, quick, end=3e-4, busy=3e-4) == TAKEN  # still behind because of it
    assert times.pace(0.0, 1e-3, quick, end=3e-4, busy=3e-4) is None
    assert times.pace(2.0e-3, 1e-3, long, end=3.1e-3, busy=3e-4) == TAKEN  # it was woken late, and lost more then
    assert times.pace(0.0, 1e-3, quick, end=3e-4, busy=3e-4) is None
    assert times.pace(4.0e-3, 1e-3, long, end=3.1e-3, busy=3e-4) == WAKE_UP
    assert times.pace(0.0, 1e-3, quick, end=3e-4, busy=3e-4) is None
    assert times.pace(4.0e-3, 1e-3, long, end=3.1e-3, busy=2.5e-3) == "read arm"  # so long it would have been anyway
    assert times.pace(0.0, 1e-3, quick, end=3e-4, busy=3e-4) is None
    assert times.pace(0.0, 1e-3, long, end=3.1e-3, busy=3e-4, waited=True) == "read arm"  # it waited by itself
    assert times.machine() == {WAKE_UP: 1, TAKEN: 3}
    assert times.overruns == sum(times.culprits().values()) == 6
    assert times.processor()["max"] == pytest.approx(2500.0)


def test_what_ticks_take_adds_up_until_the_loop_has_caught_up_with_it() -> None:
    times = Timing(["read arm", "contact", "twins"])
    busy = [0.0, 8e-4, 8.5e-4, 9e-4]
    found = [times.pace(2e-4 * n, 1e-3, busy, end=1.2e-3, busy=1.2e-3) for n in range(5)]
    assert found == [None, "read arm", "read arm", "read arm", "read arm"]  # 0.2 ms a tick, by itself
    times.skip(1)
    assert times.pace(9e-4, 1e-3, busy, end=9e-4, busy=9e-4) == WAKE_UP  # nothing is left of that


def _spin(seconds: float) -> None:
    begin = time.thread_time()
    while time.thread_time() - begin < seconds:
        pass


@pytest.mark.parametrize("spend", [_spin, time.sleep])
def test_what_is_done_between_two_ticks_is_told_as_that(spend: Callable[[float], None]) -> None:
    late = [0.0] * 300
    late[101] = 0.004  # for the tap of the tick before
    engine = itouch.build(SCENES / "first_touch.xml", clock=_Clock(late))
    engine.taps.append(lambda tick: spend(0.005) if tick == 100 else None)
    engine.run(0.3)
    servo = engine.report()["servo"]
    assert {one["tick"]: one["culprit"] for one in servo["worst"]}[101] == BETWEEN
    assert servo["processor_us"]["max"] > (5000.0 if spend is _spin else 0.0)


def test_the_worst_overruns_are_kept_by_tick_and_told_worst_first() -> None:
    times = Timing(["read arm", "contact", "twins"])
    assert times.worst() == []
    lates = [1e-3 * (1 + (7 * n) % 20) for n in range(20)]
    for tick, late in enumerate(lates):
        times.pace(late, 1e-3, [0.0, 1e-5, 2e-5, 3e-5], tick)
        times.pace(0.0, 1e-3, [0.0, 1e-5, 2e-5, 3e-5], tick)
    assert [one["tick"] for one in times.worst()] == sorted(range(20), key=lambda tick: -lates[tick])[:8]
    assert times.worst()[0]["us"] == pytest.approx(19030.0)
    assert {one["culprit"] for one in times.worst()} == {WAKE_UP}


def test_a_slow_device_is_told_as_the_culprit() -> None:
    late = [0.0] * 300
    late[100] = 0.005
    engine = itouch.build(SCENES / "first_touch.xml", clock=_Clock(late))
    engine.run(0.3)
    servo = engine.report()["servo"]
    assert servo["culprits"].get(WAKE_UP, 0) >= 1
    (worst,) = (one for one in servo["worst"] if one["tick"] == 100)  # this machine may be later elsewhere
    assert worst["culprit"] == WAKE_UP
    assert worst["us"] > 4000.0
    assert servo["overruns"] == sum(servo["culprits"].values())
    assert servo["lateness_us"]["max"] == pytest.approx(5000, rel=1e-6)
    json.dumps(servo, allow_nan=False)


def test_what_can_not_be_caught_up_with_is_skipped_and_counted() -> None:
    clock = _Clock([0.0] * 50 + [0.5] + [0.0] * 49)
    engine = itouch.build(SCENES / "first_touch.xml", clock=clock)
    engine.run(0.1)
    assert clock.starts == 2  # the deadlines begin anew
    assert engine.report()["servo"]["skipped"] == 500
    assert engine.ticks == 100


@pytest.mark.parametrize(("policy", "stops"), [("stop", True), ("warn", False)])
def test_falling_behind_stops_only_where_the_scene_says_so(tmp_path: Path, policy: str, stops: bool) -> None:
    text = (SCENES / "first_touch.xml").read_text()
    path = tmp_path / "s.xml"
    path.write_text(text.replace("</itouch>", f'<safety servo-overrun="{policy}"/></itouch>'), encoding="utf-8")
    engine = itouch.build(path, clock=_Clock([0.0] * 50 + [0.5]))
    if not stops:
        engine.run(0.1)
        assert engine.report()["servo"]["overruns"] >= 1
        return
    with pytest.raises(itouch.DeviceFaultError, match="500.0 ms late: the servo loop cannot keep up"):
        engine.run(0.1)
    assert engine.report()["faults"][0]["trip"] == "overrun"
    assert np.all(engine.state["arm.sent.wrench"] == 0.0)


def test_hours_need_no_more_memory_than_seconds() -> None:
    times = Timing(["a", "b"])
    size = times.record.nbytes
    for _ in range(5000):
        times.add([0.0, 1e-5, 3e-5])
    assert times.record.nbytes == size < 10_000


def test_a_histogram_tells_percentiles_to_a_bin() -> None:
    counted = Histogram(0.5)
    for value in (0.1, 0.6, 0.7, 3.2):
        counted.add(value)
    assert counted.summary(2.0) == {"p50": 2.0, "p99": 6.4, "max": 6.4}
    assert counted.dump()["counts"] == {"0": 1, "1": 2, "6": 1}


def test_a_percentile_is_reached_by_that_share_of_the_numbers_and_by_no_fewer() -> None:
    counted = Histogram(0.5)
    for value in [0.1] * 989 + [3.2] * 11:
        counted.add(value)
    assert counted.percentile(98) == 0.5
    assert counted.percentile(99) == 3.2


@pytest.mark.parametrize(
    ("scripted", "seconds", "until", "says"),
    [
        (True, None, None, ""), (False, 0.0, None, ""), (False, 0.5, None, ""), (False, None, lambda: True, ""),
        (False, None, None, "no scripted motion: say for how many seconds"), (True, -1e-3, None, "at least 0"),
        (True, math.inf, None, "a finite number"), (True, math.nan, None, "a finite number"),
    ],
)  # fmt: skip
def test_a_run_has_an_end_by_its_script_a_time_or_a_condition(
    scripted: bool, seconds: float | None, until: Callable[[], bool] | None, says: str
) -> None:
    pacing = Pacing(SimpleNamespace(scripted=scripted))  # type: ignore[arg-type]
    if says:
        with pytest.raises(ValueError, match=says):
            pacing.check(seconds, until)
    else:
        pacing.check(seconds, until)
