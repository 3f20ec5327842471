"""Which rate of the servo loop this machine holds for a scene: measured on twins, in a servo process with priority."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import add

from itouch.loop.timing import TAKEN, WAKE_UP
from itouch.scene import Scene
from itouch.schema import SceneError
from itouch_tools.cli.doctor.measured_loop import in_process
from itouch_tools.cli.doctor.timer import beside_the_loop, busy

#: The rates that are tried [Hz], the slowest first.
RATES = (1000.0, 2000.0, 4000.0)
#: Share of ticks that may overrun because the tick itself took long, and because of the machine.
OWN, WOKEN_LATE = 1e-4, 1e-3
#: Processor time [s] that a tick on twins usually takes: assumed until it has been measured.
USUAL = 50e-6


@dataclass(frozen=True, slots=True)
class Held:
    """One rate: how long ticks took, how many overran by themselves or because of the machine, and whether it is held.

    Times are in [us].  ``cpu_p999_us`` and ``cpu_max_us``: how long a tick had a processor.  ``overruns_late``: ticks
    that were woken late; ``overruns_taken``: ticks that lost the processor.  ``bare_...``: the same for a loop that
    only waits and then keeps a processor busy for as long as a tick usually does, at the same rate and priority, run
    before and after the measurement.
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
    overruns_taken: int = 0
    bare_taken: int = 0
    bare_own: int = 0
    cpu_p999_us: float = 0.0
    cpu_max_us: float = 0.0

    @property
    def held(self) -> bool:
        """Whether the machine holds this rate: no period given up, and few enough overruns."""
        if self.problem or not self.ticks or self.skipped:
            return False
        return (
            self.overruns_own <= OWN * self.ticks
            and self.overruns_late + self.overruns_taken <= WOKEN_LATE * self.ticks
        )

    def sentence(self) -> str:
        """Return the measurement in words."""
        if self.problem:
            return f"{self.rate_hz:g} Hz: {self.problem}"
        spent = f"tick p50 {self.tick_p50_us:.0f} us, p99 {self.tick_p99_us:.0f} us of {1e6 / self.rate_hz:.0f}"
        if self.cpu_max_us:
            spent += f"; it had a processor for {self.cpu_p999_us:.0f} us at p99.9, {self.cpu_max_us:.0f} at most"
        over = f"of {self.ticks} ticks {_over(self.overruns_own, self.overruns_late, self.overruns_taken)}"
        skipped = f", {self.skipped} periods were given up" if self.skipped else ""
        bare = _over(self.bare_own, self.bare_late, self.bare_taken)
        bare = f" (of {self.bare_ticks} of a bare timer {bare})" if self.bare_ticks else ""
        return f"{self.rate_hz:g} Hz {'held' if self.held else 'NOT held'}: {spent}; {over}{bare}{skipped}"


def _over(own: int, late: int, taken: int) -> str:
    return f"{own} overran by themselves, {late} were woken late, {taken} lost the processor"


def rates(scene: Scene, seconds: float, *, beside: int = 0) -> Iterator[Held]:
    """Yield the measurement of each rate, run for some seconds; one that does not suit the scene has a ``problem``.

    If ``beside`` > 0, that many processes compute at the same time, and a loop that only waits is measured, too.
    """
    with busy(beside):
        for rate in RATES:
            changed = replace(scene, rates=replace(scene.rates, servo=rate))
            bare = before = (0, 0, 0, 0)
            if beside:
                before = beside_the_loop(rate, 0.5 * seconds, USUAL)
            try:
                times = in_process(changed, seconds, realtime=True)
            except SceneError as error:
                problem = error.problems[0].sentence
                yield Held(rate, 0, 0.0, 0.0, 0, 0, 0, problem)
                continue
            culprits, spent, cpu = times.culprits(), times.summary(), times.processor()
            late, taken = culprits.get(WAKE_UP, 0), culprits.get(TAKEN, 0)
            if beside:
                after = beside_the_loop(rate, 0.5 * seconds, (cpu["p50"] or 0.0) * 1e-6)
                bare = tuple(map(add, before, after))
            yield Held(
                rate, times.ticks, spent["p50"] or 0.0, spent["p99"] or 0.0, times.overruns - late - taken, late,
                times.skipped, "", bare[0], bare[1], taken, bare[2], bare[3], cpu["p99.9"] or 0.0, cpu["max"] or 0.0,
            )  # fmt: skip


def best(found: list[Held]) -> str:
    """Return a sentence that names the fastest rate that is held."""
    held = [row.rate_hz for row in found if row.held]
    return f"this machine holds {max(held):g} Hz for this scene" if held else "this machine holds none of these rates"
