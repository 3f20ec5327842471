"""Which rate of the servo loop this machine holds for a scene: measured on twins, in a servo process with priority."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from itouch.loop.timing import WAKE_UP
from itouch.scene import Scene
from itouch.schema import SceneError
from itouch_tools.cli.doctor.loop import in_process
from itouch_tools.cli.doctor.timer import beside_the_loop, busy

#: The rates that are tried [Hz], the slowest first.
RATES = (1000.0, 2000.0, 4000.0)
#: Share of ticks that may overrun by the tick's own time, and by a late wake-up.
OWN, WOKEN_LATE = 1e-4, 1e-3


@dataclass(frozen=True, slots=True)
class Held:
    """One rate: how long ticks took [us], how many overran by themselves and by a late wake-up, and the verdict.

    ``bare_ticks``, ``bare_late``: periods of a loop that only waits, at the same rate and priority, right after it, and
    after how many a tick of the same length would have overrun.
    """

    rate_hz: float
    ticks: int
    tick_p50_us: float
    tick_p99_us: float
    overruns_own: int
    overruns_late: int
    skipped: int
    problem: str = ""
    bare_ticks: int = 0
    bare_late: int = 0

    @property
    def held(self) -> bool:
        """Whether the machine holds this rate."""
        if self.problem or not self.ticks or self.skipped:
            return False
        return self.overruns_own <= OWN * self.ticks and self.overruns_late <= WOKEN_LATE * self.ticks

    def sentence(self) -> str:
        """Say it in words."""
        if self.problem:
            return f"{self.rate_hz:g} Hz: {self.problem}"
        spent = f"tick p50 {self.tick_p50_us:.0f} us, p99 {self.tick_p99_us:.0f} us of {1e6 / self.rate_hz:.0f}"
        over = f"of {self.ticks} ticks {self.overruns_own} overran by themselves, {self.overruns_late} began late"
        skipped = f", {self.skipped} periods were given up" if self.skipped else ""
        bare = f" (a bare timer: {self.bare_late} of {self.bare_ticks})" if self.bare_ticks else ""
        return f"{self.rate_hz:g} Hz {'held' if self.held else 'NOT held'}: {spent}; {over}{bare}{skipped}"


def rates(scene: Scene, seconds: float, *, beside: int = 0) -> Iterator[Held]:
    """Yield what each rate was like, run for some seconds; a rate that does not suit the scene is told as that.

    ``beside``: so many processes compute at the same time, and a loop that only waits is measured, too.
    """
    with busy(beside):
        for rate in RATES:
            changed = replace(scene, rates=replace(scene.rates, servo=rate))
            try:
                times = in_process(changed, seconds, realtime=True)
            except SceneError as error:
                problem = error.problems[0].sentence
                yield Held(rate, 0, 0.0, 0.0, 0, 0, 0, problem)
                continue
            culprits, spent = times.culprits(), times.summary()
            late, p50 = culprits.get(WAKE_UP, 0), spent["p50"] or 0.0
            bare = beside_the_loop(rate, seconds, p50 * 1e-6) if beside else (0, 0)
            own = times.overruns - late
            yield Held(rate, times.ticks, p50, spent["p99"] or 0.0, own, late, times.skipped, "", *bare)


def best(found: list[Held]) -> str:
    """Say which is the fastest rate that is held."""
    held = [row.rate_hz for row in found if row.held]
    return f"this machine holds {max(held):g} Hz for this scene" if held else "this machine holds none of these rates"
