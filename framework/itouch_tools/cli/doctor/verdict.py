"""Whether a person should put a finger in: judged by the loop itself, idle and beside a load."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from itouch.loop.timing import Timing
from itouch.platforms import cores
from itouch_tools.cli.doctor.diagnosis import Diagnosis
from itouch_tools.cli.doctor.measured_loop import bench_scene, in_process

#: An arm's watchdog [us]: if commands are later than that, devices make themselves safe.
WATCHDOG_US = 20_000.0
#: Share of ticks that may end after the next one was due, and how late any tick may begin at most [us].
SHARE, LATEST_US = 1e-3, 5_000.0
#: The findings without which no finger should be put in, and their names in the verdict.
_NEEDED = {"system": "Linux", "timer": "timer that is exact enough", "priority": "real-time priority"}
_BUSY = "while True: sum(range(10000))"


@dataclass(frozen=True, slots=True)
class Measured:
    """The loop beside a load: how late ticks began, how long they took [us], how many overran and because of what."""

    load: str
    ticks: int
    late_p50_us: float
    late_p99_us: float
    late_max_us: float
    tick_p99_us: float
    overruns: int
    culprits: dict[str, int]

    def sentence(self) -> str:
        """Return the measurement in words."""
        late = f"late p50 {self.late_p50_us:.0f} us, p99 {self.late_p99_us:.0f}, at worst {self.late_max_us:.0f}"
        causes = ", ".join(f"{name} {count}" for name, count in sorted(self.culprits.items(), key=lambda c: -c[1])[:3])
        over = f"{self.overruns} of {self.ticks} ticks overran" + (f" ({causes})" if causes else "")
        return f"{late}; tick p99 {self.tick_p99_us:.0f} us; {over}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a person should put a finger in (None: not known), and why."""

    finger: bool | None
    sentence: str


def measure(seconds: float) -> list[Measured]:
    """Run the loop for ``seconds`` on an idle machine, and again beside as many busy processes as processors."""
    description = bench_scene()
    idle = _measured("idle", in_process(description, seconds, realtime=True))
    busy = [subprocess.Popen([sys.executable, "-c", _BUSY]) for _ in range(cores())]
    try:
        loaded = _measured("busy", in_process(description, seconds, realtime=True))
    finally:
        for process in busy:
            process.kill()
        for process in busy:
            process.wait()
    return [idle, loaded]


def _measured(load: str, times: Timing) -> Measured:
    late = times.lateness()
    return Measured(
        load, times.ticks, late["p50"] or 0.0, late["p99"] or 0.0, late["max"] or 0.0, times.summary()["p99"] or 0.0,
        times.overruns, times.culprits(),
    )  # fmt: skip


def judge(findings: Sequence[Diagnosis], measured: Sequence[Measured] | None) -> Verdict:
    """Judge whether a person should put a finger in, by the findings and by the measured loop, if it was measured."""
    lacks = {finding.name for finding in findings if finding.status == "lack"}
    why = [f"there is no {named}" for name, named in _NEEDED.items() if name in lacks]
    if measured is None and not why:
        sentence = "whether a person may put a finger in is not known before the loop is measured: --measure 10s"
        return Verdict(None, sentence)
    for row in measured or ():
        if row.late_max_us > LATEST_US:
            late = f"{row.late_max_us / 1e3:.1f} ms"
            past = ", which is past the watchdog of an arm" if row.late_max_us > WATCHDOG_US else ""
            why.append(f"a tick began {late} late ({row.load}){past}")
        if row.overruns > SHARE * max(1, row.ticks):
            why.append(f"{row.overruns} of {row.ticks} ticks overran ({row.load})")
        if row.ticks == 0:
            why.append(f"the loop did not run ({row.load})")
    if why:
        return Verdict(False, f"a person should NOT put a finger in: {'; '.join(why)}")
    return Verdict(True, "a person may put a finger in, as far as this machine's timing is concerned")
